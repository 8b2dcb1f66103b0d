"""Tables of decided trials: one row per trial, undecided ones marked, a user's columns kept."""

import numpy as np
import pandas as pd
import pytest

from bgmodel import Msprt, first_crossing
from bgmodel.evidence import Evidence
from bgmodel.trials.named_evidence import NamedEvidence, trial_table
from tests.helpers import refused, some_evidence


@pytest.mark.parametrize("condition", ["", "lesion"])
def test_a_users_columns_stay_and_those_that_a_result_replaces_are_called_given(condition):
    columns = pd.DataFrame({"participant_id": list("pqr"), "trial": [7, 8, 9], "block": [1, 1, 2]})
    columns = columns.assign(rt=[1.5, 2.5, 3.5], condition=["easy", "hard", "easy"])
    evidence = some_evidence(trials=3, steps=4)
    decision = first_crossing(Msprt().run(evidence), 0.1)
    named = NamedEvidence(evidence, list("abc"), columns)
    table = trial_table(decision, named, model="m", condition=condition)
    for name in ("participant_id", "trial", "block"):
        assert table[name].tolist() == columns[name].tolist()
    assert table["given_rt"].tolist() == columns["rt"].tolist()
    np.testing.assert_array_equal(table["rt"], decision.time_ms / 1000)
    theirs = "given_condition" if condition else "condition"
    assert table[theirs].tolist() == columns["condition"].tolist()
    assert (table["condition"] == (condition or columns["condition"])).all()
    assert ("given_condition" in table) == bool(condition)


@pytest.mark.parametrize("known", [True, False])
def test_a_choice_is_correct_if_it_is_the_truth_and_unknown_without_a_truth(known):
    drawn = some_evidence(trials=60, steps=4)
    evidence = drawn if known else Evidence(drawn.log_likelihood)
    decision = first_crossing(Msprt().run(evidence), 0.3)
    table = trial_table(decision, NamedEvidence(evidence, list("abc")), model="m")
    assert table["response"].tolist() == ["abc"[choice] for choice in decision.choice]
    assert not table["undecided"].any()
    if known:
        assert table["stimulus"].tolist() == list("abc") * 20
        assert 0 < table["correct"].sum() < 60
        assert ((table["response"] == table["stimulus"]) == (table["correct"] == 1)).all()
    else:
        assert set(table["stimulus"]) == {""}
        assert table["correct"].isna().all()


def test_a_table_of_trials_holds_one_threshold():
    evidence = some_evidence(trials=3, steps=4)
    decision = first_crossing(Msprt().run(evidence), [0.1, 0.2])
    with refused("decision"):
        trial_table(decision, NamedEvidence(evidence, list("abc")), model="m")
