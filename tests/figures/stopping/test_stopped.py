"""Estimates recover the parameters of simulated participants of the stop-signal task."""

from dataclasses import replace

import numpy as np
import pytest

from bgmodel.fitting.stop_process import laid
from bgmodel.stopping.estimates import estimate_ssrt
from bgmodel.stopping.people import slowing_of
from figures.stopping.stopped import (
    StopValues,
    counted_ssrt,
    known_people,
    like,
    slopes,
)
from tests.helpers import unwarned

VALUES = StopValues(220.0, 0.0, 20.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def people():
    return known_people(3, 40, 300, 100, VALUES)


def test_integration_finds_the_ssrt_of_40_people_with_staircases(people):
    with unwarned():
        ssrt_ms = [estimate_ssrt(trials).ssrt_ms for trials in people.values()]
    assert np.mean(ssrt_ms) == pytest.approx(220, abs=15)
    counted = [counted_ssrt(trials) for trials in people.values()]
    np.testing.assert_allclose(ssrt_ms, counted)


def test_trigger_failures_and_the_mean_method_bias_the_estimate_upwards(people):
    lapsing = known_people(3, 40, 300, 100, replace(VALUES, failures=0.1))

    def mean(some, name):
        return np.mean([getattr(estimate_ssrt(each), name) for each in some.values()])

    assert mean(lapsing, "ssrt_ms") > mean(people, "ssrt_ms") + 5
    assert mean(people, "ssrt_mean_ms") > mean(people, "ssrt_ms") + 5


def test_shuffled_delays_have_no_inhibition_function(people):
    rng = np.random.default_rng(1)
    true, shuffled = slopes(people), slopes(people, rng)
    assert true.mean() > 10 * true.std() / np.sqrt(len(true))
    assert abs(shuffled.mean()) < 4 * shuffled.std() / np.sqrt(len(shuffled))


def test_people_like_others_have_their_go_times_and_slowing(people):
    slow = {
        who: replace(each, rt_ms=each.rt_ms + 40 * np.append(False, each.stop[:-1]))
        for who, each in people.items()
    }
    data = {who: laid(each.to_trials(), (40.0, 40.0)) for who, each in slow.items()}
    again = like(slow, data, VALUES, 5)
    assert list(again) == list(slow)
    for who in slow:
        assert (again[who].stop == slow[who].stop).all()
    table = slowing_of(again).set_index("measure")
    for name in ("after_failed_stop_ms", "after_successful_stop_ms"):
        assert abs(table.loc[name, "value"] - 40) < 4 * table.loc[name, "se"]
    means = [np.nanmean(some["0"].rt_ms[~some["0"].stop]) for some in (slow, again)]
    assert means[0] == pytest.approx(means[1], abs=25)
