"""Surrogates of log likelihoods."""

import numpy as np
import pytest

from bgmodel.fitting.hierarchy.surrogate import MARGIN, surrogate_of, values
from bgmodel.support.processes import local_map
from bgmodel.support.seeds import stream
from tests.fitting.hierarchy.known import Known, wide

SEED = 24_316


MIDDLE = 5.0
"""Middle of the prior: far above the lower ends of the parameters' ranges."""


def quadratic(x):
    first, second = x - MIDDLE
    return float(-3 - first**2 - 2 * (second - 0.3 * first) ** 2)


def bent(x):
    """Constant towards the lower end of the second parameter, as the likelihood of no lapses is."""
    return float(-40 - 2 * (x[0] - MIDDLE) ** 2 - np.logaddexp(0, x[1]))


def two_modes(x):
    away = x - MIDDLE
    return float(np.logaddexp(-(away**2).sum(), -((away - 2.5) ** 2).sum() - 1))


def few_lapses(x):
    lapse = 0.05 * np.logaddexp(0, x[1])
    return float(-2 * (x[0] - MIDDLE) ** 2 + 2 * np.log(lapse + 1e-4) + 298 * np.log1p(-lapse))


def surrogates(people, draws, logs, parameters=2, **range_):
    every = [Known(each, wide(parameters, **range_)) for each in people]
    return surrogate_of(local_map(every), draws, logs, stream(SEED))


def at(surrogate, scaled):
    return values(np.ascontiguousarray(scaled), surrogate.arrays)


def drawn(person, count, spread=1.0):
    """Return draws from the posterior of a person under a Gaussian prior."""
    rng, x, kept = stream(SEED, person.__name__), np.full(2, MIDDLE), []
    for _ in range(20 * count):
        asked = x + spread * rng.normal(size=2)
        gain = person(asked) - person(x)
        gain -= (((asked - MIDDLE) ** 2).sum() - ((x - MIDDLE) ** 2).sum()) / 8
        x = asked if np.log(rng.random()) < gain else x
        kept.append(x)
    draws = np.array(kept[::20])[:, None]
    return draws, np.array([[person(each)] for each in draws[:, 0]])


@pytest.mark.parametrize("person", [quadratic, bent, few_lapses, two_modes])
def test_it_agrees_with_the_exact_log_likelihood_at_other_draws(person):
    draws, logs = drawn(person, 900)
    fitted = surrogates([person], draws[:450], logs[:450])
    error = [at(fitted, x)[0] - log[0] for x, log in zip(draws[450:], logs[450:], strict=True)]
    assert np.std(logs[450:]) > 0.5
    assert np.median(np.abs(error)) < 0.02
    # Far below the highest it is allowed to be less exact.
    below = logs.max() - logs[450:, 0]
    assert (np.abs(error) < 0.1 + 0.1 * below).all()


def test_far_away_it_is_at_most_a_nat_above_the_highest_draw_and_constant_below_a_range():
    """A quadratic function of the scale is not, by tens of nats: chains stayed there for long."""
    draws, logs = drawn(bent, 450)
    fitted = surrogates([bent], draws, logs)
    far = [at(fitted, x[None])[0] for x in stream(SEED, "far").normal(MIDDLE, 50, size=(200, 2))]
    assert max(far) <= fitted.ceiling[0] <= logs.max() + MARGIN + 0.5
    for low in (-8.0, -20.0):
        x = np.array([MIDDLE, low])
        assert at(fitted, x[None])[0] == pytest.approx(bent(x), abs=0.2)


def test_draws_that_repeat_or_of_one_parameter_are_no_obstacle():
    def person(x):
        return float(-(x[0] ** 2))

    draws = np.repeat(np.linspace(-1, 1, 5), 30)[:, None, None]
    logs = np.array([[person(x)] for x in draws[:, 0]])
    fitted = surrogates([person], draws, logs)
    assert at(fitted, np.array([[0.4]]))[0] == pytest.approx(-0.16, abs=0.02)


@pytest.mark.parametrize("hole", [np.nan, -np.inf])
def test_points_without_a_likelihood_are_left_out(hole):
    def person(x):
        return hole if x[0] > MIDDLE + 3 else quadratic(x)

    draws, _ = drawn(quadratic, 300)
    assert draws[..., 0].max() < MIDDLE + 3.5
    logs = np.array([[person(x)] for x in draws[:, 0]])
    fitted = surrogates([person], draws, logs)
    x = MIDDLE + np.array([0.3, 0.2])
    assert at(fitted, x[None])[0] == pytest.approx(quadratic(x), abs=0.01)


def test_it_is_constant_beyond_the_upper_end_of_a_range_as_the_log_likelihood_is():
    top = MIDDLE + 1

    def clipped(x):
        return quadratic(np.minimum(x, top))

    draws, logs = drawn(clipped, 450)
    fitted = surrogates([clipped], draws, logs, highest=float(np.logaddexp(0, top)))
    x = np.array([MIDDLE, top + 20])
    assert at(fitted, x[None])[0] == pytest.approx(clipped(x), abs=0.2)
