"""One fit as tables."""

from dataclasses import replace

import numpy as np
import pytest

from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.design import design_of
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.person_fit import cells_of, fit_likelihood, widened
from bgmodel.fitting.posterior import Posterior
from bgmodel.fitting.responses import QUANTILES
from bgmodel.fitting.responses import moments as of_density
from bgmodel.fitting.simulated.error import SimulationErrors
from tests.drawn import TRUTH, drawn

pytestmark = pytest.mark.usefixtures("brief_search")
MODEL = GapModel()
FREE = ["sensitivity", "bound", "t0_s"]


@pytest.fixture(scope="module")
def likelihood():
    some = drawn(MODEL, [0.05, 0.4], 400, 61, seconds=2.0, sensitivity=12.0, bound=0.6)
    held = {name: TRUTH[name] for name in ("t0_sd_s", "lapse")}
    return likelihood_of(MODEL, design_of(some), fixed=held)


@pytest.fixture(scope="module")
def fit(likelihood):
    return fit_likelihood(likelihood)


def test_there_is_one_row_per_number_with_its_error(fit):
    table = fit.parameters()
    assert table["parameter"].tolist() == FREE
    assert table["value"].tolist() == fit.optimum.vector.tolist()
    assert table["standard_error"].tolist() == fit.directions.standard_errors.tolist()
    assert table[["low", "high"]].isna().all(axis=None)
    assert not table["at_bound"].any()
    assert fit.simulation.log_likelihood == 0  # the model is exact
    assert (table["simulation_error"] == 0).all()
    assert np.array_equal(fit.directions.vector, fit.optimum.vector)


def test_cells_hold_data_beside_the_model(fit, likelihood):
    table, design = fit.cells(), likelihood.design
    assert {f"q{percent}_s" for percent in (10, 30, 50, 70, 90)} < set(table)
    seen = design.observed
    for cell, row in table.iterrows():
        some = seen.cell == cell
        rt, right = seen.rt_s[some], seen.response[some]
        assert row["trials"] == row["answered"] == some.sum()
        assert [row["accuracy"], row["mean_s"], row["sd_s"]] == [right.mean(), rt.mean(), rt.std()]
        assert row["correct_s"] == rt[right == 1].mean()
        assert row["wrong_s"] == rt[right == 0].mean()
        assert row["mean_se"] == pytest.approx(rt.std() / np.sqrt(len(rt)))
        assert row["accuracy_se"] == pytest.approx(right.std() / np.sqrt(len(right)))
        for q in QUANTILES:
            assert row[f"q{round(100 * q)}_s"] == np.quantile(rt, q)
            assert row[f"model_q{round(100 * q)}_s"] == pytest.approx(np.quantile(rt, q), abs=0.06)
    whole = fit.optimum.complete
    moments = of_density(whole.density, whole.likelihood.design.grid)
    assert table["model_accuracy"].to_numpy() == pytest.approx(moments["accuracy"], rel=1e-12)
    assert table["model_mean_s"].to_numpy() == pytest.approx(moments["mean_s"], rel=1e-12)
    # In the test times of both responses are alike, where those that are wrong are no lapses.
    assert table["model_correct_s"][0] == pytest.approx(table["model_wrong_s"][0], abs=0.02)


def test_a_cell_without_any_response_is_empty_and_not_an_error():
    some = drawn(MODEL, [0.05, 0.4], 30, 63, deadline_s=1.0, sensitivity=12.0, bound=0.6)
    design = design_of(some)
    rest = design.part(np.flatnonzero(design.observed.cell == 1))
    table = cells_of(rest, np.ones((2, 2, design.grid.bins)))
    assert table["answered"].tolist() == [0, 30 - (rest.observed.response < 0).sum()]
    assert np.isnan(table.loc[0, ["accuracy", "mean_s", "q50_s"]].astype(float)).all()
    assert np.isfinite(table.loc[1, "mean_s"])


def test_the_error_of_the_simulation_is_part_of_standard_errors_and_intervals(fit):
    se = 2 * fit.directions.standard_errors
    drawn_ = normal(fit.optimum.vector, se, FREE)
    simulated = replace(fit, simulation=SimulationErrors(0.5, se), posterior=drawn_)
    table = simulated.parameters()
    expected = np.sqrt(5) * fit.directions.standard_errors
    assert table["standard_error"].to_numpy() == pytest.approx(expected)
    assert table["simulation_error"].tolist() == se.tolist()
    assert pytest.approx(widened(drawn_, se)) == table[["low", "high"]].to_numpy().T
    assert (table["low"] < drawn_.interval(0.9)[0]).all()


def test_where_the_error_of_the_simulation_is_unknown_that_of_the_data_remains(fit):
    se = np.array([np.nan, 0.1, 0.1])
    table = replace(fit, simulation=SimulationErrors(0.5, se)).parameters()
    assert np.isnan(table["simulation_error"]).tolist() == [True, False, False]
    assert table["standard_error"][0] == fit.directions.standard_errors[0]


def normal(middle, sd, names):
    draws = np.random.default_rng(1).normal(middle, sd, (100_000, len(names)))
    return Posterior(names, draws, np.zeros(len(draws)), 1.0, 100.0)


def test_an_interval_widens_by_the_error_of_the_simulation_if_it_is_known():
    """Two Gaussian errors add as squares."""
    drawn_ = normal(1.0, 0.3, ["a"])
    low, high = widened(drawn_, np.array([0.4]))
    assert (high - low) / 2 == pytest.approx(1.645 * 0.5, rel=0.02)
    for none in (0.0, np.nan):
        assert np.array_equal(widened(drawn_, np.array([none])), drawn_.interval(0.9))
