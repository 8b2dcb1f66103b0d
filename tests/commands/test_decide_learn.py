"""The command `learn`: threshold, dopamine and weights, of the test and of a circuit."""

import numpy as np
import pytest

from bgmodel import stream
from bgmodel.support.files import read_provenance, read_table
from tests.helpers import run

SHORT = ("--runs", 2, "--learner", "episodes=600")
FEW = ("--task", "trials=40", "t_max=10", "--levels", 4)
COURSE = ["run", "episode", "mean", "played", "reward", "dopamine"]


@pytest.mark.parametrize(
    ("asked", "circuit"),
    [
        (("--task", "period_mm=2"), None),
        (("--what", "dopamine", *FEW), "macaque"),
        (("--circuit", "macaque", "--task", "gaussian", "d_prime=1", *FEW[:3]), "macaque"),
    ],
    ids=["test", "dopamine", "circuit"],
)
def test_every_trial_of_a_run_is_written_with_what_it_was_made_with(
    asked, circuit, tmp_path, capsys
):
    out, picture = tmp_path / "learned.csv", tmp_path / "learned.png"
    assert run("learn", "--save", out, *asked, *SHORT, "--plot", picture) == 0
    printed = capsys.readouterr().out
    assert "regret" in printed
    table = read_table(out)
    assert list(table) == COURSE
    assert len(table) == 1200
    assert picture.stat().st_size > 5000
    about = read_provenance(out)["parameters"]
    assert len(about["summary"]["learned"]) == 2
    assert about.get("circuit", {}).get("name") == circuit
    assert "feedback" not in about["command"]
    assert about["command"]["task"]["name"] in ("same-different", "gaussian")


def test_weights_are_written_with_their_scores(tmp_path, capsys):
    out, picture = tmp_path / "weights.parquet", tmp_path / "weights.png"
    short = ("--runs", 2, "--learner", "trials=600", "--task", "t_max=20", "--seed", 3)
    assert run("learn", "--save", out, "--what", "weights", *short, "--plot", picture) == 0
    assert picture.stat().st_size > 5000
    assert "slope" in capsys.readouterr().out
    table = read_table(out)
    assert list(table) == ["run", "hypothesis", "unit", "weight"]
    assert len(table) == 2 * 2 * 16
    about = read_provenance(out)["parameters"]
    assert len(about["summary"]["learned"]) == 2
    assert "levels" not in about["command"]


def test_what_a_level_costs_is_measured_on_trials_that_were_not_learned_from(tmp_path, monkeypatch):
    """Tables: every second trial is kept; otherwise trials are redrawn. The noise is always new."""
    from bgmodel.learning import dopamine_learner as level

    seen, real = [], level.level_outcomes

    def watched(model, evidence, *arguments, **more):
        seen.append((model.seed, evidence))
        return real(model, evidence, *arguments, **more)

    monkeypatch.setattr("bgmodel.learning.dopamine_learner.level_outcomes", watched)
    rng = stream(1, "table")
    rows = [
        f"{n},{t},{x:.4f},0,{'ab'[n % 3 % 2]}"
        for n in range(20)
        for t, x in enumerate(rng.normal(0.5 - (n % 3 % 2), 1, 8))
    ]
    mine = tmp_path / "mine.csv"
    mine.write_text("\n".join(["trial,step,ll_a,ll_b,truth", *rows]))
    few = ("--what", "dopamine", "--levels", 4, "--runs", 1, "--learner", "episodes=600")
    for task in (("--task", mine), ("--task", "trials=40", "t_max=10")):
        seen.clear()
        assert run("learn", "--save", tmp_path / "out.csv", *task, *few, "--force") == 0
        (seed, learned), (other, scored) = seen
        assert seed != other
        assert learned.trials == scored.trials
        assert not np.array_equal(learned.log_likelihood, scored.log_likelihood)
