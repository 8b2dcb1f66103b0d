"""Quantiles of response times in tables, against NumPy and by hand, and figures of fits."""

from itertools import product

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.design import design_of
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.person_fit import cells_of
from bgmodel.fitting.quantiles import (
    FEWEST,
    SIDES,
    draw_fits,
    observed_quantiles,
    phrase,
    predicted_quantiles,
    residuals,
    too_few,
)
from bgmodel.fitting.responses import BIN_S, QUANTILES
from tests.drawn import TRUTH, drawn

MODEL, VALUES = GapModel(), {"sensitivity": 8.0, "bound": 0.6}
NAMES = [f"{name}_q{round(100 * q)}" for name in SIDES for q in QUANTILES]
SUMMED = ["accuracy", "mean_s", "sd_s", *(f"q{round(100 * q)}_s" for q in QUANTILES)]


@pytest.fixture(scope="module")
def cells():
    """Return the cells of many trials at the truth; errors hardly ever occur at 0.9."""
    design = design_of(drawn(MODEL, [0.0, 0.1, 0.9], 2000, 64, **VALUES))
    likelihood = likelihood_of(MODEL, design, free=list(VALUES), fixed=TRUTH)
    return cells_of(design, likelihood.density(np.array(list(VALUES.values()))))


def test_quantiles_are_those_of_each_response_in_data_and_model(cells):
    few = cells["strength"] == 0.9
    for name in NAMES:
        z = (cells[f"{name}_s"] - cells[f"model_{name}_s"]) / cells[f"{name}_se"]
        assert (z[~few].abs() < 4).all()
    # Quantiles of one response differ from those of the other and of all.
    assert (cells["model_wrong_q90_s"] > cells["model_wrong_q70_s"] + 0.01).all()


def test_errors_of_the_data_are_not_those_of_correct_responses():
    rng = np.random.default_rng(65)
    rt_s, response = rng.uniform(0, 1, 400), np.repeat([0, 1], 200)
    rt_s[:200] += 3
    row = observed_quantiles(rt_s, response)
    for q in QUANTILES:
        name = f"q{round(100 * q)}"
        assert row[f"correct_{name}_s"] == pytest.approx(q, abs=0.12)
        assert row[f"wrong_{name}_s"] == pytest.approx(3 + q, abs=0.12)
        # Of uniform times: sqrt(q (1 - q) / n).
        assert row[f"wrong_{name}_se"] == pytest.approx(np.sqrt(q * (1 - q) / 200), rel=0.4)


def test_predicted_quantiles_of_an_exponential_time_are_its_own():
    edges = np.arange(1001) * BIN_S
    mass = np.stack([np.diff(-np.exp(-edges / 0.5)), 0.2 * np.diff(-np.exp(-edges / 1.0))])
    row = predicted_quantiles(mass, BIN_S)
    for q in QUANTILES:
        percent = round(100 * q)
        assert row[f"model_wrong_q{percent}_s"] == pytest.approx(-0.5 * np.log(1 - q), abs=2e-3)
        assert row[f"model_correct_q{percent}_s"] == pytest.approx(-np.log(1 - q), abs=2e-3)


def test_a_response_that_is_rare_has_no_quantiles_and_the_cell_is_counted(cells):
    rare = cells["strength"] == 0.9
    wrong = [f"{name}_s" for name in NAMES if name.startswith("wrong")]
    assert cells.loc[rare, wrong].isna().all(axis=None)
    assert cells.loc[~rare, wrong].notna().all(axis=None)
    assert cells[[f"model_{name}" for name in wrong]].notna().all(axis=None)
    assert "1 of 3 cells" in too_few(cells)
    assert too_few(cells[~rare]) == ""
    rows = residuals(cells)
    assert len(rows) == 5 * 5
    assert (rows["responses"] >= FEWEST).all()


@pytest.mark.parametrize("short", [0, 1])
def test_the_fewest_responses_with_quantiles(short):
    rt_s = np.linspace(0.3, 0.9, FEWEST - short)
    row = observed_quantiles(rt_s, np.ones(len(rt_s), int))
    assert np.isfinite(row["correct_q10_se"]) == (not short)
    assert np.isnan(row["wrong_q50_s"])


