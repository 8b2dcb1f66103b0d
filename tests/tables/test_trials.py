"""Tables of decided trials: one row per trial, undecided ones named, a user's columns beside."""

import numpy as np
import pandas as pd
import pytest

from bgmodel import Msprt, first_crossing
from bgmodel.tables.trials import Trials, trial_table
from tests.helpers import some_evidence


def test_trial_table_names_undecided_trials(decided_trials):
    undecided = decided_trials["undecided"]
    assert 0 < undecided.sum() < len(decided_trials)
    assert decided_trials.loc[undecided, "rt"].isna().all()
    assert (decided_trials.loc[undecided, "response"] == "").all()
    assert decided_trials.loc[undecided, "correct"].isna().all()
    assert decided_trials.loc[~undecided, "correct"].notna().all()


@pytest.mark.parametrize("condition", ["", "lesion"])
def test_a_users_condition_is_theirs_unless_one_is_given_and_other_results_are_ours(condition):
    own = pd.DataFrame(
        {
            "participant_id": ["p", "q", "r"],
            "trial": [7, 8, 9],
            "rt": [1.5, 2.5, 3.5],
            "condition": ["easy", "hard", "easy"],
            "block": [1, 1, 2],
        }
    )
    evidence = some_evidence(trials=3, steps=4)
    decision = first_crossing(Msprt().run(evidence), 0.1)
    found = trial_table(
        decision, Trials(evidence, list("abc"), own), model="m", condition=condition
    )
    for name in ("participant_id", "trial", "block"):
        assert found[name].tolist() == own[name].tolist()
    assert found["given_rt"].tolist() == own["rt"].tolist()
    np.testing.assert_array_equal(found["rt"], decision.time_ms / 1000)
    theirs = "given_condition" if condition else "condition"
    assert found[theirs].tolist() == own["condition"].tolist()
    assert (found["condition"] == (condition or own["condition"])).all()
    assert [name for name in found if name.startswith("given_")] == (
        ["given_rt", "given_condition"] if condition else ["given_rt"]
    )
