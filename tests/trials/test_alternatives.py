"""Tables of choices between more than two alternatives."""

import numpy as np
import pandas as pd
import pytest

from bgmodel.trials.reader import Columns, read_trials
from circuits.errors import DataWarning
from tests.helpers import refused, refusing, unwarned
from tests.read import read

NAMES = np.array(["up", "left", "down", "right"])


def table(alternatives=3, trials=60, **columns):
    """Return trials of which two in three are correct, with all names as stimuli and responses."""
    shown = np.arange(trials) % alternatives
    answer = np.where(np.arange(trials) // alternatives % 3, shown, (shown + 1) % alternatives)
    rt = np.random.default_rng(3).gamma(4, 0.1, trials) + 0.2
    choices = pd.DataFrame({"rt": rt, "response": NAMES[answer], "shown": NAMES[shown]})
    return choices.assign(**columns)


def coded(**columns):
    named = table()
    return named.assign(response=(named["response"] == named["shown"]).astype(int), **columns)


def test_responses_are_coded_by_the_column_of_correct_ones():
    some = table(4)
    with unwarned():
        trials = read_trials(some, columns=Columns(stimulus="shown"))
    assert trials.alternatives == 4
    assert np.array_equal(trials.response == 1, some["response"] == some["shown"])
    assert np.nanmean(trials.correct) == np.mean(trials.response)


def test_the_number_is_given_held_by_a_column_or_two():
    plain = coded().drop(columns="shown")
    assert read_trials(plain, columns=Columns(alternatives=5)).alternatives == 5
    assert read_trials(plain.assign(alternatives=4)).alternatives == 4
    assert read_trials(table(), columns=Columns(stimulus="shown", alternatives=3)).alternatives == 3
    assert read_trials(plain).alternatives == 2


def test_missing_responses_are_neither_correct_nor_a_name():
    some = table()
    some.loc[:2, ["rt", "response"]] = np.nan
    trials = read_trials(some, columns=Columns(stimulus="shown", deadline_s=3.0))
    assert (trials.response[:3] == -1).all()
    assert trials.alternatives == 3


test_what_is_wrong_is_named = pytest.mark.filterwarnings("ignore")(
    refusing(
        (lambda: read(table()), "response"),
        (lambda: read(table(), stimulus="side"), "side"),
        (lambda: read(table(), stimulus="shown", alternatives=2), "response at most 2"),
        (lambda: read(table(), stimulus="shown", alternatives=4), "response only"),
        (lambda: read(table(), stimulus="shown", upper="up"), "upper"),
        (lambda: read(table(shown="back"), stimulus="shown"), "response and back"),
        *((lambda n=n: read(coded(), alternatives=n), "alternatives") for n in (13, 1, 2.5)),
        (lambda: read(coded(alternatives=[3, 4] * 30)), "alternatives 3 and 4"),
        (lambda: read(coded(alternatives=4), alternatives=3), "alternatives"),
        *((lambda n=n: read(coded(alternatives=n)), "alternatives") for n in ("many", 20)),
        (lambda: read(coded().assign(response=1), alternatives=3), "response"),
        (lambda: read(coded(x=[-0.1, 0.1] * 30), alternatives=3, strength="x"), "strength"),
    )
)


def test_a_stimulus_of_another_accuracy_is_warned_of():
    some = table(trials=600)
    easy = some["shown"] == "up"
    some.loc[easy, "response"] = "up"
    some.loc[some.index[easy][:5], "response"] = "left"
    with pytest.warns(DataWarning, match="treat all of them alike"):
        read_trials(some, columns=Columns(stimulus="shown"))


def test_a_response_that_is_never_correct_is_doubted():
    some = table()
    some.loc[some.index[::10], "response"] = "timeout"
    with pytest.warns(DataWarning, match="'timeout' is never correct, and counts as one of 4"):
        assert read_trials(some, columns=Columns(stimulus="shown")).alternatives == 4
    words = {"response": some["response"].str.upper()}
    with refused("response same words"):
        read_trials(some.assign(**words), columns=Columns(stimulus="shown"))
