"""Figure L4 and the score of values, from the stored tables."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from bgmodel.support.files import read_table
from figures.common import FAST
from figures.learning import draw_L4 as figL4
from figures.learning import measure_values as values
from figures.rooms import table_path

NAMES = ("bandit", "reversal", "times", "loop", "courses", "differences")


def stored(*names):
    return [table_path(f"values_{name}") for name in names]


def test_figure_l4_shows_learners_the_circuit_and_people(tmp_path):
    figure = figL4.draw(FAST, *stored(*NAMES), output=tmp_path)
    figure.draw_without_rendering()
    plt.close(figure)
    assert len(figure.axes) == 8  # one with a second scale
    learners = read_table(stored("reversal")[0])["learner"].unique()
    assert set(figL4.LEARNERS) <= set(learners)
    assert {line.get_label() for line in figure.axes[0].lines} == set(figL4.LEARNERS)


def test_the_stored_regrets_meet_what_was_asked_for():
    table = read_table(stored("bandit")[0])
    rows = table[(table["better"] == 0.8) & (table["reversals"] == "every 50")]
    assert rows.set_index("learner")["relative_regret"].drop(["ideal", "chance"]).min() < 1.35
    hazard = table[table["reversals"] == "hazard"]
    assert (hazard["relative_regret"] + 3 * hazard["relative_regret_se"].fillna(0) >= 1).all()


def test_the_stored_times_fall_and_choices_improve_with_the_difference():
    for _, rows in read_table(stored("times")[0]).groupby("dopamine"):
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
