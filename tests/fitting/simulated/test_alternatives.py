"""Fits to more than two alternatives from a table, and what cannot be fitted."""

import numpy as np
import pandas as pd
import pytest

from bgmodel.fit_trials import fit
from bgmodel.fitting.design import design_of
from bgmodel.fitting.likelihood import Likelihood, likelihood_of
from bgmodel.fitting.settings import settings_of
from bgmodel.fitting.simulated.msprt import MsprtModel
from bgmodel.trials.reader import Columns, read_trials
from circuits.anatomy import load_circuit
from circuits.errors import DataWarning
from tests.fitting.simulated.drawn import TRUTH, design, table
from tests.helpers import refused

SMALL = {"trials": 1000, "columns": Columns(stimulus="shown")}
THREE = Columns(stimulus="shown", alternatives=3)
SIMULATED = MsprtModel(3, 4000, 99)
HELD = {"fix": {"t0_sd_s": 0.05, "lapse": 0.01}}


@pytest.fixture(scope="module")
def trials():
    return table(SIMULATED, 3, 600)


@pytest.fixture(scope="module")
def fits(trials):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bgmodel.fitting.optimum.POPULATION", 8)
        return {name: fit(trials, name, **SMALL, **HELD) for name in ("msprt", "race")}


def test_the_test_is_recovered_from_its_own_trials(fits):
    estimates = fits["msprt"].parameters().set_index("parameter")
    off = (estimates["value"] - pd.Series({**TRUTH, "t0_s": 0.3})) / estimates["standard_error"]
    assert np.abs(off).max() < 3


def test_a_wrong_response_is_one_of_several():
    """Coded as two alternatives, the same densities are log 2 nats higher per wrong response."""
    three = design(SIMULATED, 3, 100)
    likelihood = likelihood_of(SIMULATED, three)
    vector = np.array([2.0, 0.2, 0.3, 0.05, 0.01])
    density = likelihood.density(vector)
    wrong = int((three.observed.response == 0).sum())
    pooled = type(three.observed)(
        three.observed.cell, three.observed.response, three.observed.rt_s, three.grid
    )
    assert pooled.each(density).sum() - likelihood.design.observed.each(
        density
    ).sum() == pytest.approx(wrong * np.log(2))


def test_lapses_are_correct_in_one_of_n():
    likelihood: Likelihood = likelihood_of(SIMULATED, design(SIMULATED, 3, 100))
    plain, lapsed = (
        likelihood.density(np.array([2.0, 0.2, 0.3, 0.05, share]))[0].sum(axis=1) / 100
        for share in (0.0, 0.2)
    )
    added = lapsed - 0.8 * plain
    assert added[1] / added.sum() == pytest.approx(1 / 3, abs=1e-3)


@pytest.mark.parametrize(
    ("model", "options", "field"),
    [
        ("constant_gap", {}, "models"),
        ("falling_gap", {}, "models"),
        ("decide", {}, "models"),
        ("msprt", {"free": "+start"}, "start"),
        ("msprt", {"fix": {"start": 0.1}, "columns": THREE}, "start"),
        ("race", {"free": "+drift_sd", "columns": THREE}, "drift_sd"),
        ("macaque", {"mechanism": "dopamine"}, "mechanism"),
        (load_circuit("macaque", 2), {}, "circuit"),
        (load_circuit("macaque", 4), {}, "circuit"),
        ("lca", {"trials": 20}, "trials"),
        ("msprt", {"evidence": "evidence.csv"}, "stimulus"),
    ],
)
def test_what_cannot_be_fitted_is_named(trials, model, options, field):
    with refused(field):
        fit(trials, model, **{**SMALL, **options})


def test_a_hierarchy_is_of_two_alternatives(trials):
    people = pd.concat([trials.assign(participant_id=who) for who in ("a", "b")])
    with refused("alternatives"), pytest.warns(DataWarning):
        fit(people, "msprt", **SMALL, people="hierarchical")


def test_responses_below_chance_are_refused(trials):
    shifted = trials.assign(shown=trials["shown"].map({"a": "b", "b": "c", "c": "a"}))
    with refused("response"):
        design_of(read_trials(shifted, columns=Columns(stimulus="shown")))


def test_settings_pass_the_number_on():
    asked = settings_of(columns=Columns(alternatives=4), trials=1000)
    assert asked.model("msprt").alternatives == 4
    assert asked.model("macaque").circuit.channels == 4
