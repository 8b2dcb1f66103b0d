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
CONFLICT = EXAM.only(["conflict"])
CONFLICT = CONFLICT.of(one.id for one in CONFLICT.numbers if "nucleus" not in one.of)
OF = {"rates": (EXAM.only(["resting rates"]), 30), "trials": (CONFLICT, 150)}
"""What is asked for, and trials from which rates are taken or of which enough are errors."""
FEW_CELLS = [f"set {row.name}.neurons 30" for row in macaque(2).populations if row.spiking]
"""Edits for Brian2, which takes seconds per trial with 300 cells."""


@pytest.mark.validate
@pytest.mark.parametrize(
    ("kind", "engine"),
    [*(("rates", engine) for engine in ("population", "spikes", "brian2")),
     *(("trials", engine) for engine in ("population", "spikes"))],
)  # fmt: skip
def test_tables_through_the_door_get_the_marks_of_the_circuit(kind, engine, tmp_path, monkeypatch):
    exam, fewest = OF[kind]
    monkeypatch.setattr(simulation, "FEWEST_TRIALS", fewest)
    model = model_of("macaque", FEW_CELLS if engine == "brian2" else (), engine, 0.5)
    inside = exam.take(model, seed=5, share=0.05).table
    simulated = Simulation(model, EXAM.tasks, 5, share=0.05)
    path = tmp_path / "made.csv"
    tasks = sorted({task for one in exam.numbers for _, task in one.tasks()})
    pd.concat(map(getattr(simulated, kind), tasks)).to_csv(path, index=False)
    outside = exam.mark(**{kind: path}, seed=5).table
    assert (outside["outcome"] == inside["outcome"]).all()
    assert kind == "rates" or np.isfinite(inside["value"]).all()
    for column in ("value", "se", "z"):
        np.testing.assert_allclose(outside[column], inside[column], rtol=1e-9)
