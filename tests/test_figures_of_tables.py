"""Figures E1 and E2 on small tables, and what the stored tables of scores must show."""

import numpy as np
import pandas as pd
import pytest

from bgmodel.support.files import read_table
from figures.common import FAST
from figures.discriminate import draw_E2 as figE2
from figures.exam import draw_E1 as figE1
from figures.learning import measure_values as values
from figures.learning import measure_weights as weights
from figures.learning import tasks
from figures.learning.tasks import mean_se
from figures.rooms import table_path, write
from figures.stopping import draw_G2 as figG2


def stored(name):
    return read_table(table_path(name))


def texts(ax):
    return [text.get_text() for text in ax.texts if text.get_text()]


def drawn(figure, folder, **tables):
    """Draw a figure from tables; return its panels."""
    paths = [folder / f"{name}.csv" for name in tables]
    for path, table in zip(paths, tables.values(), strict=True):
        write(table, path, seed=1, circuits={})
    return figure.draw(FAST, *paths, output=folder).axes


def test_figure_e1_writes_z_scores_signs_and_the_range_over_seeds(tmp_path):
    rows = [
        ("macaque", 1, "a", 3.2, "disagrees"), ("macaque", 1, "b", np.nan, "agrees"),
        ("macaque", 1, "c", 250.0, "disagrees"), ("macaque", 1, "d", np.nan, "fails"),
    ]  # fmt: skip
    names = ["examinee", "sitting", "id", "z", "outcome"]
    numbers = pd.DataFrame(rows, columns=names).assign(domain="one", set_by="predicted")
    shares = {"examinee": "macaque", "domain": "one", "sitting": [1, 2], "share": [0.25, 0.5]}
    axes = drawn(figE1, tmp_path, numbers=numbers, domains=pd.DataFrame(shares))
    assert texts(axes[0]) == ["+3", "✓", "≫"]
    assert texts(axes[1]) == ["0.25\n0.50"]


def test_figure_e2_tells_information_from_none_and_bounds_from_medians(tmp_path):
    axes = pd.DataFrame(
        {
            "pair": ["p", "p", "q", "q"], "axis": "channels", "value": ["2", "4", "2", "4"],
            "tried": 1, "nats": [0.01, 0.2, 0.01, 0.0], "low": [-0.01, 0.1, -0.1, 0.0],
        }
    )  # fmt: skip
    trials = pd.DataFrame(
        {
            "pair": ["p", "p", "q", "q"], "truth": ["a", "b", "a", "c"],
            "median": [20.0, 30.0, np.nan, np.nan], "low": [15.0, 25.0, 900.0, np.nan],
            "high": [25.0, 35.0, np.nan, np.nan], "simulated_median": [21.0, 28.0, np.nan, np.nan],
        }
    )  # fmt: skip
    left, right = drawn(figE2, tmp_path, axes=axes, trials=trials)
    assert [text.get_text() for text in left.texts] == ["–", "0.2", "–", "–"]
    triangles = [line for line in right.lines if line.get_marker() == ">" and len(line.get_xdata())]
    assert [float(line.get_xdata()[0]) for line in triangles] == [900.0]


def test_simulated_experiments_have_the_predicted_medians_within_a_fifth():
    table = stored("discriminate_trials").dropna(subset="median")
    # Medians are whole numbers: one trial is within the error where few are needed.
    apart = (table["simulated_median"] - table["median"]).abs()
    near = (apart <= np.maximum(0.2 * table["median"], 1.0)).groupby(table["pair"]).all()
    assert near.sum() >= 3
    # A Bayes factor of 10 is wrong in at most 1 of 11 experiments, within 3 errors of 200 of them.
    assert (table["right"] > 1 - 1 / 11 - 3 * np.sqrt(10 / 11**2 / 200)).all()


def test_a_mean_over_runs_is_unknown_if_one_run_is():
    known = mean_se("slope", [1.0, 2.0, 3.0])
    assert known == {"slope": 2.0, "slope_se": pytest.approx(1 / np.sqrt(3))}
    assert np.isnan(mean_se("slope", [1.0, np.nan])["slope"])


def test_every_run_of_the_score_learns_and_is_scored(monkeypatch):
    monkeypatch.setattr(weights, "AFTER", (50, 100))
    monkeypatch.setattr(weights, "RUNS", 2)
    monkeypatch.setattr(tasks, "TESTED", 200)
    learned = weights.learned_over_trials("2 mm", 100)
    assert set(zip(learned["rule"], learned["after"], strict=True)) == {
        (rule, after) for rule in ("confidence", "chosen", "counts") for after in (50, 100)
    }
    assert (learned["runs"] == 2).all()
    counts = learned[learned["rule"] == "counts"]
    assert (counts["slope"] > 0.8).all()


def test_the_race_and_the_circuit_stop_at_one_place_and_common_input_moves_the_extra_channel():
    table, tone = stored("stopping_inhibition"), stored("stopping_tone")
    by = table.pivot(index="ssd_ms", columns="decider", values="p_respond")
    assert by["circuit, 1 nat"].to_numpy() == pytest.approx(by["race"].to_numpy(), abs=0.01)
    assert figG2.relative(table[table["decider"] == "circuit, 1 nat"]).is_monotonic_increasing
    by = tone[tone["engine"] == "population"].groupby("compared")["p_respond"].agg(np.ptp)
    assert by["circuit"] < 0.02 < 0.2 < by["extra channel"]


def test_regrets_are_small_where_reversals_are_known():
    table = stored("values_bandit")
    rows = table[(table["better"] == 0.8) & (table["reversals"] == "every 50")]
    assert rows.set_index("learner")["relative_regret"].drop(["ideal", "chance"]).min() < 1.35
    hazard = table[table["reversals"] == "hazard"]
    assert (hazard["relative_regret"] + 3 * hazard["relative_regret_se"].fillna(0) >= 1).all()


def test_times_fall_and_choices_improve_with_the_difference_of_values():
    for _, rows in stored("values_times").groupby("dopamine"):
        assert rows["share"].is_monotonic_increasing
        assert rows["median_ms"].is_monotonic_decreasing


def test_trials_are_aligned_to_reversals():
    trials = np.zeros((150, 2))
    trials[50::50] = 1.0
    mean, error = values.since_reversal(trials)
    assert mean.tolist() == [1.0] + [0.0] * 49
    assert (error == 0).all()


def test_the_error_of_a_median_is_that_of_the_normal_law():
    times = np.random.default_rng(1).normal(500, 100, 4000)
    median = values.median_and_error(times)
    assert median["median_se"] == pytest.approx(100 * np.sqrt(np.pi / 2) / np.sqrt(4000), rel=0.25)
