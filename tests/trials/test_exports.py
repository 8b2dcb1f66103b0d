"""Trial tables in the forms that PyDDM and HSSM read."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bgmodel import Msprt, first_crossing, stream
from bgmodel.simulated_evidence import separated_evidence
from bgmodel.tables.named import NamedEvidence, trial_table
from bgmodel.trials.exports import to_hssm, to_pyddm
from bgmodel.trials.reading import read_trials
from tests.helpers import refused


@pytest.fixture
def table():
    """Two conditions, some trials undecided."""
    parts = []
    for name, threshold in (("speed", 0.2), ("accuracy", 0.05)):
        evidence = separated_evidence(200, 12, 0.5, rng=stream(4, "exports"), step_ms=100.0)
        decision = first_crossing(Msprt().run(evidence), threshold, forced=False)
        trials = NamedEvidence(evidence, ["left", "right"])
        parts.append(trial_table(decision, trials, model="msprt", condition=name))
    return pd.concat(parts, ignore_index=True)


def test_pyddm_reads_the_table_as_it_is(table):
    """PyDDM's own recipe: every trial arrives, each in its condition, undecided ones as such."""
    pyddm = pytest.importorskip("pyddm")
    sample = pyddm.Sample.from_pandas_dataframe(to_pyddm(table), "rt", "choice")
    assert len(sample) == len(table)
    missed = table["undecided"]
    assert sample.undecided == missed.sum() > 0
    assert sample.prob("correct") == pytest.approx((table["correct"] == 1)[~missed].sum() / 400)
    for name, part in table.groupby("condition"):
        subset = sample.subset(condition=name)
        assert len(subset) == len(part)
        assert sorted(subset.choice_upper) == sorted(part["rt"][part["correct"] == 1])
    # What it is for: a model fitted to it gets a finite likelihood.
    model = pyddm.gddm(drift="v", noise=1, bound="b", parameters={"v": (-2, 2), "b": (0.5, 3)},
                       T_dur=1.5, dt=0.01)  # fmt: skip
    model.fit(sample, fitting_method="simplex", verbose=False)
    assert np.isfinite(model.get_fit_result().value())
    assert all(float(value) > 0 for value in model.get_model_parameters())


def test_a_named_response_is_the_upper_one(table):
    given = to_pyddm(table, upper="right")
    decided = ~table["undecided"]
    assert (given["choice"][decided] == (table["response"][decided] == "right")).all()
    assert given["choice"].isna().equals(table["undecided"])
    assert given["rt"].isna().equals(table["undecided"])


def test_hssm_gets_what_it_asks_for(table):
    """Rt in seconds and above 0, response -1 or 1, missing trials as rt -999."""
    given = to_hssm(table)
    assert list(given) == ["participant_id", "trial", "rt", "response", "condition"]
    assert set(given["response"]) == {-1, 1}
    missed = table["undecided"]
    assert (given["rt"][missed] == -999.0).all()
    assert given["rt"][~missed].equals(table["rt"][~missed])
    assert (given["rt"][~missed] > 0).all()
    assert (given["response"][~missed] == 2 * table["correct"][~missed] - 1).all()
    assert not given.isna().any(axis=None)
    right = to_hssm(table, upper="right")["response"][~missed]
    assert (right == np.where(table["response"][~missed] == "right", 1, -1)).all()


def test_a_table_that_was_read_back_as_text_gives_the_same(table, tmp_path):
    path = tmp_path / "t.csv"
    table.to_csv(path, index=False)
    for read in (pd.read_csv(path), pd.read_csv(path, dtype=str, keep_default_na=False)):
        given = to_pyddm(read.assign(rt=pd.to_numeric(read["rt"], errors="coerce")), upper="right")
        assert given["choice"].equals(to_pyddm(table, upper="right")["choice"])
        found = to_hssm(read.assign(rt=pd.to_numeric(read["rt"], errors="coerce")))
        assert found["response"].equals(to_hssm(table)["response"])
    numbers = table.assign(response=table["response"].map({"left": 0.0, "right": 1.0, "": np.nan}))
    named = to_pyddm(numbers.drop(columns="stimulus"), upper="1")["choice"]
    assert named.equals(to_pyddm(table, upper="right")["choice"])


