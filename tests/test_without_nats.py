"""Circuits whose unit is not nats: laws and commands that need nats are rejected."""

import numpy as np
import pandas as pd
import pytest

from bgmodel import stream
from bgmodel.cli import main
from bgmodel.integrators.at_thresholds import decoded_input
from bgmodel.integrators.basal_ganglia import BasalGanglia
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


def test_spikes_of_saliences_are_not_decoded_into_posteriors():
    model = BasalGanglia(anatomy.gpr(), "rate", 0.1)
    evidence = separated_evidence(2, 3, 0.5, rng=stream(1, "saliences"), step_ms=50.0)
    activity = model.activity(evidence)
    with pytest.raises(ValueError, match="-ln softmax of its input has no meaning there"):
        decoded_input(activity, model.trace(activity, evidence))
