"""Tables carry their provenance, are whole or absent, and say what is wrong with a user's own."""

import numpy as np
import pandas as pd
import pytest

from bgmodel import Msprt, first_crossing
from bgmodel.evidence import gaussian_evidence
from bgmodel.files import read_provenance, read_table, write_table
from bgmodel.seeds import stream
from bgmodel.tables import evidence_from_table, trial_table


@pytest.fixture
def trials():
    evidence = gaussian_evidence(20, 5, 1.0, rng=stream(1, "tables"), hypotheses=3)
    decision = first_crossing(Msprt().run(evidence), 0.05, forced=False)
    return trial_table(decision, evidence, model="msprt", seed=1)


@pytest.mark.parametrize("ending", ["parquet", "csv"])
def test_round_trip_with_provenance(tmp_path, trials, ending):
    path = write_table(trials, tmp_path / f"t.{ending}", seed=1, delta=np.float64(2), gaps=(1, 2))
    about = read_provenance(path)
    assert about["seed"] == 1
    assert about["parameters"] == {"delta": 2.0, "gaps": [1, 2]}
    assert {"bgmodel", "numpy", "python"} <= set(about["versions"])
    back = read_table(path)
    assert back["rt"].equals(trials["rt"])
    first = path.read_bytes()
    write_table(trials, path, seed=1, delta=np.float64(2), gaps=(1, 2))
    assert path.read_bytes() == first
    assert not list(tmp_path.glob(".*"))


def test_a_failed_write_leaves_the_old_file(tmp_path, trials, monkeypatch):
    path = write_table(trials, tmp_path / "t.parquet")
    before = path.read_bytes()
    monkeypatch.setattr("pyarrow.parquet.write_table", lambda *a, **k: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write_table(trials.head(1), path)
    assert path.read_bytes() == before


def test_trial_table_names_undecided_trials(trials):
    undecided = trials["undecided"]
    assert 0 < undecided.sum() < len(trials)
    assert trials.loc[undecided, "rt"].isna().all()
    assert (trials.loc[undecided, "response"] == "").all()
    assert (trials.loc[undecided, "correct"] == 0).all()


def long_table(evidence, truth=True):
    n, t, h = evidence.log_likelihood.shape
    frame = pd.DataFrame(
        evidence.log_likelihood.reshape(n * t, h), columns=[f"ll_{i}" for i in "abc"[:h]]
    )
    frame.insert(0, "trial", np.repeat(np.arange(n), t))
    frame.insert(1, "step", np.tile(np.arange(t), n))
    if truth:
        frame["truth"] = np.repeat(np.array(list("abc"))[evidence.truth], t)
    return frame


def test_a_users_table_gives_back_the_evidence():
    evidence = gaussian_evidence(7, 4, 1.0, rng=stream(1, "tables"), hypotheses=3)
    shuffled = long_table(evidence).sample(frac=1, random_state=3)
    back, names = evidence_from_table(shuffled)
    assert names == ["a", "b", "c"]
    assert np.array_equal(back.log_likelihood, evidence.log_likelihood)
    assert np.array_equal(back.truth, evidence.truth)
    blind, _ = evidence_from_table(long_table(evidence, truth=False))
    assert blind.truth is None
    decided = trial_table(first_crossing(Msprt().run(blind), 0.1), blind, model="msprt")
    assert decided["correct"].isna().all()


def test_bad_tables_get_one_clear_sentence(tmp_path):
    evidence = gaussian_evidence(7, 4, 1.0, rng=stream(1, "tables"))
    good = long_table(evidence)
    bad = {
        "needs the columns trial, step": good.drop(columns="step"),
        "at least two ll_": good.drop(columns="ll_a"),
        "at least one trial": good.head(0),
        "trial 0 has step 0 twice": pd.concat([good, good.head(1)]),
        "cut them, or fill up": good.iloc[1:],
        "ll_a must be a finite number, got abc at trial 0, step 1": good.astype(
            {"ll_a": object}
        ).assign(ll_a=lambda t: t["ll_a"].where(t.index != 1, "abc")),
        r"ll_b must be .* got nan at trial 0, step 0 \(28 such": good.assign(ll_b=np.nan),
        "same number of readings": good.iloc[:-1],
        "truth must be one of": good.assign(truth="z"),
    }
    for says, table in bad.items():
        with pytest.raises(ValueError, match=says):
            evidence_from_table(table)
    with pytest.raises(ValueError, match="there is no table"):
        read_table(tmp_path / "absent.csv")
    (tmp_path / "cut.parquet").write_bytes(b"PAR1 and no more")
    with pytest.raises(ValueError, match="can't be read as"):
        read_table(tmp_path / "cut.parquet")
    with pytest.raises(ValueError, match=r"\.parquet or \.csv"):
        write_table(good, tmp_path / "t.xlsx")
    (tmp_path / "file").write_text("")
    with pytest.raises(ValueError, match="output folder"):
        write_table(good, tmp_path / "file" / "t.csv")
