"""Misfit is reported for data that the model cannot fit, and not for clean data."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.stats import binom, chi2

from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.design import design_of
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.misfit import FIXED, TOGETHER, Excess, group_misfit, misfit
from bgmodel.fitting.optimum import Optimum
from bgmodel.fitting.posterior import directions
from bgmodel.fitting.responses import moments
from bgmodel.fitting.simulated.circuit_model import CircuitModel
from bgmodel.fitting.simulated.error import jackknifed, without_parts
from circuits.anatomy import load_circuit
from tests.drawn import TRUTH, choices, drawn
from tests.fitting.conftest import fitted_with

MODEL, SEED = GapModel(), 92
STRENGTHS = [0.0, 0.1, 0.2, 0.4]
VALUES = {"sensitivity": 8.0, "bound": 0.7}
CLEAN = drawn(MODEL, STRENGTHS, 500, SEED, seconds=4.0, **VALUES)
FREE = ["sensitivity", "bound", "t0_s", "t0_sd_s", "lapse"]


def fitted(some):
    """Return a fit, and its warnings of a misfit."""
    return fitted_with("does not fit", likelihood_of(MODEL, design_of(some), free=FREE))


def truth(some, sensitivity=8.0, **options):
    """Return a fit of the model that made the data, with its parameters."""
    values = {**TRUTH, **VALUES, "sensitivity": sensitivity}
    likelihood = likelihood_of(MODEL, design_of(some, **options), free=FREE)
    vector = np.array([values[name] for name in likelihood.freedom.names])
    return Optimum(likelihood, vector, 0.0, 0)


def at_truth(some, **options):
    """Return the misfit of data to the model that they were drawn from."""
    return misfit(truth(some, **options))


def guessing():
    """Return choices, a fifth of them fast guesses."""
    rng = np.random.default_rng(SEED)
    guess = rng.random(CLEAN.trials) < 0.2
    rt_s = np.where(guess, rng.uniform(0.15, 0.3, CLEAN.trials), CLEAN.rt_s)
    response = np.where(guess, rng.integers(0, 2, CLEAN.trials), CLEAN.response)
    return replace(CLEAN, rt_s=rt_s, response=response.astype(np.int8))


def mixed_units():
    """Return choices with half of the strengths in per cent."""
    half = np.arange(CLEAN.trials) % 4 < 2
    return replace(CLEAN, strength=np.where(half, 100.0, 1.0) * CLEAN.strength)


def varying():
    """Return choices whose drift differs from trial to trial."""
    return drawn(MODEL, STRENGTHS, 500, SEED, seconds=4.0, drift_sd=4.0, **VALUES)


@pytest.mark.parametrize("some", [guessing, mixed_units, varying])
def test_data_that_the_model_does_not_fit_are_said_with_the_worst_cell(some):
    fit, (text,) = fitted(some())
    worst = fit.cells()[["z_accuracy", "z_mean_rt"]].abs().max(axis=1).idxmax()
    assert fit.optimum.likelihood.design.label(worst) in text
    assert 3 * min(fit.misfit.p.values()) < 0.003


def test_z_scores_are_those_of_the_data_in_standard_deviations_of_the_model():
    fit, _ = fitted(CLEAN)
    table, whole = fit.cells(), fit.optimum.complete
    expected = moments(whole.density, whole.likelihood.design.grid)
    n = table["trials"]
    sd = np.sqrt(expected["accuracy"] * (1 - expected["accuracy"]) / n)
    z = (table["accuracy"] - expected["accuracy"]) / sd
    assert table["z_accuracy"].to_numpy() == pytest.approx(z.to_numpy())
    z = (table["mean_s"] - expected["mean_s"]) / (expected["sd_s"] / np.sqrt(n))
    assert table["z_mean_rt"].to_numpy() == pytest.approx(z.to_numpy())


@pytest.mark.parametrize("case", [{"rt_window": (0.45, 0.8)}, {"rt_window": (0.0, 9.0)}, {}])
@pytest.mark.parametrize("deadline_s", [None, 0.7])
@pytest.mark.filterwarnings("ignore:all. .* response times are excluded")
def test_at_the_truth_p_values_are_those_of_chance(case, deadline_s):
    """Within a window and by a deadline too: mean p of 0.5, within 4 standard errors of 20 sets."""
    misfits = [
        at_truth(drawn(MODEL, STRENGTHS, 200, k, deadline_s=deadline_s, **VALUES), **case)
        for k in range(20)
    ]
    for name in misfits[0].p:
        p = np.array([each.p[name] for each in misfits])
        assert p.mean() == pytest.approx(0.5, abs=4 / np.sqrt(12 * len(p)))
        assert p.min() > 1e-3
    z = np.array([[each.z_accuracy, each.z_mean_rt] for each in misfits])
    assert z.std() == pytest.approx(1, abs=0.25)


def test_a_cell_without_a_response_has_no_z_score_and_does_no_harm():
    some = drawn(MODEL, STRENGTHS, 100, SEED, seconds=4.0, deadline_s=2.0, **VALUES)
    none = np.abs(some.strength) == 0.4
    response = np.where(none, -1, some.response).astype(np.int8)
    checked = at_truth(replace(some, response=response, rt_s=np.where(none, np.nan, some.rt_s)))
    assert np.isnan([checked.z_accuracy[3], checked.z_mean_rt[3]]).all()
    assert np.isfinite(checked.z_accuracy[:3]).all()
    # That many misses are no chance.
    assert checked.p["the distribution of responses and their times"] < 1e-6


@given(
    off=hnp.arrays(float, 6, elements=st.floats(-5, 5)),
    fixed=st.integers(0, 2),
    small=st.integers(0, 3),
)
def test_p_is_that_of_a_chi_square_with_a_degree_of_freedom_per_free_sum(off, fixed, small):
    """Sums of few trials count as one, those that data and model share as none (Pearson 1900)."""
    variance, size = np.linspace(0.5, 2, 6), np.where(np.arange(6) < small, 2.0, 50.0)
    few = size < 20
    chi_square = (off**2 / variance)[~few].sum()
    if small:
        chi_square += off[few].sum() ** 2 / variance[few].sum()
    p = Excess(off, variance, np.zeros((0, 6)), size).p(20, fixed)
    assert p == pytest.approx(chi2.sf(chi_square, 6 - max(small - 1, 0) - fixed), rel=1e-9)


def test_data_and_model_share_the_number_of_trials_and_nothing_else():
    """As many sums are fixed as add up to zero, however far the data are off."""
    excess = at_truth(guessing()).excess
    fixed = {name: int(abs(each.off.sum()) < 1e-6) for name, each in excess.items()}
    assert fixed == FIXED


def test_the_error_of_simulated_trials_is_part_of_the_z_scores():
    seen = choices([0.1] * 40 + [0.4] * 40, [1, 0, 1, 1] * 20, 0.4 + np.arange(80) / 200)
    model = CircuitModel(load_circuit("bogacz_gurney", 2), "algebra", seconds=1.0, trials=16)
    likelihood = likelihood_of(model, design_of(seen), free=["threshold_nats"])
    best = Optimum(likelihood, np.array([0.25]), 0.0, 0)
    left = without_parts(likelihood, directions(likelihood, best.vector))
    alone, with_error = misfit(best), misfit(best, left)
    assert (np.abs(with_error.z_accuracy) < np.abs(alone.z_accuracy)).all()
    assert (np.abs(with_error.z_mean_rt) < np.abs(alone.z_mean_rt)).all()
    assert all(with_error.p[name] >= p for name, p in alone.p.items())


GROUP_SEED = 24_391
PEOPLE = {"anna": 8.0, "ben": 9.0, "cleo": 10.0, "dora": 11.0, "eve": 12.0, "finn": 13.0}


def people(seed=GROUP_SEED, each=50, bound=0.7):
    return {
        who: drawn(MODEL, STRENGTHS, each, seed + k, sensitivity=sensitivity, bound=bound)
        for k, (who, sensitivity) in enumerate(PEOPLE.items())
    }


def group_at_truth(choices):
    """Return the misfit to the test with the parameters that made the data."""
    return group_misfit({who: truth(some, PEOPLE[who]) for who, some in choices.items()})


def test_groups_without_misfit_are_reported_as_often_as_stated():
    groups = 50
    seen = [group_at_truth(people(seed=GROUP_SEED + 1000 * number)) for number in range(groups)]
    p = np.array([list(each.together.values()) for each in seen])
    most = binom.ppf(0.999, groups, 0.05)
    assert (p < 0.05).sum(axis=0).max() <= most
    assert (p > 0.95).sum(axis=0).max() <= most
    assert np.abs(p.mean(axis=0) - 0.5).max() < 4 * np.sqrt(1 / 12 / groups)
    assert sum(not each.beyond_chance().empty for each in seen) <= binom.ppf(0.999, groups, 0.003)


def test_a_misfit_of_all_that_is_seen_in_nobody_is_found():
    misfit = group_at_truth(people(bound=0.77))
    assert {who for who, _ in misfit.beyond_chance().index} == {TOGETHER}
    assert len(misfit.cautions()) == 1
    assert not re.search("and .* more[.]", misfit.cautions()[0])  # all are named


def test_cells_are_summed_by_strength_whoever_lacks_one():
    """Accuracy is raised at one strength and lowered at another: one sum of both would hide it."""
    choices, rng = people(each=100), np.random.default_rng(GROUP_SEED)
    for who, some in choices.items():
        response = some.response.copy()
        for strength, to in ((0.1, 1), (0.4, 0)):
            changed = (some.strength == strength) & (rng.random(some.trials) < 0.15)
            response[changed] = to
        keep = (some.strength > 0) | (who != "ben")
        choices[who] = replace(some, response=response).where(keep)
    misfit = group_at_truth(choices)
    assert len(misfit.cells["ben"]) == len(STRENGTHS) - 1
    assert misfit.together["accuracy"] < 1e-4
    by_strength = dict.fromkeys(STRENGTHS, 0.0)
    for who, each in misfit.people.items():
        for (strength,), off in zip(misfit.cells[who], each.excess["accuracy"].off, strict=True):
            by_strength[strength] += off
    off = misfit.sums("accuracy").off
    assert sorted(off) == pytest.approx(sorted(by_strength.values()))


def test_the_error_of_shared_simulated_trials_adds_up():
    """Drawn trials are independent, so their variances add; simulated ones are the same twice."""
    parts = np.random.default_rng(GROUP_SEED).normal(size=(8, 3))
    one = Excess(np.ones(3), np.full(3, 0.5), parts, np.full(3, 40.0))
    both = one + one
    assert both.variance == pytest.approx(2 * one.variance)
    assert jackknifed(both.parts) ** 2 == pytest.approx(4 * jackknifed(one.parts) ** 2)
    assert both.p(5) < one.p(5)
    assert replace(both, parts=np.zeros((0, 3))).p(5) < both.p(5)
