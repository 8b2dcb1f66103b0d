"""The figure of a fit holds the numbers of its table."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from bgmodel.fitting.drawing import draw_fits
from bgmodel.fitting.fit import QUANTILES


def cells(shift):
    rng = np.random.default_rng(1)
    names = ["accuracy", "mean_s", "sd_s", *(f"q{round(100 * q)}_s" for q in QUANTILES)]
    table = pd.DataFrame({"strength": [0.1, 0.1, 0.4], "dbs": ["off", "on", "off"], "trials": 9})
    for name in names:
        table[name] = rng.random(3)
        table[f"model_{name}"] = table[name] + shift
    return table.assign(accuracy_se=0.1, mean_se=0.02)


@pytest.fixture
def drawn():
    figure = draw_fits({"one": cells(0.1), "other": cells(0.2)}, "somebody")
    yield figure
    plt.close(figure)


def test_each_panel_shows_data_and_every_model(drawn):
    table = cells(0.1)
    for ax, name in zip(drawn.axes, ("accuracy", "mean_s", "sd_s"), strict=False):
        shown = [line.get_ydata() for line in ax.lines if len(line.get_ydata()) == 3]
        for shift in (0, 0.1, 0.2):
            assert any(np.allclose(y, table[name] + shift) for y in shown)
    quantiles = [line.get_ydata() for line in drawn.axes[3].lines]
    assert len(quantiles) == 3 * len(QUANTILES)
    for k, q in enumerate(QUANTILES):
        assert np.allclose(quantiles[k], table[f"q{round(100 * q)}_s"])
        assert np.allclose(quantiles[5 + k], table[f"model_q{round(100 * q)}_s"])


def test_cells_are_named_by_what_differs_between_them(drawn):
    labels = [text.get_text() for text in drawn.axes[0].get_xticklabels()]
    assert labels == ["0.1\noff", "0.1\non", "0.4\noff"]
    assert [text.get_text() for text in drawn.axes[0].get_legend().get_texts()] == [
        "one",
        "other",
        "data",
    ] or len(drawn.axes[0].get_legend().get_texts()) == 3
    assert drawn.get_suptitle() == "somebody"
