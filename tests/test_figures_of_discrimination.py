"""Figure E2 shows the map of every pair and the trials that it needs."""

import numpy as np
import pandas as pd
from matplotlib.patches import Rectangle

from figures.common import FAST
from figures.discriminate import draw_E2 as figE2
from figures.rooms import table_path, write


def test_figure_e2_has_a_cell_per_pair_and_value(tmp_path):
    paths = [table_path(f"discriminate_{part}") for part in ("axes", "trials")]
    figure = figE2.draw(FAST, *paths, output=tmp_path)
    left, right = figure.axes
    cells = [patch for patch in left.patches if isinstance(patch, Rectangle)]
    assert len(cells) == len(pd.read_csv(paths[0]))
    told = np.isfinite(pd.read_csv(paths[1])["median"]).sum()
    crosses = [line for line in right.lines if line.get_marker() == "x" and len(line.get_xdata())]
    assert len(crosses) == told > 0


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
    paths = [tmp_path / "axes.csv", tmp_path / "trials.csv"]
    for path, table in zip(paths, (axes, trials), strict=True):
        write(table, path, seed=1, circuits={})
    left, right = figE2.draw(FAST, *paths, output=tmp_path).axes
    assert [text.get_text() for text in left.texts] == ["–", "0.2", "–", "–"]
    triangles = [line for line in right.lines if line.get_marker() == ">" and len(line.get_xdata())]
    assert [float(line.get_xdata()[0]) for line in triangles] == [900.0]


def test_simulated_experiments_have_the_predicted_medians_within_a_fifth():
    table = pd.read_csv(table_path("discriminate_trials")).dropna(subset="median")
    # Medians are whole numbers: one trial is within the error where few are needed.
    apart = (table["simulated_median"] - table["median"]).abs()
    near = (apart <= np.maximum(0.2 * table["median"], 1.0)).groupby(table["pair"]).all()
    assert near.sum() >= 3
    # A Bayes factor of 10 is wrong in at most 1 of 11 experiments, within 3 errors of 200 of them.
    assert (table["right"] > 1 - 1 / 11 - 3 * np.sqrt(10 / 11**2 / 200)).all()
