"""Calibration of the sampler of hierarchical fits: make validate.

Groups are drawn from the prior. People have Gaussian errors, so that a data set takes seconds.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom, kstest

from bgmodel.fitting.hierarchy.approximation import Expansion
from bgmodel.fitting.hierarchy.group import Scale, group_of
from bgmodel.fitting.hierarchy.sampler import Sampler, guided
from bgmodel.support.processes import local_map
from bgmodel.support.seeds import stream
from tests.validation.groups import MOST_SD, RANGES, group

pytestmark = pytest.mark.validate
SEED, SETS, PEOPLE, WARM_UP, SWEEPS = 47_802, 80, 20, 300, 1200
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
    rng = stream(SEED, number)
    truth = group(SCALE, NAMES, rng, PEOPLE)
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
