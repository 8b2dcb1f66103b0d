"""Circuits whose unit is not nats: laws and commands that need nats are rejected."""

import numpy as np
import pandas as pd
import pytest

from bgmodel import stream
from bgmodel.cli import main
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.decoder import decoded_input
from bgmodel.integrators.steady import out_shift
from bgmodel.learning import dopamine
from bgmodel.simulated_evidence import separated_evidence
from circuits import anatomy
from circuits.activity import total_nats
from circuits.laws.controls import correlated, linear_stn
from circuits.laws.stability import onset


def test_what_needs_nats_is_refused_without_them():
    circuit = anatomy.gpr()
    for refused in (
        lambda: total_nats(circuit, np.zeros((1, 2))),
        lambda: out_shift(circuit, circuit, [0.1]),
        lambda: onset(circuit),
        lambda: linear_stn(circuit),
        lambda: correlated(circuit, 0.1),
        lambda: dopamine.decided_out(circuit, 1.0, 1.0),
        lambda: dopamine.working_range(circuit, 0.1),
        lambda: dopamine.stopping_posterior(circuit, 1.0, 0.1, 1.0),
        lambda: dopamine.usable_range(BasalGanglia(circuit, "algebra", 1.0), 0.1),
    ):
        with pytest.raises(ValueError, match=r"gpr works in salience, not nats: .* has no meaning"):
            refused()


def test_a_circuit_without_nats_decides_at_a_threshold_in_its_unit(tmp_path, capsys):
    path = tmp_path / "gpr.csv"
    task = ["--circuit", "gpr", "--engine", "rate", "--task", "trials=40", "t_max=60"]
    done = ["circuit", "run", "--save", str(path), *task, "--gain", "0.2", "--threshold", "0.05"]
    assert main(done) == 0
    table = pd.read_csv(path)
    assert table["forced"].mean() < 0.5
    assert table.loc[~table["forced"], "correct"].mean() > 0.8
    capsys.readouterr()
    assert main([*done, "--force", "--edits", "lesion D1"]) == 0
    assert pd.read_csv(path)["forced"].all()


def test_lesions_of_a_circuit_without_nats_are_compared_in_its_unit(tmp_path, capsys):
    path = tmp_path / "lesions.csv"
    asked = ["--circuit", "gpr", "--engine", "rate", "--gain", "0.1", "--edits", "lesion STN 50%"]
    asked += ["--task", "trials=100", "t_max=20", "--accuracies", "0.9", "0.97"]
    assert main(["compare", "--save", str(path), *asked]) == 0
    printed = capsys.readouterr().err
    assert "gpr works in salience, not nats: its thresholds are in salience" in printed
    assert "circuit minus intact" in set(pd.read_csv(path)["model"])


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        ("run --circuit gpr --gain 0.1", "a posterior has no meaning there; give a thr"),
        ("run --circuit gpr --threshold 0.1", "gpr has no default gain: give gain"),
        ("run --circuit gpr --gain 1 --threshold 0.5", "above the threshold of 0.50 sal"),
        ("run --circuit gpr --gain 1 --threshold -1", "no OUT below 0 salience; the"),
        ("show gpr --noise 0.9", "a posterior (--noise) has no meaning"),
    ],
)
def test_the_command_says_what_saliences_do_not_have(asked, says, tmp_path, monkeypatch, refusal):
    monkeypatch.chdir(tmp_path)
    engine = ("--engine", "rate") if asked.startswith("run") else ()
    sentence = refusal("circuit", *asked.split(), *engine)
    assert says in sentence
    assert sentence.count("\n") == 1


@pytest.mark.parametrize("name", ["gpr", "humphries"])
@pytest.mark.parametrize(
    ("command", "says"),
    [
        (("fit", "roitman_shadlen_2002", "--strength", "coherence", "--models"), "OUT is in nats"),
        (("circuit", "run", "--gain", ".1", "--engine", "rate", "--posterior", ".9",
          "--circuit"), "a posterior has no meaning there; give a threshold"),
        (("learn", "--what", "dopamine", "--gain", ".1", "--circuit"), "no meaning there"),
    ],
)  # fmt: skip
def test_each_way_in_that_needs_a_posterior_refuses_in_one_sentence(
    command, says, name, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert main([*command, name]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert says in line
    assert name in line
    assert not any(tmp_path.glob("*.*"))


def test_spikes_of_saliences_are_not_decoded_into_posteriors():
    model = BasalGanglia(anatomy.gpr(), "rate", 0.1)
    evidence = separated_evidence(2, 3, 0.5, rng=stream(1, "saliences"), step_ms=50.0)
    activity = model.activity(evidence)
    with pytest.raises(ValueError, match="-ln softmax of its input has no meaning there"):
        decoded_input(activity, model.trace(activity, evidence))
