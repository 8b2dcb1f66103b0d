"""Groups drawn from the prior of a hierarchical fit: misfit, and ranks of the truth: make validate.

The prior is restricted to values as in fits to people and monkeys: each mean is uniform over a
range, and each standard deviation between people half-t below ``MOST_SD``. Draws of the posterior
within the same limits are then draws from the posterior under the prior that made the data, and the
rank of the truth among them is uniform (Talts et al. 2018). The scale is fixed: the unit that a fit
takes from the data would make the prior depend on them.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from scipy.stats import binom, kstest

from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.hierarchy.approximation import Expansion
from bgmodel.fitting.hierarchy.group import FREEDOM, SPREAD, Scale, group_of
from bgmodel.fitting.hierarchy.sampler import Sampler, guided
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.misfit import BEYOND_CHANCE, group_misfit
from bgmodel.fitting.optimum import Optimum
from bgmodel.support.processes import local_map
from bgmodel.support.seeds import stream
from figures.data.decided import decided_by_test, responses

pytestmark = pytest.mark.validate
PEOPLE = 20
MISFIT_SEED, GROUPS, EACH = 47_811, 300, 50
RECOVERY_SEED, SETS, WARM_UP, SWEEPS = 47_802, 80, 300, 1200
STRENGTHS = (0.032, 0.064, 0.128, 0.256)
RANGES = {
    "sensitivity": (8.0, 25.0), "bound": (0.45, 0.9), "threshold_nats": (0.17, 0.37),
    "t0_s": (0.25, 0.5), "t0_sd_s": (0.03, 0.1), "lapse": (0.002, 0.03),
}  # fmt: skip
"""Ranges of the median person's parameters, as in fits to people and monkeys."""
MOST_SD = 1.5
"""Largest standard deviation between people, in units of the scale: 3/8 of a typical value."""


class Truth(NamedTuple):
    """Distribution of a group, and its people, (people, parameters), on the scale."""

    mean: np.ndarray
    sd: np.ndarray
    scaled: np.ndarray


def names_of(model):
    """Return the names of the parameters that differ between people."""
    return [each.name for each in model.parameters if each.free]


def scale_of(likelihood):
    """Return the scale, whose unit is a quarter of the middle of each range."""
    middles = [sum(RANGES[name]) / 2 for name in likelihood.freedom.names]
    return Scale.of(likelihood.freedom, np.array(middles))


def group(scale, names, rng):
    """Return a group and its people, drawn from the prior."""
    low, high = np.array([RANGES[name] for name in names]).T
    mean = scale.to(rng.uniform(low, high))
    sd = np.full(len(names), np.inf)
    while (above := sd > MOST_SD).any():
        sd[above] = SPREAD * np.abs(rng.standard_t(FREEDOM, size=above.sum()))
    return Truth(mean, sd, mean + sd * rng.normal(size=(PEOPLE, len(names))))


def trials_of(values, number, who, each):
    """Return the trials of a person."""
    rng = stream(MISFIT_SEED, "responses", "test", number, who)
    return responses(values, STRENGTHS, decided_by_test(values, STRENGTHS, each, rng), rng)


def of_group(number):
    """Return the misfit of a group at its true parameters."""
    model = GapModel()
    names = names_of(model)
    any_trials = trials_of({name: RANGES[name][0] for name in names}, number, -1, 1)
    scale = scale_of(likelihood_of(model, any_trials, free=names))
    truth = group(scale, names, stream(MISFIT_SEED, "group", "test", number))
    optima = {}
    for who, vector in enumerate(scale.back(truth.scaled)):
        values = dict(zip(names, vector.tolist(), strict=True))
        design = trials_of(values, number, who, EACH)
        optima[f"{who}"] = Optimum(likelihood_of(model, design, free=names), vector, 0.0, 0)
    return group_misfit(optima)


@pytest.mark.timeout(3600)
def test_groups_without_misfit_are_reported_as_often_as_stated():
    misfits = [of_group(number) for number in range(GROUPS)]
    p = np.array([list(each.together.values()) for each in misfits])
    uniform = [kstest(each, "uniform").pvalue for each in p.T]
    assert min(uniform) * len(uniform) > 0.01, uniform
    warned = sum(bool(each.cautions()) for each in misfits)
    assert warned <= binom.ppf(0.99, GROUPS, BEYOND_CHANCE), warned


# Ranks: people have Gaussian errors, so that a data set takes seconds.

NAMES = ["sensitivity", "bound", "lapse"]
SCALE = Scale(np.array([0.08, 0.1, 0.001]), np.array([70, 8, 0.2]), np.array([4.1, 0.144, 0.05]))
ERRORS = np.array([3.0, 0.06, 0.006])
"""Standard errors of one person's estimates, in the units of the parameters."""


class Measured:
    """A person whose parameters are measured with Gaussian errors."""

    scale = SCALE

    def __init__(self, values):
        self.values = values

    def __call__(self, scaled):
        return float(-0.5 * (((SCALE.back(scaled) - self.values) / ERRORS) ** 2).sum())


def ranks(number, shift=0.0):
    """Return the ranks of the truth: means, spreads and the first person of a data set."""
    rng = stream(RECOVERY_SEED, number)
    truth = group(SCALE, NAMES, rng)
    values = SCALE.back(truth.scaled) + ERRORS * (shift + rng.normal(size=truth.scaled.shape))
    point = SCALE.to(np.maximum(values, SCALE.low + 0.05 * SCALE.unit))
    slope = SCALE.slope(point)
    pull = (values - SCALE.back(point)) / ERRORS**2 * slope
    expansion = Expansion(point, pull, np.array([np.diag(each**2 / ERRORS**2) for each in slope]))
    sampler = Sampler([Measured(each) for each in values], expansion)
    state, warm = sampler.run(sampler.first(group_of(point), rng), WARM_UP)
    guide = guided(local_map(sampler.people), warm.part(WARM_UP // 4), rng)
    _, draws = replace(sampler, guide=guide).run(state, SWEEPS)
    low, high = SCALE.to(np.array([RANGES[name] for name in NAMES]).T)
    inside = (draws.mean >= low) & (draws.mean <= high) & (draws.sd <= MOST_SD)
    inside = inside.all(axis=1)
    pairs = (draws.mean, truth.mean), (draws.sd, truth.sd), (draws.scaled[:, 0], truth.scaled[0])
    return np.concatenate([(each[inside] < true).mean(axis=0) for each, true in pairs])


@pytest.mark.timeout(3600)
def test_ranks_of_groups_drawn_from_the_prior_are_uniform():
    shares = np.array([ranks(number) for number in range(SETS)])
    p = np.array([kstest(each, "uniform").pvalue for each in shares.T])
    assert p.min() * len(p) > 0.01, p
    held = ((shares > 0.05) & (shares < 0.95)).mean(axis=0)
    assert 0.86 < held.mean() < 0.94, held
    # Less often than this, one of the numbers would hold by chance in a hundredth of runs.
    assert held.min() >= binom.ppf(0.01 / len(held), SETS, 0.9) / SETS, held


@pytest.mark.timeout(3600)
def test_ranks_of_shifted_data_are_not():
    shares = np.array([ranks(number, shift=0.5) for number in range(SETS // 4)])
    p = [kstest(each, "uniform").pvalue for each in shares[:, : len(NAMES)].T]
    assert min(p) < 0.01 / len(p)
