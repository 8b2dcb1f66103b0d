"""Stop-signal trials of people: the set that ships, estimates computed twice, and bad tables."""

import numpy as np
import pandas as pd
import pytest

import bgmodel as bg
from bgmodel.stopping.people import estimates_of, read_people
from circuits.errors import DataWarning
from tests.helpers import refused, unwarned
from tests.stop_trials import table_of


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


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            lambda t: t.drop(columns="ssd").assign(rt=[0.4, 0.5, 0.6] * 4, response=[0, 1, 1] * 4),
            "ssd must have stop-signal delays",
        ),
        (lambda t: t.assign(rt=1000 * t["rt"]), "rt seconds"),
        (lambda t: t.assign(ssd=[np.nan, np.nan, 250.0] * 4), "ssd seconds"),
        (lambda t: t.assign(ssd=-0.1), "ssd 0 s or more, got .-0.1. in row 0"),
        (lambda t: t.assign(correct="true"), "correct must be 0 or 1 in every trial, got 'true'"),
        (lambda t: t.assign(ssd=0.2), "ssd must be empty in some trials of a"),
    ],
)
def test_a_bad_table_is_refused_by_participant(change, says):
    good = pd.DataFrame({"participant_id": "a", "rt": [0.4, 0.5, np.nan] * 4, "ssd": [np.nan] * 12})
    assert list(read_people(good)) == ["a"]
    with refused(says):
        read_people(change(good))


def stops(**changes):
    """Return 12 trials of each of two people with a stop signal in every third."""
    rt = np.tile([0.41, 0.523, np.nan, 0.456, 0.397, 0.61], 4)
    ssd = np.tile([np.nan, np.nan, 0.2, np.nan, np.nan, 0.25], 4)
    jitter = np.arange(24) / 1000
    table = pd.DataFrame(
        {"participant_id": np.repeat(["1", "2"], 12), "rt": rt + jitter, "ssd": ssd}
    )
    return table.assign(**changes)


def test_words_of_stimulus_and_response_are_compared_whatever_their_type(tmp_path):
    words = np.where(np.arange(24) % 2, "left", "right")
    table = stops(stimulus=words, response=words)
    kept = table["rt"].notna()
    table["response"] = table["response"].where(kept)
    for change in ({}, {"stimulus": "category", "response": "category"}):
        for trials in read_people(table.astype(change)).values():
            np.testing.assert_array_equal(trials.correct, trials.responded)
    with pytest.warns(DataWarning, match="0% of responses are correct"):
        read_people(table.assign(stimulus=table["stimulus"].str.upper()))


def test_restoring_delays_hides_no_other_doubt_about_a_table():
    """It silences what it restores; delays in another unit are for the user to see."""
    restore = bg.Columns(restore_delays=True)
    seconds = table_of().assign(ssd=lambda t: t["ssd"] / 1000)
    with pytest.warns(DataWarning, match="in ms, not in seconds"):
        read_people(seconds, columns=restore)
    with unwarned():
        read_people(table_of(), columns=restore)


def test_go_responses_that_become_slower_are_told_in_three_people_of_the_set(people):
    with pytest.warns(DataWarning) as caught:
        estimates_of(people)
    (text,) = [str(each.message) for each in caught if "trial to trial" in str(each.message)]
    assert text.startswith("3 of 126 participants, such as sub-")
