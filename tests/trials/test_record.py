"""The record of trials, and its frames for other tools."""

import numpy as np
import pandas as pd
import pytest

from bgmodel.trials.record import Trials, statistics
from tests.helpers import refused


def trials(**more):
    """Return four trials of two participants, the last without a response."""
    columns = {
        "participant": np.array(["a", "a", "b", "b"]),
        "rt_s": np.array([0.5, 0.6, 0.7, np.nan]),
        "response": np.array([1, 0, 1, -1], np.int8),
        "strength": np.array([0.1, -0.2, 0.3, 0.4]),
        "conditions": pd.DataFrame({"cue": ["x", "y", "x", "y"]}),
        "deadline_s": 2.0,
    }
    return Trials(**{**columns, **more})


def test_hssm_gets_a_code_for_a_missing_time_and_numbers_within_participants():
    table = trials().to_hssm()
    assert table["rt"].tolist() == [0.5, 0.6, 0.7, -999.0]
    assert table["response"].tolist() == [1, -1, 1, -1]
    assert table["trial"].tolist() == [0, 1, 0, 1]
    assert list(table) == ["participant_id", "trial", "rt", "response", "strength", "cue"]


def test_pyddm_gets_no_choice_without_a_response():
    table = trials().to_pyddm()
    assert table["choice"].tolist()[:3] == [1, 0, 1]
    assert table.iloc[3][["rt", "choice"]].isna().all()
    assert "participant_id" not in trials().where(np.arange(4) < 2).to_pyddm()


@pytest.mark.parametrize("name", ["rt", "strength", "participant_id"])
def test_a_condition_called_like_another_column_is_refused(name):
    taken = trials(conditions=pd.DataFrame({name: list("xyxy")}))
    with refused("conditions"):
        taken.to_hssm()


@pytest.mark.parametrize("name", ["ssd_s", "reward"])
def test_further_columns_go_with_their_trials_and_count_for_the_checksum(name):
    more = trials(**{name: np.array([0.2, np.nan, 0.1, 0.3])})
    assert getattr(more.where(np.arange(4) > 1), name).tolist() == [0.1, 0.3]
    assert more.checksum != trials().checksum
    with refused("response one value per trial"):
        trials(**{name: np.zeros(3)})


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
