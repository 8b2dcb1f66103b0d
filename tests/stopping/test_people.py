"""Stop-signal trials of people: the set that ships, estimates computed twice, and bad tables."""

import numpy as np
import pytest

import bgmodel as bg
from bgmodel.stopping.people import (
    estimates_of,
    read_people,
    slowing,
    slowing_of,
    violations,
    violations_of,
)
from bgmodel.stopping.trials import StopTrials, drawn_delays
from circuits.errors import DataWarning
from tests import stop_trials
from tests.helpers import refused, unwarned
from tests.read import ROWS, silent, table_of


@pytest.fixture(scope="module")
def people():
    return read_people()


@pytest.fixture(scope="module")
def table(people):
    with pytest.warns(DataWarning, match="126 of 126|125 of 126"):
        return estimates_of(people)


def by_hand(trials):
    """Return the SSRT by sorting and counting, as the guide words it."""
    go = sorted(1e9 if np.isnan(t) else t for t in trials.rt_ms[~trials.stop])
    slowest = max(t for t in go if t < 1e9)
    go = [min(t, slowest) for t in go]
    stop = trials.rt_ms[trials.stop]
    p = sum(~np.isnan(stop)) / len(stop)
    n = int(np.ceil(round(p * len(go), 9)))
    return go[n - 1] - trials.ssd_ms[trials.stop].mean()


def test_the_set_has_its_published_size(people):
    assert len(people) == 126
    assert sum(len(each.rt_ms) for each in people.values()) == 126 * 128
    assert {int(each.stop.sum()) for each in people.values()} == {32}


def test_each_estimate_is_that_of_an_independent_computation(people, table):
    known = table[table["ssrt_ms"].notna()].set_index("participant_id")
    assert len(known) == 125  # one person has no response in any go trial
    for who, row in known.iterrows():
        assert row["ssrt_ms"] == pytest.approx(by_hand(people[who]), abs=1e-6)


def test_the_mean_is_what_published_estimators_give(table):
    assert table["ssrt_ms"].mean() == pytest.approx(224, abs=1)
    assert table["ssrt_ms"].std() == pytest.approx(69, abs=1)
    assert table["go_ms"].mean() == pytest.approx(488, abs=1)
    assert table["failed_ms"].mean() == pytest.approx(430, abs=1)
    assert table["ssd_ms"].mean() == pytest.approx(257, abs=1)


def test_the_guide_refuses_three_people(table):
    refusals = table.loc[table["refusal"] != "", "refusal"].str.split().str[0].tolist()
    assert sorted(refusals) == ["failed", "no", "the"]


def test_a_table_needs_stop_signals():
    with refused("ssd must have stop-signal delays"):
        read_people(table_of("choices"))


def test_words_of_stimulus_and_response_are_compared_whatever_their_type():
    words = np.resize(["left", "right"], ROWS)
    table = silent(table_of("stop signals", stimulus=words, response=words), range(2, ROWS, 6))
    for change in ({}, {"stimulus": "category", "response": "category"}):
        for trials in read_people(table.astype(change)).values():
            np.testing.assert_array_equal(trials.correct, trials.responded)
    with pytest.warns(DataWarning, match="0% of responses are correct"):
        read_people(table.assign(stimulus=table["stimulus"].str.upper()))


def test_restoring_delays_hides_no_other_doubt_about_a_table():
    """It silences what it restores; delays in another unit are for the user to see."""
    restore = bg.Columns(restore_delays=True)
    seconds = stop_trials.table_of().assign(ssd=lambda t: t["ssd"] / 1000)
    with pytest.warns(DataWarning, match="in ms, not in seconds"):
        read_people(seconds, columns=restore)
    with unwarned():
        read_people(stop_trials.table_of(), columns=restore)


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


def test_go_responses_that_become_slower_are_told_in_three_people_of_the_set(people):
    with pytest.warns(DataWarning) as caught:
        estimates_of(people)
    (text,) = [str(each.message) for each in caught if "trial to trial" in str(each.message)]
    assert text.startswith("3 of 126 participants have a trend in their go times: in sub-")
