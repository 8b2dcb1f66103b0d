"""Figures of learned weights from the stored tables, and the score behind them."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from bgmodel.support.files import read_table
from figures.common import FAST
from figures.learning import draw_L1 as figL1
from figures.learning import measure_weights as weights
from figures.learning import tasks
from figures.learning.tasks import mean_se
from figures.rooms import table_path


def drawn(figure):
    """Draw a figure as when it is saved, and close it."""
    figure.draw_without_rendering()
    plt.close(figure)
    return figure


def stored(*names):
    """Return the paths of tables of the score."""
    return [table_path(f"weights_{name}") for name in names]


def test_figure_l1_shows_every_task_and_every_number_of_trials(tmp_path):
    paths = stored("ratios", "course")
    figure = drawn(figL1.draw(FAST, *paths, output=tmp_path))
    ratios, course = (read_table(path) for path in paths)
    assert set(ratios["after"]) == set(figL1.SHADES)
    assert set(course["task"]) == set(figL1.TASKS)
    assert len(figure.axes) == 3


def test_a_mean_over_runs_is_unknown_if_one_run_is():
    known = mean_se("slope", [1.0, 2.0, 3.0])
    assert known == {"slope": 2.0, "slope_se": pytest.approx(1 / np.sqrt(3))}
    assert np.isnan(mean_se("slope", [1.0, np.nan])["slope"])


def test_every_run_of_the_score_learns_and_is_scored(monkeypatch):
    monkeypatch.setattr(weights, "AFTER", (50, 100))
    monkeypatch.setattr(weights, "RUNS", 2)
    monkeypatch.setattr(tasks, "TESTED", 200)
    found = weights.learned_over_trials("2 mm", 100)
    assert set(zip(found["rule"], found["after"], strict=True)) == {
        (rule, after) for rule in ("confidence", "chosen", "counts") for after in (50, 100)
    }
    assert (found["runs"] == 2).all()
    counts = found[found["rule"] == "counts"]
    assert (counts["slope"] > 0.8).all()
