"""Tuning by the exam's numbers: rates in closed form, numbers held out, seeds kept apart."""

import numpy as np
import pytest

from bgmodel import tuning
from bgmodel.tuning import tune
from circuits.anatomy import load_circuit
from circuits.dynamics.fixed_point import resting_hz
from circuits.errors import DataWarning
from circuits.laws.family import failures
from tests.helpers import refused, refusing

FREE = {"SNr.baseline_hz": (0.0, 60.0), "STN.gain_hz_per_nat": (8.0, 30.0)}
GIVEN = {"numbers": ["rest.snr"], "free": FREE, "held_out": ["rest.gpe"], "evaluations": 1}


@pytest.fixture
def at_the_fixed_point(monkeypatch):
    """Score resting rates at the fixed point on every seed: no circuit is simulated."""
    scores = tuning._scores

    def closed(*arguments, **_):
        return scores(*arguments, closed=True)

    monkeypatch.setattr(tuning, "_scores", closed)


def test_resting_rates_are_met_within_the_family(at_the_fixed_point):
    """SNr rests at ``baseline + gain ln 2``, and STN at ``gain Sigma0 / 2``."""
    numbers = ["rest.snr", "rest.stn"]
    with pytest.warns(DataWarning, match="rest.stn.task is held out, but asks for what rest.stn"):
        tuned = tune("macaque_small", numbers, FREE, held_out=["rest.stn.task"], evaluations=60)
    assert tuned.values["SNr.baseline_hz"] == pytest.approx(69.3 - 36 * np.log(2), abs=0.3)
    assert tuned.values["STN.gain_hz_per_nat"] == pytest.approx(2 * 19 / 2.2, abs=0.2)
    for channels in (2, 4):
        assert failures(tuned.model.circuit(channels)) == []
    summary = tuned.summary().set_index(["part", "use"])
    assert summary.loc[("tuned", "scoring"), "before"] == 1  # that of STN
    assert summary.loc[("tuned", "scoring"), "after"] == 2
    assert summary.loc[("tuned", "tuning"), "after"] == 2
    assert set(tuned.table["seed"]) == {tuning.TUNING_SEED, *tuning.SCORING_SEEDS}
    assert tuned.evaluations <= 61


def test_weights_follow_where_a_direction_changes_the_loop(at_the_fixed_point):
    free = {"Sigma0": (1.5, 2.5), "GPe->STN.weight": (-0.6, -0.2)}
    tuned = tune("macaque_small", ["rest.stn"], free, held_out=["rest.gpe"], evaluations=30)
    circuit = tuned.model.circuit(2)
    assert failures(circuit) == []
    assert resting_hz(circuit)["STN"] == pytest.approx(20 * tuned.values["Sigma0"] / 2)
    assert resting_hz(circuit)["STN"] == pytest.approx(19, abs=0.5)


def test_fields_of_a_circuit_outside_the_family_are_set_as_they_are(at_the_fixed_point):
    circuit = load_circuit("macaque").scale("GPe->STN", 1.1)
    free = {"SNr.baseline_hz": (0.0, 60.0)}
    tuned = tune(circuit, ["rest.snr"], free, held_out=["rest.gpe"], evaluations=40)
    assert resting_hz(tuned.model.circuit(2))["SNr"] == pytest.approx(69.3, abs=0.5)


def test_a_range_without_the_present_value_and_unanswered_numbers_are_doubted(at_the_fixed_point):
    given = {"held_out": ["rest.gpe"], "evaluations": 1}
    with pytest.warns(DataWarning, match="20, lies outside 150 to 190"):
        tune("macaque_small", ["rest.snr"], {"SNr.baseline_hz": (150, 190)}, **given)
    with pytest.warns(DataWarning, match="does not answer rest.fsi"):
        tune("macaque_small", ["rest.snr", "rest.fsi"], FREE, **given)
    with refused("numbers must be answered by macaque_small"):
        tune("macaque_small", ["rest.fsi"], FREE, **given)
    with refused("free must be real fields"):  # neurons are whole: no other number is a circuit
        tune("stewart", ["rest.stn"], {"STN.neurons": (10, 1000)}, **given)


test_a_tuning_that_could_not_be_judged_is_refused = refusing(
    ({"numbers": []}, "numbers"),
    ({"numbers": ["rest.nothing"]}, "numbers"),
    ({"numbers": ["rest.snr", "rest.snr"]}, "numbers"),
    ({"held_out": []}, "held_out"),
    ({"held_out": ["rest.snr"]}, "held_out"),
    ({"free": {}}, "free"),
    ({"free": {"STN->SNr.weight": (0.5, 2)}}, "free"),
    ({"free": {"SNr.baseline_hz": (60, 0)}}, "free"),
    ({"seed": 1, "scoring_seeds": (1, 2)}, "scoring_seeds"),
    ({"scoring_seeds": ()}, "scoring_seeds"),
    ({"evaluations": 0}, "evaluations"),
    of=lambda wrong: tune("macaque", **(GIVEN | wrong)),
)
