"""Spikes take the exam, and through the door for tables they get the same marks."""

import numpy as np
import pytest

from bgmodel.exam.exam import Exam, examinee
from bgmodel.exam.sitting import Sitting

EXAM = Exam.shipped()


@pytest.mark.validate
@pytest.mark.parametrize("engine", ["ensemble", "population"])
def test_rates_of_cells_through_the_door_get_the_marks_of_the_circuit(engine, tmp_path):
    exam = EXAM.only(["resting rates"])
    inside = exam.take("macaque", engine=engine, seed=5, share=0.1).table
    sitting = Sitting(examinee("macaque", engine=engine), EXAM.questions.tasks, 5, share=0.1)
    sitting.rates_of("rest").to_csv(tmp_path / "rates.csv", index=False)
    outside = exam.mark(rates=tmp_path / "rates.csv", seed=5).table
    for column in ("value", "se", "z"):
        np.testing.assert_allclose(outside[column], inside[column], rtol=1e-9)