def test_residuals_are_sorted_by_their_size_in_standard_errors(cells):
    rows = residuals(cells)
    assert rows["z"].abs().is_monotonic_decreasing
    assert rows["residual_ms"].to_numpy() == pytest.approx(rows["data_ms"] - rows["model_ms"])
    assert rows["z"].to_numpy() == pytest.approx(rows["residual_ms"] / rows["se_ms"])
    assert rows["z"].std() == pytest.approx(1, abs=0.35)


def test_times_that_are_all_the_same_have_no_residual(cells):
    same = cells.assign(**{f"{name}_se": 0.0 for name in NAMES})
    assert residuals(same).empty
    assert list(residuals(same)) == list(residuals(cells))


def test_conditions_are_columns_of_the_residuals(cells):
    table = cells.copy()
    table.insert(1, "drug", "on")
    table.insert(0, "participant", "a")
    rows = residuals(table)
    assert list(rows)[:3] == ["strength", "drug", "response"]
    assert ", drug on" in phrase(rows.iloc[0].to_dict())


def shifted(shift):
    """Return a table of cells whose predictions are the data, shifted."""
    rng = np.random.default_rng(1)
    columns = {"strength": [0.1, 0.1, 0.4], "dbs": ["off", "on", "off"], "trials": 9}
    columns["answered"] = [60, 60, 9]
    for name in (*SUMMED, *(f"{each}_s" for each in NAMES)):
        columns[name] = rng.random(3)
        columns[f"model_{name}"] = columns[name] + shift
    errors = dict.fromkeys([f"{each}_se" for each in NAMES], 0.01)
    table = pd.DataFrame({**columns, **errors, "accuracy_se": 0.1, "mean_se": 0.02})
    # The last cell has too few errors.
    table.loc[2, [name for name in table if name.startswith("wrong")]] = np.nan
    return table


@pytest.fixture(scope="module")
def figure():
    made = draw_fits({"one": shifted(0.1), "other": shifted(0.2)}, "somebody")
    yield made
    plt.close(made)


def test_each_panel_shows_data_and_every_model_by_condition(figure):
    """Condition off has two strengths, on has one."""
    table = shifted(0.1)
    for k, name in enumerate(SUMMED):
        ax = figure.axes[min(k, 3)]
        shown = [line.get_xydata() for line in ax.lines]
        for shift in (0, 0.1, 0.2):
            for rows, place in (([0, 2], [0, 1]), ([1], [0])):
                want = np.column_stack([place, table[name].iloc[rows] + shift])
                assert any(xy.shape == want.shape and np.allclose(xy, want) for xy in shown)


def test_quantiles_are_over_the_probability_of_each_response(figure):
    """Errors at 1 - accuracy, where there are enough of them; models at theirs."""
    ax, table = figure.axes[4], shifted(0.1)
    shown = np.concatenate([line.get_xydata() for line in ax.lines])
    shown = shown[np.isfinite(shown).all(axis=1)]

    def there(x, y):
        return (np.abs(shown - [x, y]) < 1e-9).all(axis=1).any()

    for (_, row), q, of in product(table.iterrows(), QUANTILES, ("", "model_")):
        name, share = f"q{round(100 * q)}_s", row[f"{of}accuracy"]
        assert there(share, row[f"{of}correct_{name}"])
        enough = not np.isnan(row[f"wrong_{name}"])
        assert there(1 - share, row[f"{of}wrong_{name}"]) == enough
    assert ax.get_title(loc="right") == too_few(table) != ""


def test_at_one_strength_conditions_are_on_the_axis():
    table = shifted(0.1).assign(strength=1.0)[1:]
    figure = draw_fits({"one": table}, "somebody")
    assert [text.get_text() for text in figure.axes[0].get_xticklabels()] == ["on", "off"]
    assert figure.axes[0].get_xlabel() == "Condition"
    # Conditions are categories, and no line joins them.
    lines = [line for line in figure.axes[1].lines if len(line.get_xdata()) == 2]
    assert {line.get_linestyle() for line in lines} == {"None"}
    plt.close(figure)
