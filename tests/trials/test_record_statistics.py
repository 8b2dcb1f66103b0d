"""Accuracy and times in each condition."""

import numpy as np
import pandas as pd
import pytest

from bgmodel.trials.record import Trials, statistics


def test_each_cell_has_its_own_accuracy_and_times():
    choices = Trials(
        participant=np.array(["b", "a", "b", "b", "b"]),
        rt_s=np.array([0.4, 0.9, 0.6, np.nan, 0.8]),
        response=np.array([1, 0, 1, -1, 0], dtype=np.int8),
        strength=np.array([0.5, 0.0, -0.5, 0.5, -0.5]),
        conditions=pd.DataFrame({"cue": ["x"] * 5}),
        deadline_s=1.0,
    )
    rows = statistics(choices)
    assert rows["participant_id"].tolist() == ["a", "b"]
    assert rows["strength"].tolist() == [0, 0.5]
    assert rows["trials"].tolist() == [1, 4]
    assert rows["missing"].tolist() == [0, 1]
    assert np.isnan(rows["accuracy"][0])
    assert rows["accuracy"][1] == pytest.approx(2 / 3)
    assert rows["mean_s"].tolist() == pytest.approx([0.9, 0.6])
    assert rows["sd_s"][1] == pytest.approx(0.2)
    assert rows["q10_s"][1] == pytest.approx(0.44)
    assert rows["q90_s"][1] == pytest.approx(0.76)


def test_a_cell_without_a_response_has_no_times():
    silent = Trials(
        np.array(["a"]), np.array([np.nan]), np.array([-1], np.int8), None, pd.DataFrame(index=[0])
    )
    (row,) = statistics(silent).to_dict("records")
    assert (row["trials"], row["missing"]) == (1, 1)
    assert np.isnan([row[name] for name in ("accuracy", "mean_s", "sd_s", "q50_s")]).all()
