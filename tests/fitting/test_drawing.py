"""The figure of a fit holds the numbers of its table."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from bgmodel.fitting.drawing import draw_fits
from bgmodel.fitting.responses import QUANTILES


def cells(shift):
    rng = np.random.default_rng(1)
    names = ["accuracy", "mean_s", "sd_s", *(f"q{round(100 * q)}_s" for q in QUANTILES)]
    table = pd.DataFrame(
        {"strength": [0.1, 0.1, 0.4], "dbs": ["off", "on", "off"], "trials": 9, "answered": 9}
    )
    for name in names:
        table[name] = rng.random(3)
        table[f"model_{name}"] = table[name] + shift
    return table.assign(accuracy_se=0.1, mean_se=0.02)


@pytest.fixture
def drawn():
    figure = draw_fits({"one": cells(0.1), "other": cells(0.2)}, "somebody")
    yield figure
    plt.close(figure)


def test_each_panel_shows_data_and_every_model_by_condition(drawn):
    """Condition off has two strengths, on has one."""
    names = ("accuracy", "mean_s", "sd_s", *(f"q{round(100 * q)}_s" for q in QUANTILES))
    table = cells(0.1)
    for name in names:
        ax = drawn.axes[min(names.index(name), 3)]
        shown = [line.get_xydata() for line in ax.lines]
        for shift in (0, 0.1, 0.2):
            for rows, place in (([0, 2], [0, 1]), ([1], [0])):
                want = np.column_stack([place, table[name].iloc[rows] + shift])
                assert any(xy.shape == want.shape and np.allclose(xy, want) for xy in shown)


def test_strengths_are_on_the_axis_and_conditions_in_the_key(drawn):
    labels = [text.get_text() for text in drawn.axes[0].get_xticklabels()]
    assert labels == ["0.1", "0.4"]
    (legend,) = drawn.legends
    said = {text.get_text() for text in legend.get_texts()}
    assert said == {"one", "other", "Data, off", "Data, on"}
    assert (
        drawn.get_suptitle() == "somebody: 27 trials, 9 per point; bars: 95 % intervals of the data"
    )


def test_at_one_strength_conditions_are_on_the_axis():
    table = cells(0.1).assign(strength=1.0)[1:]
    figure = draw_fits({"one": table}, "somebody")
    assert [text.get_text() for text in figure.axes[0].get_xticklabels()] == ["on", "off"]
    assert figure.axes[0].get_xlabel() == "Condition"
    plt.close(figure)
