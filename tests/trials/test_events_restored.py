"""Delays that were not recorded are inferred where they were known, and others left alone."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from bgmodel.stopping.people import read_people
from bgmodel.stopping.task import walk
from bgmodel.stopping.trials import StopTrials
from bgmodel.trials.events import restored_delays
from circuits.errors import DataWarning
from tests.helpers import refused, unwarned

DELAYS = np.arange(0.0, 901.0, 50.0)
SSRT_MS = 150.0


def walked(seed, stops=60):
    """Return trials of a race with two staircases, delays jittered as a screen's are."""
    rng = np.random.default_rng(seed)
    trials = 4 * stops
    times = 380 + rng.gamma(2.0, 120.0, trials)
    ssd = np.full(trials, np.nan)
    signal = np.sort(rng.choice(trials, stops, replace=False))
    index = walk(times[signal] <= DELAYS[:, None] + SSRT_MS, DELAYS, [250.0, 350.0])
    ssd[signal] = DELAYS[index] + rng.uniform(0.1, 6.0, stops)
    times[signal[times[signal] > DELAYS[index] + SSRT_MS]] = np.nan
    return StopTrials(times, ssd)


def unrecorded(trials):
    """Return the trials as a program records them that gives no signal after a response."""
    return replace(trials, ssd_ms=np.where(trials.rt_ms < trials.ssd_ms, 0.0, trials.ssd_ms))


def restored(trials):
    """Return one person's trials with restored delays."""
    return StopTrials.of(restored_delays(trials.to_trials()))


def test_delays_that_are_known_are_found_again():
    errors, missing = [], 0
    for seed in range(20):
        full = walked(seed)
        zeroed = unrecorded(full)
        rebuilt, known = restored_delays(zeroed.to_trials()), zeroed.ssd_ms != 0
        np.testing.assert_array_equal(rebuilt.ssd_s[known], full.to_trials().ssd_s[known])
        errors += list(np.abs(1000 * rebuilt.ssd_s - full.ssd_ms)[~known & full.stop] > 10)
        missing += int((~known).sum())
    assert missing > 60
    # Where both staircases explain what follows, either may be chosen.
    assert np.mean(errors) < 0.15


def test_the_shipped_delays_of_zero_contradict_no_staircase():
    with pytest.warns(DataWarning, match="268 of 274 stop trials with a delay of 0"):
        people = read_people()
    for trials in people.values():
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            rebuilt = restored(trials)
        new = rebuilt.ssd_ms[rebuilt.ssd_ms != trials.ssd_ms]
        new = new[~np.isnan(new)]
        # The search allows for contradictions; there are none.
        times = trials.rt_ms[(trials.ssd_ms == 0) & trials.responded]
        assert (new + 10 >= times).all()


def test_trials_without_missing_delays_are_returned_as_they_are():
    trials = StopTrials([400.0, np.nan, 300.0], [np.nan, 0.0, 3.0]).to_trials()
    with unwarned():
        assert restored_delays(trials).checksum == trials.checksum
    with refused("ssd must have stop-signal delays"):
        restored_delays(replace(trials, ssd_s=None))


def test_delays_that_are_no_staircase_are_warned_of():
    rng = np.random.default_rng(1)
    trials = walked(1)
    ssd = np.where(trials.stop, rng.permutation(DELAYS.repeat(20)[: len(trials.rt_ms)]), np.nan)
    ssd[np.flatnonzero(trials.stop & trials.responded)[:5]] = 0.0
    with pytest.warns(DataWarning, match="contradict two staircases"):
        restored(replace(trials, ssd_ms=ssd))
