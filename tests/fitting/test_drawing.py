"""The figure of a fit holds the numbers of its table."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from bgmodel.fitting.drawing import draw_fits
from bgmodel.fitting.exact.responses import QUANTILES
from bgmodel.fitting.quantiles import SIDES, too_few


def cells(shift):
    rng = np.random.default_rng(1)
    names = ["accuracy", "mean_s", "sd_s", *(f"q{round(100 * q)}_s" for q in QUANTILES)]
    table = pd.DataFrame(
        {"strength": [0.1, 0.1, 0.4], "dbs": ["off", "on", "off"], "trials": 9, "answered": 9}
    )
    for name in names:
        table[name] = rng.random(3)
        table[f"model_{name}"] = table[name] + shift
    for name in SIDES:
        for q in QUANTILES:
            column = f"{name}_q{round(100 * q)}"
            table = table.assign(**{f"{column}_s": rng.random(3), f"{column}_se": 0.01})
            table[f"model_{column}_s"] = table[f"{column}_s"] + shift
    # The last cell has too few errors.
    table.loc[2, [name for name in table if name.startswith("wrong")]] = np.nan
    return table.assign(accuracy_se=0.1, mean_se=0.02, answered=[60, 60, 9], trials=9)


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


def test_quantiles_are_over_the_probability_of_each_response(drawn):
    """Errors at 1 - accuracy, where there are enough of them; models at theirs."""
    ax, table = drawn.axes[4], cells(0.1)
    shown = np.concatenate([line.get_xydata() for line in ax.lines])
    shown = shown[np.isfinite(shown).all(axis=1)]

    def there(x, y):
        return (np.abs(shown - [x, y]) < 1e-9).all(axis=1).any()

    for _, row in table.iterrows():
        for q in QUANTILES:
            name = f"q{round(100 * q)}_s"
            assert there(row["accuracy"], row[f"correct_{name}"])
            assert there(row["model_accuracy"], row[f"model_correct_{name}"])
            enough = not np.isnan(row[f"wrong_{name}"])
            assert there(1 - row["accuracy"], row[f"wrong_{name}"]) == enough
            assert there(1 - row["model_accuracy"], row[f"model_wrong_{name}"]) == enough
    assert ax.get_title(loc="right") == too_few(table) != ""


def test_at_one_strength_conditions_are_on_the_axis():
    table = cells(0.1).assign(strength=1.0)[1:]
    figure = draw_fits({"one": table}, "somebody")
    assert [text.get_text() for text in figure.axes[0].get_xticklabels()] == ["on", "off"]
    assert figure.axes[0].get_xlabel() == "Condition"
    # Conditions are categories, and no line joins them.
    lines = [line for line in figure.axes[1].lines if len(line.get_xdata()) == 2]
    assert {line.get_linestyle() for line in lines} == {"None"}
    plt.close(figure)
