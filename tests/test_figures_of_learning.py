"""Figures of learned weights from the stored tables, and the score behind them."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from benchmarks.pages import TABLES
from benchmarks.scores import weights
from benchmarks.scores.learned import tasks
from benchmarks.scores.learned.changes import BEGINS, BIN, summaries
from benchmarks.scores.learned.tasks import mean_se
from bgmodel.support.files import read_table
from figures import figL1, figL2, figL3
from figures.common import FAST


def drawn(figure):
    """Draw a figure as when it is saved, and close it."""
    figure.draw_without_rendering()
    plt.close(figure)
    return figure


def stored(*names):
    """Return the paths of tables of the score."""
    return [TABLES / f"weights_{name}.csv" for name in names]


def test_figure_l1_shows_every_task_and_every_number_of_trials(tmp_path):
    paths = stored("ratios", "course")
    figure = drawn(figL1.draw(FAST, *paths, output=tmp_path))
    ratios, course = (read_table(path) for path in paths)
    assert set(ratios["after"]) == set(figL1.SHADES)
    assert set(course["task"]) == set(figL1.TASKS)
    assert len(figure.axes) == 3


def test_figure_l2_shows_every_learner_and_every_rule(tmp_path):
    paths = stored("course", "rules")
    figure = drawn(figL2.draw(FAST, *paths, output=tmp_path))
    course, rules = (read_table(path) for path in paths)
    assert set(course["rule"]) == set(figL2.LEARNERS)
    assert set(rules["stopping"]) == set(figL2.STOPPINGS)
    labels = [text.get_text() for text in figure.axes[3].get_yticklabels()]
    assert len(labels) == len(weights.RULES)


def test_figure_l3_shows_every_critic_and_change(tmp_path):
    paths = stored("asymmetry", "feedback", "changes")
    figure = drawn(figL3.draw(FAST, *paths, output=tmp_path))
    _, feedback, changes = (read_table(path) for path in paths)
    assert set(feedback["critic"]) == set(figL3.CRITICS)
    assert set(figL3.DRIFTS) <= set(changes["change"])
    assert len(figure.axes) == 4


def test_a_change_is_compensated_in_the_first_bin_that_is_near():
    trial = np.arange(0, BEGINS + 1000, BIN)
    correct = np.where(trial < BEGINS, 0.95, np.where(trial < BEGINS + 200, 0.5, 0.94))
    never = np.where(trial < BEGINS, 0.95, 0.5)
    parts = {"soon": correct, "never": never, "none": np.full(len(trial), 0.95)}
    table = pd.concat(
        pd.DataFrame({"change": name, "trial": trial, "correct": values, "learning_r": 1.0})
        for name, values in parts.items()
    )
    rows = summaries(table).set_index("change")
    assert rows.loc["soon", "recovered_after"] == 200
    assert rows.loc["soon", "lowest"] == 0.5
    assert np.isnan(rows.loc["never", "recovered_after"])
    assert rows.loc["none", "recovered_after"] == 0


def test_a_mean_over_runs_is_unknown_if_one_run_is():
    known = mean_se("slope", [1.0, 2.0, 3.0])
    assert known == {"slope": 2.0, "slope_se": pytest.approx(1 / np.sqrt(3))}
    assert np.isnan(mean_se("slope", [1.0, np.nan])["slope"])


def test_every_run_of_the_score_learns_and_is_scored(monkeypatch):
    monkeypatch.setattr(weights, "AFTER", (50, 100))
    monkeypatch.setattr(weights, "RUNS", 2)
    monkeypatch.setattr(tasks, "TESTED", 200)
    table = weights.learned_over_trials("2 mm", 100)
    assert set(zip(table["rule"], table["after"], strict=True)) == {
        (rule, after) for rule in ("confidence", "chosen", "counts") for after in (50, 100)
    }
    assert (table["runs"] == 2).all()
    counts = table[table["rule"] == "counts"]
    assert (counts["slope"] > 0.8).all()
