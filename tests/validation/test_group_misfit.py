"""How often groups at their true parameters are reported as a misfit: make validate."""

import numpy as np
import pytest
from scipy.stats import binom, kstest

from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.misfit import BEYOND_CHANCE, group_misfit
from bgmodel.fitting.optimum import Optimum
from bgmodel.support.seeds import stream
from tests.validation.groups import RANGES, group, names_of, scale_of, trials_of

pytestmark = pytest.mark.validate
SEED, GROUPS, PEOPLE, EACH = 47_811, 300, 20, 50


def of_group(number):
    """Return the misfit of a group at its true parameters."""
    model = GapModel()
    names = names_of(model)
    any_trials = trials_of({name: RANGES[name][0] for name in names}, SEED, number, -1, 1)
    scale = scale_of(likelihood_of(model, any_trials, free=names))
    truth = group(scale, names, stream(SEED, "group", "test", number), PEOPLE)
    optima = {}
    for who, vector in enumerate(scale.back(truth.scaled)):
        values = dict(zip(names, vector.tolist(), strict=True))
        design = trials_of(values, SEED, number, who, EACH)
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
