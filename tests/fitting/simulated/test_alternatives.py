"""Fits to more than two alternatives from a table, and what cannot be fitted."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bgmodel.fit_trials import fit
from bgmodel.fitting.design import design_of
from bgmodel.fitting.likelihood import Likelihood, likelihood_of
from bgmodel.fitting.responses import BIN_S, Grid, moments
from bgmodel.fitting.settings import settings_of
from bgmodel.fitting.simulated.alternatives import (
    EVIDENCE_BIN,
    UNIT,
    ManyCircuitModel,
    count,
    simulated_many,
)
from bgmodel.fitting.simulated.msprt import MsprtModel
from bgmodel.trials.reader import Columns, read_trials
from circuits.anatomy import load_circuit
from circuits.errors import DataWarning
from tests.drawn import GAIN, drawn, ideal
from tests.helpers import refused, refusing

SMALL = {"trials": 1000, "columns": Columns(stimulus="shown")}
THREE = Columns(stimulus="shown", alternatives=3)
SIMULATED = MsprtModel(3, 4000, 99)
TRUTH = {"sensitivity": 2.0, "threshold_nats": 0.2}


def person(trials, seed=5):
    """Return the choices of a person between three alternatives, all of one strength."""
    some = drawn(SIMULATED, [1.0], trials, seed, deadline_s=3.0, alternatives=3, **TRUTH)
    return replace(some, strength=None)


def table(trials, seed=5):
    """Return trials as a user's table, with names of responses and of the correct ones."""
    some, rng = person(trials, seed), np.random.default_rng(seed)
    some = some.where(some.response >= 0)
    right = rng.integers(3, size=some.trials)
    chosen = np.where(some.response == 1, right, (right + rng.integers(1, 3, some.trials)) % 3)
    names = np.array(list("abc"))
    return pd.DataFrame({"rt": some.rt_s, "response": names[chosen], "shown": names[right]})


@pytest.fixture(scope="module")
def trials():
    return table(600)


@pytest.mark.usefixtures("brief_search")
def test_the_test_is_recovered_from_its_own_trials(trials):
    made = fit(trials, "msprt", **SMALL, fix={"t0_sd_s": 0.05, "lapse": 0.01})
    estimates = made.parameters().set_index("parameter")
    off = (estimates["value"] - pd.Series({**TRUTH, "t0_s": 0.3})) / estimates["standard_error"]
    assert np.abs(off).max() < 3


def test_a_wrong_response_is_one_of_several():
    """Coded as two alternatives, the same densities are log 2 nats higher per wrong response."""
    three = design_of(person(100))
    likelihood = likelihood_of(SIMULATED, three)
    vector = np.array([2.0, 0.2, 0.3, 0.05, 0.01])
    density = likelihood.density(vector)
    wrong = int((three.observed.response == 0).sum())
    pooled = replace(three.observed, deadline_s=None, alternatives=2)
    more = pooled.each(density).sum() - three.observed.each(density).sum()
    assert more == pytest.approx(wrong * np.log(2))


def test_lapses_are_correct_in_one_of_n():
    likelihood: Likelihood = likelihood_of(SIMULATED, design_of(person(100)))
    plain, lapsed = (
        likelihood.density(np.array([2.0, 0.2, 0.3, 0.05, share]))[0].sum(axis=1) / 100
        for share in (0.0, 0.2)
    )
    added = lapsed - 0.8 * plain
    assert added[1] / added.sum() == pytest.approx(1 / 3, abs=1e-3)


def asking(model, **options):
    return lambda: fit(table(600), model, **{**SMALL, **options})


test_what_cannot_be_fitted_is_named = refusing(
    (asking("constant_gap"), "models"),
    (asking("falling_gap"), "models"),
    (asking("decide"), "models"),
    (asking("msprt", free="+start"), "free must name a parameter"),
    (asking("msprt", fix={"start": 0.1}, columns=THREE), "fix must name a parameter"),
    (asking("race", free="+drift_sd", columns=THREE), "free must name a parameter"),
    (asking("macaque", mechanism="dopamine"), "mechanism"),
    (asking(load_circuit("macaque", 2)), "circuit"),
    (asking(load_circuit("macaque", 4)), "circuit"),
    (lambda: ManyCircuitModel(load_circuit("macaque", 2), "rate"), "circuit"),
    (asking("lca", trials=20), "trials"),
    (asking("msprt", evidence="evidence.csv"), "stimulus"),
)


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


GRID = Grid(300)
OVERSHOOT = 0.5826 * GAIN * np.sqrt(BIN_S)
"""Mean overshoot of the log odds of two channels at a reading (Siegmund 1985), nats."""
ODDS = 1.2


@pytest.fixture(scope="module")
def stored():
    threshold = np.log1p(np.exp(-np.array([ODDS])))
    return simulated_many(ideal, threshold, 3, seconds=3.0, trials=1500, seed=7)


@pytest.mark.parametrize("drift", [0.5, 1.5])
def test_a_drift_that_was_not_simulated_is_decided_as_by_the_continuous_test(stored, drift):
    """At a threshold higher by the overshoot of readings; noise of readings reweights to it."""
    mass = stored.decided([(0, 1.0)], drift)
    values = {"sensitivity": GAIN / 2, "threshold_nats": np.log1p(np.exp(-ODDS - OVERSHOOT))}
    # A gain of twice the mean drift: strengths of mean 1.
    strengths = np.array([drift, 2 - drift])
    every = {name: np.full(2, value) for name, value in values.items()}
    exact = MsprtModel(3, 16_000, 5).decided(every, strengths, GRID)[0]
    one, other = (moments(each[None] / BIN_S, GRID) for each in (mass, exact))
    assert one["accuracy"][0] == pytest.approx(other["accuracy"][0], abs=0.025)
    # The test of the readings decides half a reading after it crosses, on average.
    assert one["mean_s"][0] == pytest.approx(other["mean_s"][0], rel=0.04)


def model(folder=None):
    circuit = load_circuit("macaque", 3)
    return ManyCircuitModel(circuit, "rate", seconds=1.0, trials=16, folder=folder)


def test_stored_files_are_read_back_as_they_were(tmp_path, monkeypatch):
    first = model(tmp_path)._crossings
    monkeypatch.setattr("bgmodel.fitting.simulated.alternatives.simulated_many", None)
    again = model(tmp_path)._crossings
    for name in ("bins", "choice", "evidence"):
        one, other = getattr(first, name), getattr(again, name)
        assert np.array_equal(one, other)
        assert one.dtype == other.dtype


def test_the_threshold_reaches_the_prior():
    high = model().thresholds_nats[-1]
    assert np.exp(-high) == pytest.approx(1 / 3, abs=0.05)
    assert np.exp(-high) > 1 / 3


@pytest.mark.parametrize("choice", [-1, 1])
def test_grids_of_evidence_keep_every_trial_and_its_mean(choice):
    """Without drift each channel of a trial counts 1, wherever its evidence is between places."""
    evidence, low = np.array([[312, -97, 5]]), -30
    decided, never = np.zeros((2, 6, 61)), np.zeros(61)
    one = np.array([True])
    count(np.array([3]), np.array([choice]), evidence, one, np.array([0.0]), low, decided, never)
    grid = decided.sum(axis=(0, 1)) if choice >= 0 else never
    z = (low + np.arange(61)) * EVIDENCE_BIN
    assert (grid.sum(), grid @ z) == pytest.approx((3, UNIT * evidence.sum()))
    assert decided[1].sum() == (choice >= 0)
