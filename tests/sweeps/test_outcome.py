"""The table and the figure of a sweep."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bgmodel.bootstrap import RESAMPLES, interval, resampled
from bgmodel.deciding.measures import MEASURES
from bgmodel.support.seeds import stream
from bgmodel.sweeps import outcome, shards
from bgmodel.sweeps.plan import Plan
from bgmodel.task import Gaussian
from tests.helpers import behaving, refused, told

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


def test_a_circuit_that_decides_without_evidence_is_said_to(tmp_path):
    long = Gaussian(trials=80, t_max=120)
    _, table = swept(tmp_path, grid={"lesion STN": (0.0, 1.0)}, engine="rate", task=long)
    remarks = table.drop_duplicates("lesion STN")["remark"]
    assert list(remarks) == ["", "the circuit decides without evidence"]


def test_missed_trials_are_said(tmp_path):
    _, table = swept(tmp_path, grid={"posterior": (0.9,)}, task=Gaussian(trials=80, t_max=20))
    missed = table[table["measure"] == "missed"]["value"].item()
    assert 0.05 < missed < 0.75
    assert set(table["remark"]) == {
        "many trials are not decided in time: accuracy and times refer to the decided ones; "
        "accuracy_all, accuracy_best, mean_all_ms are of all trials"
    }


def test_posteriors_that_are_not_accuracies_are_said(tmp_path):
    task = Gaussian(trials=200, t_max=40)
    grid = {"task.conflict": (0.0, 0.9), "posterior": (0.7,)}
    _, table = swept(tmp_path, grid=grid, engine="population", gain=None, task=task)
    remarks = table.drop_duplicates("task.conflict").set_index("task.conflict")["remark"]
    assert "the evidence is too sure: posteriors at the decision are not" in remarks[0.9]
    assert "posteriors" not in remarks[0.0]


def test_a_point_that_could_not_run_is_there_without_numbers(tmp_path, monkeypatch):
    def refused(*_):
        raise ValueError("rates run away")

    monkeypatch.setattr(shards, "_decided", refused)
    plan, table = swept(tmp_path, grid={"lesion STN": (0.5, 1.0)})
    assert table["value"].isna().all()
    assert set(table["remark"]) == {"rates run away"}
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


def points_of(plan, values, remarks=None):
    """Return a table of one measure at each point of a plan."""
    table = pd.DataFrame(list(plan.each))
    table = table.assign(measure=plan.show[0], value=values, low=values, high=values, trials=80)
    return table.assign(remark=remarks or "")


def test_a_line_has_bars_from_the_lower_to_the_upper_end():
    plan = Plan(grid={"posterior": (0.9, 0.7)}, show=("accuracy",))
    table = points_of(plan, [0.8, 0.6]).assign(low=[0.75, 0.5], high=[0.9, 0.65])
    figure = outcome.draw(plan, table)
    (bars,) = figure.axes[0].containers[0].lines[2]
    np.testing.assert_allclose(
        bars.get_segments(), [[[0.7, 0.5], [0.7, 0.65]], [[0.9, 0.75], [0.9, 0.9]]]
    )
    note = "80 trials per point; bars: 95 % intervals"
    assert figure.get_suptitle() == f"macaque\n{note}"
    named = replace(plan, name="who decides")
    assert outcome.draw(named, table).get_suptitle() == f"who decides\n{note}"
    some = outcome.draw(plan, table.assign(trials=[60, 80])).get_suptitle()
    assert some.startswith("macaque\n60 to 80 trials per point;")


@pytest.mark.parametrize(("across", "written"), [(30, True), (31, False)])
def test_a_map_of_few_points_says_each_number_in_white_on_dark(across, written, monkeypatch):
    """Below the mean is dark; a star has a remark, a dash no number, and 60 numbers are few."""
    monkeypatch.setattr(outcome, "LINES", 0)
    posteriors = tuple(0.6 + 0.01 * k for k in range(across))
    plan = Plan(grid={"lesion STN": (0.0, 0.2), "posterior": posteriors}, show=("mean_ms",))
    values = np.r_[np.full(across, 9.5), np.full(across, 300.4)]
    remarks = np.full(2 * across, "", dtype=object)
    remarks[[1, across]], values[2] = "few decide", np.nan
    figure = outcome.draw(plan, points_of(plan, values, list(remarks)))
    assert figure.get_suptitle() == "macaque\n80 trials per point; *: see remark in the table"
    numbers = [text.get_text() for text in figure.axes[0].texts]
    if not written:
        assert numbers == []
        return
    assert numbers[:4] == ["9.50", "9.50*", "-", "9.50"]
    assert numbers[across : across + 2] == ["300*", "300"]
    colours = [text.get_color() for text in figure.axes[0].texts]
    assert set(colours[:2]) == {"w"}
    assert set(colours[across:]) == {"k"}


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


def test_three_keys_have_a_table_and_no_figure():
    plan = Plan(grid={"lesion STN": (0.1,), "lesion GPe": (0.1,), "dopamine": (1.0,)})
    with refused("axes"):
        outcome.draw(plan, pd.DataFrame())


def test_a_bootstrap_in_parts_weighs_every_trial_as_often(tmp_path, monkeypatch):
    weights = np.concatenate(list(outcome._weights(3, 40)))
    monkeypatch.setattr(outcome, "AT_ONCE", 40 * 300)
    parts = np.concatenate(list(outcome._weights(3, 40)))
    assert np.array_equal(parts, weights)


def test_too_few_decisions_are_said(tmp_path):
    _, table = swept(tmp_path, grid={"posterior": (0.94,)}, task=Gaussian(trials=80, t_max=1))
    assert set(table["remark"]) == {"fewer than 20 trials are decided in time"}


def test_a_star_stands_at_every_number_that_has_a_remark():
    plan = Plan(grid={"posterior": (0.7, 0.8, 0.9)}, show=("accuracy",))
    points = points_of(plan, [0.6, 0.7, np.nan], ["", "few decide", "rates run away"])
    (panel,) = (figure := outcome.draw(plan, points)).axes
    assert [(star.get_text(), star.xy) for star in panel.texts] == [("*", (0.8, 0.7))]
    assert "*: see remark" in figure.get_suptitle()
    (panel,) = (figure := outcome.draw(plan, points_of(plan, [0.6, 0.7, 0.8]))).axes
    assert not panel.texts
    assert "*" not in figure.get_suptitle()


def test_a_grid_with_a_short_key_is_a_line_per_value_of_it():
    plan = Plan(
        grid={"engine": ("rate", "algebra"), "posterior": (0.7, 0.8, 0.9)}, show=("accuracy",)
    )
    figure = outcome.draw(plan, points_of(plan, [0.6, 0.7, 0.8, 0.5, 0.6, 0.7]))
    lines = [bars.lines[0] for bars in figure.axes[0].containers]
    assert [list(line.get_ydata()) for line in lines] == [[0.6, 0.7, 0.8], [0.5, 0.6, 0.7]]
    (legend,) = figure.legends
    labels = [text.get_text() for text in legend.get_texts()]
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
        (remark,) = set(outcome.measured(setting, tmp_path)["remark"])
        assert remark.startswith(says)
        assert bool(remark) == bool(says)
