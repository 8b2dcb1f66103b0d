"""The command `circuit learn`."""

from types import SimpleNamespace

import numpy as np
import pytest

from bgmodel import Evidence, stream
from bgmodel.cli import main
from bgmodel.commands.dopamine import CircuitLearn
from bgmodel.support.files import read_table
from bgmodel.tables.evidence import EvidenceTable
from bgmodel.tables.trials import Trials
from tests.helpers import run


def test_the_command_learns_and_says_what_it_did(tmp_path, capsys):
    path = tmp_path / "dopamine.csv"
    small = ["--trials", "40", "--t-max", "10", "--levels", "4", "--runs", "2"]
    assert main(["circuit", "learn", str(path), *small, "--learner.episodes", "600"]) == 0
    said = capsys.readouterr().out
    assert "learned level" in said
    assert "best of 4 on fresh trials" in said
    table = read_table(path)
    assert list(table) == ["run", "episode", "tonic", "level", "reward", "phasic"]
    assert len(table) == 1200


def test_memory_is_asked_for_what_is_kept_of_each_trial_at_each_level(tmp_path, monkeypatch):
    """Choice, time and posterior: three numbers of eight bytes, for 16 levels of 4000 trials."""
    asked = []
    monkeypatch.setattr(
        "bgmodel.commands.dopamine.check_memory", lambda needed, what: asked.append(needed)
    )
    assert run("circuit", "learn", tmp_path / "a.csv", "--levels", 1) == 2
    assert run("circuit", "learn", tmp_path / "a.csv", "--start-level", 3) == 2
    assert asked == [3 * 8 * 4000, 3 * 8 * 16 * 4000]


def test_levels_are_those_of_the_circuit_that_is_named(tmp_path, refusal):
    asked = ["circuit", "learn", str(tmp_path / "a.csv"), "--trials", "40", "--start-level", "3"]
    for given, said in (
        ([], "where macaque decides by evidence, 0.692..2.000, got 3"),
        (["--circuit", "spiking_msprt"], "where spiking_msprt decides by evidence, 0.837..1.696,"),
    ):
        assert f"start_level must lie {said}" in refusal(*asked, *given)


def test_what_a_level_costs_is_measured_on_trials_that_were_not_learned_from(tmp_path, monkeypatch):
    """Tables: every second trial is kept; otherwise trials are redrawn. The noise is always new."""
    from bgmodel.learning import dopamine_learner as level

    seen, real = [], level.level_outcomes

    def watched(model, evidence, *given):
        seen.append((model.seed, evidence))
        return real(model, evidence, *given)

    monkeypatch.setattr("bgmodel.learning.dopamine_learner.level_outcomes", watched)
    rng = stream(1, "table")
    rows = [
        f"{n},{t},{x:.4f},0,{'ab'[n % 3 % 2]}"
        for n in range(20)
        for t, x in enumerate(rng.normal(0.5 - (n % 3 % 2), 1, 8))
    ]
    mine = tmp_path / "mine.csv"
    mine.write_text("\n".join(["trial,step,ll_a,ll_b,truth", *rows]))
    few = ["--levels", "4", "--runs", "1", "--learner.episodes", "600"]
    for given in (["--evidence", str(mine)], ["--trials", "40", "--t-max", "10"]):
        seen.clear()
        path = str(tmp_path / "out.csv")
        assert main(["circuit", "learn", path, *given, *few, "--force"]) == 0
        (seed, learned), (other, scored) = seen
        assert seed != other
        assert learned.trials == scored.trials
        assert not np.array_equal(learned.log_likelihood, scored.log_likelihood)


@pytest.mark.parametrize("order", ["in turn", "in blocks", "at random"])
def test_both_halves_of_a_table_have_the_same_truths(order):
    truth = np.arange(60) % 2
    truth = {"in turn": truth, "in blocks": np.sort(truth)}.get(order, stream(2).permutation(truth))
    values = stream(1).normal(size=(60, 2, 2))
    task = SimpleNamespace(condition=SimpleNamespace(task=EvidenceTable("mine.csv")))
    given = Trials(Evidence(values, truth), ["a", "b"])
    halves = CircuitLearn._learned_and_scored(task, given)
    assert [np.bincount(each.truth).tolist() for each in halves] == [[15, 15]] * 2
    found = np.concatenate([each.log_likelihood for each in halves])
    assert {each.tobytes() for each in found} == {each.tobytes() for each in values}
