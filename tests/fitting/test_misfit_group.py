"""Data of a group that a hierarchical fit cannot describe are reported, and clean data are not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.design import design_of
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.misfit import TOGETHER, Excess, group_misfit
from bgmodel.fitting.optimum import Optimum
from bgmodel.fitting.simulated.error import jackknifed
from tests.drawn import TRUTH, drawn
from tests.fitting.test_misfit import FREE

STRENGTHS, SEED = [0.0, 0.1, 0.2, 0.4], 24_391
PEOPLE = {"anna": 8.0, "ben": 9.0, "cleo": 10.0, "dora": 11.0, "eve": 12.0, "finn": 13.0}


def person(sensitivity, seed, each=50, strengths=STRENGTHS, bound=0.7):
    """Return the trials of a person."""
    return drawn(
        GapModel(), strengths, each, seed, seconds=4.0, sensitivity=sensitivity, bound=bound
    )


def people(seed=SEED, each=50, bound=0.7):
    """Return the trials of all people."""
    return {
        who: person(sensitivity, seed + number, each, bound=bound)
        for number, (who, sensitivity) in enumerate(PEOPLE.items())
    }


def at_truth(choices):
    """Return the misfit to the test with the parameters that made the data."""
    optima = {}
    for who, some in choices.items():
        likelihood = likelihood_of(GapModel(), design_of(some), free=FREE)
        values = {**TRUTH, "sensitivity": PEOPLE[who], "bound": 0.7}
        vector = np.array([values[name] for name in likelihood.freedom.names])
        optima[who] = Optimum(likelihood, vector, 0.0, 0)
    return group_misfit(optima)


def test_groups_without_misfit_are_reported_as_often_as_stated():
    groups = 50
    seen = [at_truth(people(seed=SEED + 1000 * number)) for number in range(groups)]
    p = np.array([list(each.together.values()) for each in seen])
    most = binom.ppf(0.999, groups, 0.05)
    assert (p < 0.05).sum(axis=0).max() <= most
    assert (p > 0.95).sum(axis=0).max() <= most
    assert np.abs(p.mean(axis=0) - 0.5).max() < 4 * np.sqrt(1 / 12 / groups)
    assert sum(not each.beyond_chance().empty for each in seen) <= binom.ppf(0.999, groups, 0.003)


def test_a_misfit_of_all_that_is_seen_in_nobody_is_found():
    misfit = at_truth(people(bound=0.77))
    assert {who for who, _ in misfit.beyond_chance().index} == {TOGETHER}
    assert len(misfit.cautions()) == 1


def test_cells_are_summed_by_strength_whoever_lacks_one():
    """Accuracy is raised at one strength and lowered at another: one sum of both would hide it."""
    choices, rng = people(each=100), np.random.default_rng(SEED)
    for who, some in choices.items():
        response = some.response.copy()
        for strength, to in ((0.1, 1), (0.4, 0)):
            changed = (some.strength == strength) & (rng.random(some.trials) < 0.15)
            response[changed] = to
        keep = (some.strength > 0) | (who != "ben")
        choices[who] = replace(some, response=response).where(keep)
    misfit = at_truth(choices)
    assert len(misfit.cells["ben"]) == len(STRENGTHS) - 1
    assert misfit.together["accuracy"] < 1e-4
    by_strength = dict.fromkeys([0.0, 0.1, 0.2, 0.4], 0.0)
    for who, each in misfit.people.items():
        for (strength,), off in zip(misfit.cells[who], each.excess["accuracy"].off, strict=True):
            by_strength[strength] += off
    off = misfit.sums("accuracy").off
    assert sorted(off) == pytest.approx(sorted(by_strength.values()))


def test_the_error_of_shared_simulated_trials_adds_up():
    """Drawn trials are independent, so their variances add; simulated ones are the same twice."""
    parts = np.random.default_rng(SEED).normal(size=(8, 3))
    one = Excess(np.ones(3), np.full(3, 0.5), parts, np.full(3, 40.0))
    both = one + one
    assert both.variance == pytest.approx(2 * one.variance)
    assert jackknifed(both.parts) ** 2 == pytest.approx(4 * jackknifed(one.parts) ** 2)
    assert both.p(5) < one.p(5)
    assert replace(both, parts=np.zeros((0, 3))).p(5) < both.p(5)
