"""The table of a sweep."""

import numpy as np
import pandas as pd
import pytest

from bgmodel.bootstrap import RESAMPLES, interval, resampled
from bgmodel.deciding.measures import MEASURES
from bgmodel.support.seeds import stream
from bgmodel.sweeps import outcome, shards
from bgmodel.sweeps.plan import Plan
from bgmodel.task import Gaussian
from tests.helpers import behaving, told

TASK = Gaussian(trials=80, t_max=30)


def swept(tmp_path, **changed):
    plan = Plan(**({"task": TASK, "engine": "algebra", "gain": 0.7} | changed))
    tables = []
    for setting in plan.all_points():
        for shard in setting.shards():
            shards.compute(shard, tmp_path)
        tables.append(outcome.measured(setting, tmp_path))
    return plan, outcome.gathered(plan, tables)


def test_a_row_is_a_point_and_a_measure_with_its_interval(tmp_path):
    plan, table = swept(tmp_path, grid={"posterior": (0.7, 0.9)})
    columns = ["posterior", "measure", "value", "low", "high", "trials", "gain", "remark"]
    assert list(table) == columns
    assert set(table["gain"]) == {0.7}
    assert list(table["measure"]) == [*MEASURES, *MEASURES]
    behaviour, _ = shards.read(plan.all_points()[1], tmp_path)
    weights = resampled(80, RESAMPLES, stream(0, "bootstrap"))
    want = interval(behaviour.measures(weights)["accuracy"])
    row = table[(table["posterior"] == 0.9) & (table["measure"] == "accuracy")]
    assert tuple(row[["value", "low", "high"]].to_numpy()[0]) == want


CONFLICT = {"task": Gaussian(trials=200, t_max=40), "engine": "population", "gain": None}


@pytest.mark.parametrize(
    ("key", "value", "changed", "says"),
    [
        ("lesion STN", 0.0, {"engine": "rate", "task": Gaussian(trials=80, t_max=120)}, ""),
        ("lesion STN", 1.0, {"engine": "rate", "task": Gaussian(trials=80, t_max=120)},
         "the circuit decides without evidence"),
        ("posterior", 0.9, {"task": Gaussian(trials=80, t_max=20)},
         "many trials are not decided in time: accuracy and times refer to the decided ones; "
         "accuracy_all, accuracy_best, mean_all_ms are of all trials"),
        ("posterior", 0.94, {"task": Gaussian(trials=80, t_max=1)},
         "fewer than 20 trials are decided in time"),
        ("task.conflict", 0.9, CONFLICT | {"posterior": 0.7},
         "the evidence is too sure: posteriors at the decision are not"),
    ],
)  # fmt: skip
def test_what_makes_numbers_misleading_is_said(tmp_path, key, value, changed, says):
    _, table = swept(tmp_path, grid={key: (value,)}, **changed)
    (remark,) = table[table["measure"] == "accuracy"]["remark"]
    assert says in remark
    assert bool(remark) == bool(says)


def test_a_point_that_could_not_run_is_there_without_numbers(tmp_path, monkeypatch):
    def refused(*_):
        raise ValueError("rates run away")

    monkeypatch.setattr(shards, "_decided", refused)
    plan, table = swept(tmp_path, grid={"lesion STN": (0.5, 1.0)})
    assert table["value"].isna().all()
    assert set(table["remark"]) == {"rates run away"}
    states = [shards.state(s, tmp_path) for each in plan.all_points() for s in each.shards()]
    assert states == ["done", "done"]
    outcome.draw(plan, table)


def test_a_map_has_the_first_key_up_and_the_second_across(tmp_path, monkeypatch):
    monkeypatch.setattr(outcome, "LINES", 0)
    plan, table = swept(tmp_path, grid={"lesion STN": (0.0, 0.2), "posterior": (0.7, 0.8, 0.9)})
    panel = outcome.draw(plan, table).axes[0]
    seen = panel.images[0].get_array()
    assert seen.shape == (2, 3)
    at = (
        (table["lesion STN"] == 0.2)
        & (table["posterior"] == 0.7)
        & (table["measure"] == "accuracy")
    )
    assert seen[1, 0] == pytest.approx(table[at]["value"].item())
    assert (panel.get_ylabel(), panel.get_xlabel()) == ("lesion STN (fraction)", "posterior")


@pytest.mark.parametrize(
    ("grid", "idle"),
    [
        ({"compensate": (False, True), "posterior": (0.7, 0.8)}, ["compensate"]),
        ({"set STN.cite": ("a", "b")}, ["STN.cite"]),
        ({"lesion STN": (0.0, 0.1), "posterior": (0.7, 0.8)}, []),
        ({"posterior": (0.8,)}, []),
    ],
)
def test_a_key_on_which_no_measure_depends_is_warned_of(tmp_path, grid, idle):
    texts = [text for text in told(swept, tmp_path, grid=grid) if "no measure depends" in text]
    assert [text.split(":")[0].split()[-1] for text in texts] == idle


def test_a_bootstrap_in_parts_weighs_every_trial_as_often(tmp_path, monkeypatch):
    weights = np.concatenate(list(outcome._weights(3, 40)))
    monkeypatch.setattr(outcome, "AT_ONCE", 40 * 300)
    parts = np.concatenate(list(outcome._weights(3, 40)))
    assert np.array_equal(parts, weights)


def test_a_grid_with_a_short_key_is_a_line_per_value_of_it():
    grid = {"engine": ("rate", "algebra"), "lesion STN": (0.0, 0.1, 0.2)}
    plan, values = Plan(grid=grid, show=("accuracy",)), np.array([0.6, 0.7, 0.8, 0.5, 0.6, 0.7])
    table = pd.DataFrame(list(plan.each)).assign(measure="accuracy", value=values, trials=80)
    figure = outcome.draw(plan, table.assign(low=values, high=values, remark=""))
    (panel, *_) = figure.axes
    lines = [bars.lines[0].get_ydata().tolist() for bars in panel.containers]
    assert lines == values.reshape(2, 3).tolist()
    assert "lesion STN (fraction)" in (panel.get_xlabel(), figure.get_supxlabel())
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["engine = rate", "engine = algebra"]


def test_only_where_there_are_two_alternatives_a_diffusion_is_said_to_be_withheld(
    tmp_path, monkeypatch
):
    """Times that do not vary are those of no diffusion."""
    for channels, says in (
        (2, "drift, boundary_separation, non_decision_ms are withheld: no diffusion"),
        (4, ""),
    ):
        plan = Plan(grid={"task.channels": (channels,)}, task=TASK)
        truth = np.arange(80) % channels
        behaviour = behaving(truth, np.full(80, 400.0), truth, channels=channels)
        monkeypatch.setattr(outcome, "read", lambda *_, behaviour=behaviour: (behaviour, ""))
        (setting,) = plan.all_points()
        remarks = outcome.measured(setting, tmp_path).set_index("measure")["remark"]
        (remark,) = set(remarks[remarks.index.isin(outcome.OF_DIFFUSION)]) or {""}
        assert remark.startswith(says)
        assert bool(remark) == bool(says)
        assert set(remarks[~remarks.index.isin(outcome.OF_DIFFUSION)]) == {""}
