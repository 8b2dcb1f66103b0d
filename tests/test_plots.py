"""Plots draw what they are given on the Axes they are given."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from scipy.stats import binomtest

from bgmodel import plots
from circuits.plots import raster


@pytest.fixture
def ax():
    return Figure().subplots()


@pytest.mark.parametrize(("k", "n"), [(0, 10), (7, 10), (93, 100), (50, 50)])
def test_the_wilson_interval_is_that_of_scipy(k, n):
    interval = binomtest(k, n).proportion_ci(method="wilson")
    assert plots.wilson(k, n) == pytest.approx((interval.low, interval.high), abs=1e-4)


def heights(ax, count):
    """Return the summed heights of the first groups of bars."""
    return [sum(bar.get_height() for bar in bars) for bars in ax.containers[:count]]


def texts(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


TIMES = [100.0, 300.0, np.nan, 200.0]


def test_times_are_drawn_by_choice_and_the_undecided_are_counted(ax):
    assert plots.choice_times([0, 2, -1, 0], TIMES, np.zeros(4), ax=ax) is ax.figure
    assert texts(ax) == ["Chose 0 (n = 2)", "Chose 2 (n = 1)"]
    assert heights(ax, 2) == [2, 1]
    assert ax.get_title() == "n = 4, 1 undecided"


def test_errors_are_below_correct_decisions_and_those_of_the_deadline_are_hatched(ax):
    forced = [False, False, False, True]
    plots.choice_times([0, 2, -1, 0], TIMES, forced, [0, 0, 0, 0], ax)
    assert texts(ax) == ["Correct (n = 2)", "Error (n = 1)", "At the deadline (n = 1)"]
    assert heights(ax, 4) == [1, -1, 1, 0]
    assert [bars[0].get_hatch() for bars in ax.containers[:3]] == [None, None, "/////"]
    assert ax.get_title().startswith("Accuracy 0.667 [0.208, 0.939], n = 4")


def test_a_high_bar_of_the_deadline_is_cut_off_and_has_its_number(ax):
    times = np.r_[np.linspace(100, 900, 60), np.full(40, 1000.0)]
    plots.choice_times(np.zeros(100, int), times, times == 1000, np.zeros(100, int), ax)
    assert ax.get_ylim()[1] < 40
    assert "40" in {text.get_text().strip() for text in ax.texts}


@pytest.mark.parametrize(("last", "each"), [(20, 1), (70, 3)])
def test_bars_of_times_on_a_grid_lie_on_its_places(ax, last, each):
    times = 50.0 * np.arange(1, last + 1).repeat(2)
    plots.choice_times(0 * times, times, 0 * times, 0 * times, ax)
    bars = [bar for bar in ax.patches if bar.get_height()]
    first = bars[0]
    assert first.get_x() == pytest.approx(25.0)
    assert first.get_width() == pytest.approx(50.0 * each)
    assert sum(bar.get_height() for bar in bars) == len(times)
    assert {bar.get_height() for bar in bars[:-1]} == {2 * each}


def test_out_is_drawn_a_line_per_hypothesis(ax):
    plots.output([-10.0, 0.0], np.array([[0.7, 0.6], [0.1, 2.0]]), ax)
    assert [line.get_ydata().tolist() for line in ax.lines[:2]] == [[0.7, 0.1], [0.6, 2.0]]
    assert ax.lines[0].get_xdata().tolist() == [-10.0, 0.0]


def test_acquisition_draws_the_median_run(ax):
    runs = pd.DataFrame([[0.0, 1.0], [2.0, 3.0], [9.0, 5.0]], columns=[0, 100])
    plots.acquisition(ax, runs, color="k")
    assert ax.lines[0].get_ydata().tolist() == [2.0, 3.0]


def test_raster_shows_the_first_neurons_of_each_channel(ax):
    spikes = pd.DataFrame({"channel": [0, 1, 1], "neuron": [1, 0, 2], "time_ms": [1.0, 2.0, 3.0]})
    assert raster(ax, spikes, channels=2, neurons=2) is ax
    assert [line.get_ydata().tolist() for line in ax.lines] == [[1], [2]]
    assert ax.get_ylim() == (3.5, -0.5)
    assert all(line.get_rasterized() for line in ax.lines)
