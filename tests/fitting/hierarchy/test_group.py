"""The conditional distribution of a group given its people."""

from dataclasses import replace

import numpy as np
import pytest

from bgmodel.fitting.hierarchy.group import (
    LOWEST,
    PARTS,
    SPREAD,
    Group,
    Predictors,
    Scale,
    group_of,
    log_mean,
    log_uniform,
    priors_of,
)
from bgmodel.fitting.parameters import Parameter, freedom
from bgmodel.support.seeds import stream

SEED = 24_312


def test_start_includes_the_errors_of_estimates():
    means = np.array([[0.0], [2.0]])
    alone = group_of(means)
    wide = group_of(means, np.full((2, 1), 3.0))
    assert alone.mean == wide.mean == 1.0
    assert wide.variance > alone.variance


def test_means_stay_within_their_range():
    rng, seen = stream(SEED, "range"), []
    group = Group(np.zeros(2), np.ones(2), highest=np.array([0.3, np.inf]))
    for _ in range(200):
        group = group.drawn(rng.normal(0.5, 1, size=(6, 2)), rng)
        seen.append(group.mean)
    assert max(mean[0] for mean in seen) <= 0.3 < max(mean[1] for mean in seen)
    assert replace(group, mean=np.array([0.31, 0.0])).log_own_prior() == -np.inf


@pytest.mark.parametrize("scale", ["identity", "log", "logit", "atanh"])
def test_the_prior_of_a_mean_is_that_of_one_person(scale):
    """On the scale of a hierarchy: the same density times the slope of that scale."""
    space = freedom([Parameter("a", 0.05, 0.9, 0.3, scale=scale)], {}, 1)
    space = space.with_priors({"a": (0.1, 0.5)})
    own = Scale.of(space)
    (row,) = priors_of(space, own)
    at = np.linspace(-3.0, 3.0, 15)
    one = [space.log_prior(x) + space.log_slope(x) for x in own.back(at[:, None])]
    of_group = np.array([log_mean(x, row) for x in at]) - log_uniform(at)
    assert np.diff(of_group) == pytest.approx(np.diff(one), abs=1e-6)
    assert space.priors["a"] == pytest.approx((0.1, 0.5))


def test_a_slope_given_correlated_parameters_is_drawn_from_their_conditional_distribution():
    rng = np.random.default_rng(5)
    column, related = np.array([-0.5, -0.5, 0.5, 0.5]), np.array([[1.0, 0.8], [0.8, 1.0]])
    scaled, sd = rng.normal(1.0, 1.0, (4, 2)), np.array([0.3, 2.0])
    predictors = Predictors(("x",), column[None], np.array([0]), np.array([np.ptp(column)]))
    group = Group(np.ones(2), sd**2, slopes=np.zeros(1), predictors=predictors, correlation=related)
    seen = np.array([group._slope_drawn(0, scaled, rng).slopes[0] for _ in range(20_000)])
    own = 0.3**2 * (1 - 0.8**2)
    rest = scaled[:, 0] - 1 - 0.8 * 0.3 / 2.0 * (scaled[:, 1] - 1)
    precision = (column**2).sum() / own + 1 / SPREAD**2
    middle = column @ rest / own / precision
    assert seen.mean() == pytest.approx(middle, abs=4 / np.sqrt(precision * len(seen)))
    assert seen.std() == pytest.approx(1 / np.sqrt(precision), rel=0.03)


SPACE = freedom([Parameter("bound", 0.1, 8.0, 0.7), Parameter("spread", 0.0, 5.0, 0.0)], {}, 1)
SCALE = Scale.of(SPACE)


def test_ends_of_the_range_are_finite_and_never_crossed():
    scaled = SCALE.to(np.array([[0.1, 0.0], [8.0, 5.0]]))
    assert scaled[0].tolist() == [LOWEST, LOWEST]
    back = SCALE.back(np.array([[-50.0, -50.0], [1e4, 1e4]]))
    assert (back[0] >= SPACE.low).all()
    assert back[1].tolist() == SPACE.high.tolist()


def test_slope_is_the_derivative():
    at = np.array([-2.3, 0.4])
    numeric = (SCALE.back(at + 1e-6) - SCALE.back(at - 1e-6)) / 2e-6
    assert SCALE.slope(at) == pytest.approx(numeric)


def test_coefficients_of_a_formula_have_the_unit_of_their_parameter():
    """Divided by their weight; far above the end of their range, the scale is linear in them."""
    bound = Parameter("bound", 0.1, 8.0, 0.7)
    columns = {"one": np.ones(2), "block": np.array([-2.0, 2.0])}
    space = freedom([bound], {}, 2, designs={"bound": columns})
    scale = Scale.of(space, np.array([1.2, 0.0]))
    assert scale.unit == pytest.approx([0.6 / PARTS, 0.3 / PARTS])
    natural = np.array([[1.2, -0.1], [0.9, 0.3]])
    assert scale.back(scale.to(natural)) == pytest.approx(natural)
    assert scale.slope(scale.to(natural))[:, 1] == pytest.approx(scale.unit[1])
