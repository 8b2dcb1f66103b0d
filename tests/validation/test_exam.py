"""Spikes take the exam, and through the door for tables they get the same marks."""

import numpy as np
import pandas as pd
import pytest

from bgmodel.exam import simulation
from bgmodel.exam.exam import Exam
from bgmodel.exam.simulation import Simulation
from bgmodel.experiments.models import model_of
from circuits.anatomy import macaque

EXAM = Exam.shipped()
MARKS = ["value", "se", "z"]
ENGINES = ["population", "spikes", "brian2"]
TRIALS, TRIALS_WITH_ERRORS = 30, 150
"""Trials from which rates are taken, and trials of which enough are errors."""
FEW_CELLS = [f"set {row.name}.neurons 30" for row in macaque(2).populations if row.spiking]
"""Edits for Brian2, which takes seconds per trial with 300 cells."""


@pytest.fixture(autouse=True)
def few_trials(monkeypatch):
    monkeypatch.setattr(simulation, "FEWEST_TRIALS", TRIALS)


def taking(engine):
    edits = FEW_CELLS if engine == "brian2" else ()
    return model_of("macaque", edits, engine, 0.5)


def simulation_of(engine):
    return Simulation(taking(engine), EXAM.tasks, 5, share=0.05)


def same_marks(outside, inside):
    assert (outside["outcome"] == inside["outcome"]).all()
    for column in MARKS:
        np.testing.assert_allclose(outside[column], inside[column], rtol=1e-9)


@pytest.mark.validate
@pytest.mark.parametrize("engine", ENGINES)
def test_rates_of_cells_through_the_door_get_the_marks_of_the_circuit(engine, tmp_path):
    exam = EXAM.only(["resting rates"])
    inside = exam.take(taking(engine), seed=5, share=0.05).table
    simulation_of(engine).rates("rest").to_csv(tmp_path / "rates.csv", index=False)
    same_marks(exam.mark(rates=tmp_path / "rates.csv", seed=5).table, inside)


@pytest.mark.validate
@pytest.mark.parametrize("engine", ["population", "spikes"])
def test_trials_through_the_door_get_the_marks_of_the_circuit(engine, tmp_path, monkeypatch):
    monkeypatch.setattr(simulation, "FEWEST_TRIALS", TRIALS_WITH_ERRORS)
    exam = EXAM.only(["conflict"])
    exam = exam.of(one.id for one in exam.numbers if "nucleus" not in one.of)
    tasks = sorted({task for one in exam.numbers for _, task in one.tasks()})
    trials = pd.concat(map(simulation_of(engine).trials, tasks))
    trials.to_csv(tmp_path / "trials.csv", index=False)
    inside = exam.take(taking(engine), seed=5, share=0.05).table
    assert np.isfinite(inside["value"]).all()
    same_marks(exam.mark(tmp_path / "trials.csv", seed=5).table, inside)
