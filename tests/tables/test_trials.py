"""Tables of decided trials: one row per trial, undecided ones named."""


def test_trial_table_names_undecided_trials(decided_trials):
    undecided = decided_trials["undecided"]
    assert 0 < undecided.sum() < len(decided_trials)
    assert decided_trials.loc[undecided, "rt"].isna().all()
    assert (decided_trials.loc[undecided, "response"] == "").all()
    assert decided_trials.loc[undecided, "correct"].isna().all()
    assert decided_trials.loc[~undecided, "correct"].notna().all()
