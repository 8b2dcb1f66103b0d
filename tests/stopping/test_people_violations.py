"""Violations of independence are zero in a race and found where they are put; slowing by hand."""

import numpy as np
import pytest

from bgmodel.stopping.people import (
    slowing,
    slowing_of,
    violations,
    violations_of,
)
from bgmodel.stopping.trials import StopTrials, drawn_delays

SSRT_MS = 220.0
DELAYS = [150.0, 200.0, 250.0, 300.0]


def raced(seed, trials=400, later_ms=0.0):
    """Return an independent race whose failed stops are `later_ms` later than they should be."""
    rng = np.random.default_rng(seed)
    times = 380 + rng.gamma(2.0, 50.0, trials)
    ssd = drawn_delays(trials, DELAYS, 0.4, rng)
    times[times > np.nan_to_num(ssd + SSRT_MS, nan=np.inf)] = np.nan
    return StopTrials(times + later_ms * ~np.isnan(ssd), ssd)


@pytest.mark.parametrize("later_ms", [0.0, 30.0])
def test_violations_are_what_was_added_to_an_independent_race(later_ms):
    table = violations(raced(1, 100_000, later_ms), SSRT_MS)
    assert table["ssd_ms"].tolist() == DELAYS
    # At 150 ms all go times are above the limit: no failed stop, so nothing to compare.
    assert table["violation_ms"].iloc[1:].to_numpy() == pytest.approx(later_ms, abs=1.5)
    assert np.isnan(table["violation_ms"].iloc[0])
    assert table["failed"].iloc[0] == 0


def test_violations_over_people_are_means_with_standard_errors():
    # The guide accepts estimates of all: more trials at delays that half of them fail.
    people = {str(seed): raced(seed, 600) for seed in range(30)}
    table = violations_of(people).set_index("ssd_ms")
    late = table.loc[[250.0, 300.0]]
    assert (late["people"] > 20).all()
    assert (late["violation_ms"].abs() < 4 * late["violation_se_ms"]).all()
    assert (late["violation_se_ms"] < 10).all()


def test_failed_stops_that_no_race_explains_are_counted():
    trials = StopTrials([400.0, 500.0, 450.0, 420.0], [np.nan, np.nan, 0.0, 300.0])
    table = violations(trials, 200.0)
    assert table["impossible"].tolist() == [1, 0]
    assert table["violation_ms"].tolist()[1] == 420.0 - 450.0


def test_slowing_compares_go_responses_by_the_trial_before():
    #        go   stop   go  stop   go    go   missed  go
    rt = [400.0, 350.0, 470, np.nan, 460, 410, np.nan, 600]
    ssd = [np.nan, 200.0, np.nan, 200.0, np.nan, np.nan, np.nan, np.nan]
    slowed_ms = slowing(StopTrials(rt, ssd))
    # After a go response: only 410. After the omission, 600 counts nowhere.
    assert slowed_ms == {
        "after_go_ms": 410.0,
        "after_failed_stop_ms": 60.0,
        "after_successful_stop_ms": 50.0,
    }


def test_a_delay_belongs_to_the_nearest_centre_and_half_way_to_the_later():
    ssd = np.array([np.nan, 126.0, 174.0, 175.0, 224.0, 226.0])
    table = violations(StopTrials([300.0, *[np.nan] * 5], ssd), SSRT_MS)
    assert table["ssd_ms"].tolist() == [150.0, 200.0, 250.0]
    assert table["trials"].tolist() == [2, 2, 1]


def test_slowing_over_people_leaves_out_those_without_such_trials():
    one = StopTrials([400.0, 350.0, 470.0, 410.0], [np.nan, 200.0, np.nan, np.nan])
    table = slowing_of({"a": one, "b": one}).set_index("measure")
    assert table.loc["after_failed_stop_ms", ["value", "se", "people"]].tolist() == [60, 0, 2]
    assert table.loc["after_successful_stop_ms", "people"] == 0
