"""Tables of decided trials: one row per trial, undecided ones named."""


def test_trial_table_names_undecided_trials(trials):
    undecided = trials["undecided"]
    assert 0 < undecided.sum() < len(trials)
    assert trials.loc[undecided, "rt"].isna().all()
    assert (trials.loc[undecided, "response"] == "").all()
    assert trials.loc[undecided, "correct"].isna().all()
    assert trials.loc[~undecided, "correct"].notna().all()