def test_a_forced_choice_crossed_no_threshold(table):
    forced = table.assign(forced=~table["undecided"])
    assert to_pyddm(forced)["choice"].isna().all()
    assert (to_hssm(forced)["rt"] == -999.0).all()


def test_tables_that_cannot_be_told_are_refused(table):
    bad = {
        "columns has no rt": lambda: to_pyddm(table.drop(columns="rt")),
        "columns has no block": lambda: to_hssm(table, conditions=("block",)),
        "conditions other columns than response": lambda: to_hssm(table, conditions=("response",)),
        "undecided must hold True and False": lambda: to_hssm(table.assign(undecided="no")),
        "upper must be one of two responses .*, got 'up'": lambda: to_pyddm(table, upper="up"),
        "upper it is unknown what is correct": lambda: to_hssm(table.assign(correct=pd.NA)),
        "upper of two responses .*, got 'left'": lambda: to_hssm(
            table.assign(stimulus="up"), upper="left"
        ),
    }
    for says, call in bad.items():
        with refused(says):
            call()


@pytest.fixture
def choices():
    """Two people with two cues, some trials without a response."""
    rng = stream(5, "exports")
    response = rng.integers(0, 2, 80)
    table = pd.DataFrame(
        {
            "participant_id": np.repeat(["a", "b"], 40),
            "rt": rng.uniform(0.3, 0.9, 80),
            "response": response.astype(float),
            "coherence": rng.choice([-0.1, 0.2], 80),
            "cue": np.tile(["speed", "accuracy"], 40),
        }
    )
    table.loc[[3, 50], ["rt", "response"]] = np.nan
    return read_trials(table, strength="coherence", conditions=["cue"], deadline_s=1.0)


def test_choices_are_missing_trials_to_hssm_and_come_back_from_it(choices):
    given = to_hssm(choices)
    assert list(given) == ["participant_id", "trial", "rt", "response", "strength", "cue"]
    assert (given["rt"] == -999.0).to_numpy().nonzero()[0].tolist() == [3, 50]
    assert set(given["response"]) == {-1, 1}
    assert given["trial"].tolist() == [*range(40), *range(40)]
    assert not given.isna().any(axis=None)
    # HSSM's lower response is -1, that of a table of choices 0.
    back = given.assign(response=(given["response"] == 1).astype(int))
    same = read_trials(back, strength="strength", conditions=["cue"], deadline_s=1.0)
    assert same.checksum == choices.checksum


def test_choices_without_a_response_are_undecided_to_pyddm(choices):
    pyddm = pytest.importorskip("pyddm")
    given = to_pyddm(choices)
    assert list(given) == ["rt", "choice", "participant_id", "strength", "cue"]
    sample = pyddm.Sample.from_pandas_dataframe(given, "rt", "choice")
    assert len(sample) == 80
    assert sample.undecided == 2
    mine = (choices.participant == "a") & (choices.conditions["cue"] == "speed")
    part = sample.subset(participant_id="a", cue="speed")
    assert sorted(part.choice_upper) == sorted(choices.rt_s[mine & (choices.response == 1)])


def test_choices_of_one_participant_without_strength_have_no_such_columns(choices):
    one = replace(choices.where(choices.participant == "a"), strength=None)
    assert list(to_pyddm(one)) == ["rt", "choice", "cue"]
    assert list(to_hssm(one, conditions=())) == ["participant_id", "trial", "rt", "response"]


def test_conditions_of_choices_that_are_not_there_are_refused(choices):
    column = pd.DataFrame({"strength": choices.conditions["cue"]})
    bad = {
        "upper choices already define which response is 1": lambda: to_hssm(choices, upper="right"),
        "conditions must be among cue": lambda: to_pyddm(choices, conditions=["block"]),
        "conditions other columns than strength": lambda: to_hssm(
            replace(choices, conditions=column)
        ),
    }
    for says, call in bad.items():
        with refused(says):
            call()
