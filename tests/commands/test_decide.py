"""The command `decide`."""

import json

import numpy as np
import pytest

from bgmodel import stream
from bgmodel.learning import dopamine_learner
from bgmodel.support.files import read_provenance, read_table
from tests.helpers import run, words


def test_decide_is_accurate_on_gratings_and_the_same_for_a_seed(tmp_path, capsys):
    out, again = tmp_path / "decisions.csv", tmp_path / "again.csv"
    asked = words("decide --task period_mm=2 trials=400 --boundary-separation 4 --seed 3 --save")
    assert run(*asked, out) == 0
    assert set(read_table(out)["response"]) == {"S1", "S2"}
    assert read_provenance(out)["seed"] == 3
    assert "400 trials, accuracy 0.9" in capsys.readouterr().out
    assert run(*asked, again) == 0
    assert out.read_bytes() == again.read_bytes()


ALGEBRA = ("--engine", "algebra", "--circuit", "bogacz_gurney", "--gain", 1)


def test_times_and_prior_of_a_table_are_those_that_were_said(tmp_path):
    mine = tmp_path / "mine.csv"
    rows = [f"{n},{t},{-0.1 * (n + 1)},0" for n in range(4) for t in range(5)]
    mine.write_text("\n".join(["trial,step,ll_a,ll_b", *rows]))
    z = 0.1 * np.arange(1, 5)[:, None] * np.arange(1, 6)
    task = ("--task", mine, "--boundary-separation", 1)
    for prior, start in (((), 0.0), (("--prior", 0.45, 0.55), np.log(0.55 / 0.45))):
        out = tmp_path / f"out{len(prior)}.csv"
        assert run("decide", "--save", out, *task, *prior, "--task", "step_ms=20") == 0
        met = z + start >= 0.5 - 1e-10
        reading = np.where(met.any(axis=1), met.argmax(axis=1) + 1, 5)
        decisions = read_table(out)
        assert decisions["rt"].to_numpy() == pytest.approx(0.02 * reading)
        assert (decisions["forced"] == ~met.any(axis=1)).all()
    out = tmp_path / "circuit.csv"
    assert run("circuit", "run", "--save", out, *task[:2], *ALGEBRA, "--task", "step_ms=20") == 0
    assert set(read_table(out)["rt"].round(6)) <= {0.02 * k for k in range(1, 7)}


def test_where_no_criterion_is_given_it_is_a_gap_of_4_or_a_posterior_of_82_in_100(tmp_path):
    few = ("--task", "trials=40", "t_max=6", "--force")
    out = tmp_path / "out.csv"
    for command, level in (
        (("decide",), ("--boundary-separation", 4)),
        (("circuit", "run", *ALGEBRA), ("--posterior", 0.82)),
    ):
        assert run(*command, "--save", out, *few) == 0
        left_out = out.read_bytes(), read_provenance(out)
        drawing = tmp_path / f"{command[0]}.svg"
        assert run(*command, "--save", out, *few, *level, "--plot", drawing) == 0
        assert "Decision time from the onset of evidence" in drawing.read_text()
        assert (out.read_bytes(), read_provenance(out)) == left_out


def test_what_had_no_say_in_a_decision_is_not_recorded(tmp_path):
    out = tmp_path / "out.csv"
    few = ("decide", "--save", out, "--task", "trials=4", "t_max=3", "--force")
    may_be_idle = {"boundary_separation", "posterior", "channels", "evidence", "d_prime"}
    for task, asked, had in (
        ("same-different", (), {"boundary_separation"}),
        ("same-different", ("--posterior", 0.9), {"posterior"}),
        ("orientation", ("--posterior", 0.9), {"posterior", "channels"}),
    ):
        assert run(*few, *asked, "--task", task) == 0
        command = read_provenance(out)["parameters"]["command"]
        assert (set(command) | set(command["task"])) & may_be_idle == had


def test_decide_says_what_it_forced(tmp_path, capsys):
    out = tmp_path / "out.csv"
    options = words("--task trials=40 t_max=2 --boundary-separation 16 --task period_mm=1.5")
    with pytest.warns(UserWarning, match="trials never meet the threshold"):
        assert run("decide", "--save", out, *options) == 0
    forced = int(read_table(out)["forced"].sum())
    assert f"forced {forced}, undecided 0" in capsys.readouterr().out
    with pytest.warns(UserWarning, match="they stay undecided"):
        assert run("decide", "--save", out, *options, "--no-forced", "--force") == 0
    assert f"forced 0, undecided {forced}" in capsys.readouterr().out


def test_json_of_decide_holds_every_trial(tmp_path, capsys):
    out = tmp_path / "out.csv"
    asked = words("--task trials=40 t_max=2 --boundary-separation 16 --json")
    assert run("decide", "--save", out, *asked) == 0
    printed, table = json.loads(capsys.readouterr().out), read_table(out)
    assert printed["forced"] == table["forced"].sum()
    assert printed["accuracy"] == pytest.approx(table["correct"].mean())
    assert [row["response"] for row in printed["records"]] == table["response"].tolist()
    mine = tmp_path / "mine.csv"
    mine.write_text("trial,step,ll_a,ll_b\n0,0,1,0\n1,0,0,2\n")
    options = ("--task", mine, "--posterior", 0.6, "--json", "--force")
    assert run("decide", "--save", out, *options) == 0
    told = capsys.readouterr()
    assert json.loads(told.out)["accuracy"] is None
    assert "read 2 trials" in told.err


SHORT = ("--runs", 2, "--learner", "episodes=600")
FEW = ("--task", "trials=100", "t_max=10", "--levels", 4)
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
    assert "regret" in capsys.readouterr().out
    table = read_table(out)
    assert list(table) == COURSE
    assert len(table) == 1200
    assert picture.stat().st_size > 5000
    about = read_provenance(out)["parameters"]
    assert len(about["summary"]["learned"]) == 2
    assert about.get("circuit", {}).get("name") == circuit
    assert "rule" not in about["command"]
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
    seen, real = [], dopamine_learner.level_outcomes

    def watched(model, evidence, *arguments, **more):
        seen.append((model.seed, evidence))
        return real(model, evidence, *arguments, **more)

    monkeypatch.setattr(dopamine_learner, "level_outcomes", watched)
    rng = stream(1, "table")
    read = [(n, n % 3 % 2, rng.normal(0.5 - (n % 3 % 2), 1, 8)) for n in range(100)]
    rows = [f"{n},{t},{x:.4f},0,{'ab'[side]}" for n, side, xs in read for t, x in enumerate(xs)]
    mine = tmp_path / "mine.csv"
    mine.write_text("\n".join(["trial,step,ll_a,ll_b,truth", *rows]))
    few = ("--what", "dopamine", "--levels", 4, "--runs", 1, "--learner", "episodes=600")
    for task in (("--task", mine), ("--task", "trials=100", "t_max=10")):
        seen.clear()
        assert run("learn", "--save", tmp_path / "out.csv", *task, *few, "--force") == 0
        (seed, learned), (other, scored) = seen
        assert seed != other
        assert learned.trials == scored.trials
        assert not np.array_equal(learned.log_likelihood, scored.log_likelihood)
