"""Trials with known evidence: which readings count, and refusals."""

from dataclasses import replace

import numpy as np
import pytest

from bgmodel.fitting.known.trials import intervals
from circuits.errors import DataWarning
from tests.helpers import refusing
from tests.known_trials import few, simulated


def test_only_readings_before_the_response_are_seen():
    trials = simulated(50)
    before = (trials.time_s < trials.rt_s[:, None]).sum(axis=1)
    np.testing.assert_array_equal(trials.seen, before)
    assert (trials.seen < trials.lengths).any()


def test_an_interval_lasts_until_the_next_reading_even_if_it_comes_after_the_response():
    trials = few()
    early = replace(trials, rt_s=np.full(20, 0.25))
    starts, ends = intervals(early)
    np.testing.assert_allclose(starts, [[0.1, 0.2]] * 20)
    np.testing.assert_allclose(ends, [[0.2, 0.3]] * 20)
    np.testing.assert_allclose(intervals(trials)[1][:, -1], 0.4)


test_what_makes_no_sense_is_refused = refusing(
    (lambda: few(19), "trials"),
    (lambda: replace(few(), rt_s=np.full(20, 0.05)), "time"),
    (lambda: replace(few(), choice=np.zeros(20, int)), "response"),
    (lambda: replace(few(), choice=np.full(20, -1)), "rt"),
)


def test_some_responses_before_the_first_reading_warn():
    rt_s = np.where(np.arange(20) < 2, 0.05, 0.5)
    with pytest.warns(DataWarning):
        replace(few(), rt_s=rt_s)
