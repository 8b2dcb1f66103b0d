"""The record of a fit: tables, hazards that are calibrated, JSON and a figure."""

import json

import matplotlib.pyplot as plt
import numpy as np
import pytest

from bgmodel.fitting.known.hazards import hazards
from bgmodel.fitting.known.models import EXACT
from bgmodel.fitting.known.settings import fit_one
from circuits.errors import FitWarning
from tests.known_trials import simulated


@pytest.fixture(scope="module")
def fit():
    return fit_one(EXACT["msprt"], simulated(400, 41), (), {})


def test_tables_have_a_row_for_each_free_parameter(fit):
    names = fit.likelihood.freedom.names
    assert fit.parameters()["parameter"].tolist() == names
    assert fit.summary().index.tolist() == names
    assert set(names) <= set(fit.facts())


def test_hazards_of_the_true_model_are_calibrated(fit):
    table = fit.hazards()
    z = (table["observed"] - table["predicted"]) / table["standard_error"]
    known = z[np.isfinite(z)]
    assert abs(known.mean()) < 0.5
    assert 0.6 < known.std() < 1.5
    assert (table["running"].diff().dropna() <= 0).all()


def test_hazards_at_another_threshold_are_not(fit):
    names = fit.likelihood.freedom.names
    factors = np.where(np.array(names) == "threshold", 2.0, 1.0)
    table = hazards(fit.likelihood, fit.optimum.vector * factors)
    z = (table["observed"] - table["predicted"]) / table["standard_error"]
    assert z[np.isfinite(z)].mean() < -1


def test_kernels_of_data_and_of_the_true_model_agree(fit):
    table = fit.kernels()
    data = table[table["of"] == "data"].reset_index(drop=True)
    model = table[table["of"] == "msprt"].reset_index(drop=True)
    assert len(data) == len(model)
    assert (abs(data["weight"] - model["weight"]) < 4 * data["standard_error"]).all()


def test_it_is_plain_json(fit):
    found = json.loads(json.dumps(fit.to_dict()))
    assert found["model"] == {"model": "msprt"}
    assert len(found["parameters"]) == len(fit.optimum.vector)


def test_the_figure_has_three_panels(fit):
    figure = fit.plot()
    assert [ax.get_title("left")[:1] for ax in figure.axes] == ["a", "b", "c"]
    plt.close(figure)


def test_a_gain_that_two_alternatives_can_not_give_warns():
    with pytest.warns(FitWarning):
        fit_one(EXACT["msprt"], simulated(60, 42), ("+gain",), {})
