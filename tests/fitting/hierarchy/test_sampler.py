"""The sampler on a hierarchy of Gaussians, whose posterior is known from a quadrature."""

from dataclasses import replace

import numpy as np
import pytest
from arviz_stats.base import array_stats

from bgmodel.fitting.hierarchy.approximation import Expansion
from bgmodel.fitting.hierarchy.group import (
    ALMOST,
    CORRELATED,
    FREEDOM,
    SPREAD,
    Group,
    Predictors,
    Scale,
    log_uniform,
    priors_of,
)
from bgmodel.fitting.hierarchy.sampler import Draws, Sampler
from bgmodel.fitting.hierarchy.sampler import guided as guide_from
from bgmodel.fitting.parameters import Parameter, freedom
from bgmodel.support.processes import local_map
from bgmodel.support.seeds import stream
from tests.fitting.hierarchy.known import Known, wide

pytestmark = pytest.mark.usefixtures("few_moves")
SEED = 24_311
# Far above the lower bound, where the scale is linear: a surrogate can represent Gaussians there.
MIDDLE = np.array([6.0, 12.0])
ESTIMATES = MIDDLE[0] + np.array([-0.4, 0.1, 0.3, 0.9, 1.6, -1.1])
SECOND = MIDDLE[1] + 0.5 * (ESTIMATES - MIDDLE[0])
ERRORS = np.array([0.2, 0.5, 0.3, 0.4, 0.8, 0.3])


class Gaussian:
    """A person whose log likelihood is Gaussian, with independent parameters."""

    scale = wide()

    def __init__(self, middle, error):
        self.middle, self.error = middle, error

    def __call__(self, scaled):
        return float(-0.5 * (((scaled - self.middle) / self.error) ** 2).sum())


def quadrature(estimates, errors, prior=None, wider=1.0, column=None):
    """Return mean and sd of the group's mean, of its standard deviation and of a slope.

    Under the prior of an interval that is as many times as wide, or a uniform one; the slope is by
    a column of predictors.
    """
    fine = column is None
    mean = np.mean(estimates) + np.linspace(-5.5, 5.5, 881 if fine else 111)[:, None, None]
    sd = np.exp(np.linspace(-6, 2.5, 400 if fine else 100))[:, None]
    slope = np.zeros(1) if fine else np.linspace(-5, 5, 101)
    log = log_uniform(mean) - (FREEDOM + 1) / 2 * np.log1p(sd**2 / (FREEDOM * SPREAD**2))
    # The grid is even in the logarithm of the standard deviation.
    log = log + np.log(sd) - 0.5 * (slope / SPREAD) ** 2
    if prior is not None:
        away = np.logaddexp(0, mean) - np.mean(prior)
        log = log - (away / (wider * np.ptp(prior) / (2 * 1.96))) ** 2 / 2
    x = np.zeros(len(errors)) if fine else column
    for estimate, error, at in zip(estimates, errors, x, strict=True):
        variance = sd**2 + error**2
        log = log - 0.5 * (estimate - mean - slope * at) ** 2 / variance - 0.5 * np.log(variance)
    return moments(log, *((mean, sd) if fine else (mean, sd, slope)))


def moments(log, *numbers):
    """Return mean and sd of each number under a log density on a grid."""
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    middles = [(weight * each).sum() for each in numbers]
    errors = [(weight * (x - m) ** 2).sum() ** 0.5 for x, m in zip(numbers, middles, strict=True)]
    return list(zip(middles, errors, strict=True))


def expansion(people, shift=0.0, narrower=1.0):
    """Return the exact expansion, or one that is shifted and too wide."""
    points = np.array([p.middle + shift * p.error for p in people])
    precisions = np.array([narrower * np.diag(1 / p.error**2) for p in people])
    return Expansion(points, np.zeros(points.shape), precisions)


def draws(approximation, people, sweeps, guided=False, group=None, warm_up=200):
    """Return draws of a chain, after a warm-up."""
    sampler = Sampler(people, approximation)
    state = sampler.first(group or Group(MIDDLE, np.ones(2)), stream(SEED))
    state, warm = sampler.run(state, warm_up)
    if guided:
        sampler = replace(
            sampler, guide=guide_from(local_map(sampler.people), warm, stream(SEED, "surrogate"))
        )
    return sampler.run(state, sweeps)[1]


def misses(numbers, expected, fewest=300):
    """Return by how many errors means and standard deviations of draws miss the expected ones."""
    size = array_stats.ess(np.array(numbers)[:, None], chain_axis=1, draw_axis=2)
    assert size.min() > fewest
    means, sds = np.reshape(expected, (-1, 2)).T
    off = np.mean(numbers, axis=1) - means, np.std(numbers, axis=1) - sds
    return np.abs([off[0] / sds * np.sqrt(size), off[1] / sds * np.sqrt(size / 2)]).max()


@pytest.fixture(scope="module")
def people():
    # The second parameter is hardly determined by one person's trials.
    return [
        Gaussian(np.array([x, y]), np.array([e, 3 * e]))
        for x, y, e in zip(ESTIMATES, SECOND, ERRORS, strict=True)
    ]


@pytest.mark.parametrize(
    ("shift", "narrower", "guided"),
    [(0.0, 1.0, False), (0.3, 0.7, False), (0.6, 0.5, True)],
    ids=["exact", "misplaced", "guided"],
)
def test_group_has_the_posterior_of_a_quadrature(people, shift, narrower, guided):
    assert missed_by(draws(expansion(people, shift, narrower), people, 2000, guided=guided)) < 4


def missed_by(drawn):
    """Return by how many errors draws of the group of ``people`` miss its posterior."""
    known = [quadrature(ESTIMATES, ERRORS), quadrature(SECOND, 3 * ERRORS)]
    expected = [each[k] for k in range(2) for each in known]
    return misses([*drawn.mean.T, *drawn.sd.T], expected, 75)


@pytest.fixture(scope="module")
def astray(people):
    """Return a sampler whose surrogate is of people with other and less certain estimates."""
    others = [Gaussian(each.middle + 0.7 * each.error, 1.4 * each.error) for each in people]
    sampler, start = Sampler(others, expansion(others)), Group(MIDDLE, np.ones(2))
    _, warm = sampler.run(sampler.first(start, stream(SEED)), 300)
    guide = guide_from(local_map(sampler.people), warm, stream(SEED, "astray"))
    return replace(Sampler(people, expansion(people)), guide=guide)


def alone(sampler, step, sweeps):
    """Return draws by one step of a sweep and nothing else."""
    state, kept = sampler.first(Group(MIDDLE, np.ones(2)), stream(SEED, "alone")), []
    for _ in range(sweeps):
        state = step(state)
        kept.append((state.group.mean, np.sqrt(state.group.variance), state.scaled, state.log))
    return Draws(*(np.array(each) for each in zip(*kept, strict=True)))


def test_a_surrogate_that_is_wrong_changes_no_posterior(people, astray):
    state = astray.first(Group(MIDDLE, np.ones(2)), stream(SEED, "astray"))
    assert missed_by(astray.run(state, 4000)[1]) < 4
    # Also without the steps that do not follow it.
    drawn = alone(astray, lambda state: astray._guided_together(astray.guide, state), 4000)
    assert missed_by(drawn) < 4


def test_moves_under_an_exact_surrogate_have_the_posterior(people):
    sampler = Sampler(people, expansion(people))
    _, warm = sampler.run(sampler.first(Group(MIDDLE, np.ones(2)), stream(SEED)), 300)
    guide = guide_from(local_map(sampler.people), warm, stream(SEED, "exact"))

    def moved(state):
        group, scaled, _ = guide.moved(state.group, state.scaled, sampler.vague, state.rng)
        return replace(state, group=group, scaled=scaled)

    assert missed_by(alone(sampler, moved, 4000)) < 4


@pytest.mark.parametrize("guided", [False, True])
def test_a_predictor_between_people_has_its_posterior(guided):
    column = np.array([-0.5, -0.5, 0.5, 0.5, 0.5, -0.5])
    some = [Gaussian(np.array([x]), np.array([e])) for x, e in zip(ESTIMATES, ERRORS, strict=True)]
    for each in some:
        each.scale = wide(1)
    predictors = Predictors(("x",), column[None], np.array([0]), np.array([np.ptp(column)]))
    group = Group(MIDDLE[:1], np.ones(1), slopes=np.zeros(1), predictors=predictors)
    kept = draws(expansion(some), some, 3000, guided, group, 400)
    numbers = [kept.mean[:, 0], kept.sd[:, 0], kept.slopes[:, 0]]
    assert misses(numbers, quadrature(ESTIMATES, ERRORS, column=column)) < 4


@pytest.mark.parametrize("guided", [False, True])
def test_a_shared_parameter_has_the_posterior_of_all_trials_together(guided):
    """Next to one in which people differ, whose posterior is that of a quadrature."""
    middles, errors = np.stack([ESTIMATES, SECOND], axis=1), np.stack([ERRORS, ERRORS], axis=1)
    some = [Gaussian(middle, error) for middle, error in zip(middles, errors, strict=True)]
    group = Group(MIDDLE, np.array([ALMOST**2, 1.0]), shared=np.array([True, False]))
    kept = draws(expansion(some), some, 3000, guided, group, 400)
    np.testing.assert_allclose(kept.sd[:, 0], ALMOST)
    weight = 1 / ERRORS**2
    together = (weight @ ESTIMATES) / weight.sum(), 1 / np.sqrt(weight.sum())
    numbers = [kept.mean[:, 0], kept.mean[:, 1], kept.sd[:, 1]]
    assert misses(numbers, [together, *quadrature(SECOND, ERRORS)]) < 4


SPACE = freedom([Parameter("a", 0.0, 1e9, 6.0), Parameter("b", 0.0, 1e9, 12.0)], {}, 1)
PRIORS = SPACE.with_priors({"a": (4.8, 5.2), "b": (11.0, 17.0)})
"""Priors of the means of both parameters; the first is narrower than the data say, the other
wider."""


def correlated_quadrature(error):
    """Return mean and sd of means, sds and correlation, by the density of the covariance matrix.

    Huang & Wand (2013), their equation 3; means, with flat priors, are Gaussian given it.
    """
    every, people = np.stack([ESTIMATES, SECOND], axis=1), len(ESTIMATES)
    grid = np.exp(np.linspace(-5, 3, 70))
    first, second, rho = np.meshgrid(grid, grid, np.tanh(np.linspace(-4, 4, 81)), indexing="ij")
    across = rho * first * second
    covariance = np.moveaxis(np.array([[first**2, across], [across, second**2]]), (0, 1), (3, 4))
    diagonal = np.diagonal(np.linalg.inv(covariance), axis1=3, axis2=4)
    log = -(CORRELATED + 4) / 2 * np.linalg.slogdet(covariance)[1]
    log -= (CORRELATED + 2) / 2 * np.log(CORRELATED * diagonal + SPREAD**-2).sum(axis=-1)
    # From the matrix to standard deviations and correlation, and to their logarithm and artanh.
    log += 3 * np.log(first * second) + np.log(1 - rho**2)
    total, away = covariance + error**2 * np.eye(2), every - every.mean(axis=0)
    log -= (people - 1) / 2 * np.linalg.slogdet(total)[1]
    log -= (np.linalg.inv(total) * (away.T @ away)).sum(axis=(3, 4)) / 2
    errors = [(moments(log, total[..., k, k])[0][0] / people) ** 0.5 for k in range(2)]
    return [*zip(every.mean(axis=0), errors, strict=True), *moments(log, first, second, rho)]


@pytest.mark.parametrize("guided", [False, True])
def test_correlated_parameters_have_the_posterior_of_a_quadrature(guided):
    errors = np.full(2, 0.3)
    some = [Gaussian(x, errors) for x in np.stack([ESTIMATES, SECOND], axis=1)]
    group = Group(MIDDLE, np.ones(2), correlation=np.eye(2))
    kept = draws(expansion(some), some, 3000 if guided else 6000, guided, group)
    numbers = [*kept.mean.T, *kept.sd.T, kept.correlation[:, 0, 1]]
    assert misses(numbers, correlated_quadrature(0.3)) < 4


@pytest.mark.parametrize("guided", [False, True])
def test_priors_of_means_have_the_posterior_of_a_quadrature(people, guided):
    group = Group(MIDDLE, np.ones(2), prior=priors_of(PRIORS, wide()))
    kept = draws(expansion(people), people, 3000, guided, group)
    for k, (name, estimates) in enumerate({"a": ESTIMATES, "b": SECOND}.items()):
        given, numbers = (estimates, (1, 3)[k] * ERRORS), [kept.mean[:, k], kept.sd[:, k]]
        assert misses(numbers, quadrature(*given, PRIORS.priors[name])) < 4
    # Negative control: a narrow prior that is twice as wide would be seen.
    wrong = quadrature(ESTIMATES, ERRORS, PRIORS.priors["a"], wider=2.0)
    assert misses([kept.mean[:, 0], kept.sd[:, 0]], wrong) > 10


LAPSE = Parameter("c", 0.001, 0.4, 0.05, scale="logit").within(0.02, 0.1)
ALONE = freedom([Parameter("a", 0.1, 3.0, 0.7), LAPSE], {}, 1).with_priors({"c": (0.02, 0.1)})


@pytest.mark.parametrize("guided", [False, True])
@pytest.mark.parametrize("correlated", [False, True])
def test_without_data_draws_are_those_of_the_priors(guided, correlated):
    """A uniform and a narrow prior of means, half-t spreads, people around them, correlations."""
    scale, count = Scale.of(ALONE), 3
    group = Group(
        scale.to(ALONE.start), np.ones(2), highest=scale.to(ALONE.high),
        prior=priors_of(ALONE, scale), correlation=np.eye(2) if correlated else None,
    )  # fmt: skip
    some = [Known(lambda _: 0.0, scale) for _ in range(count)]
    none = Expansion(np.zeros((count, 2)), np.zeros((count, 2)), np.zeros((count, 2, 2)))
    kept = draws(none, some, 3000, guided, group, 1000)
    rng, many = stream(SEED, "exact"), 400_000
    mean = np.stack([
        rng.uniform(0.1, 3.0, many),
        LAPSE.natural(LAPSE.scaled(LAPSE.prior[0]) + LAPSE.prior[1] * rng.normal(size=many)),
    ])  # fmt: skip
    mean = np.clip(mean, ALONE.low[:, None], ALONE.high[:, None])
    freedom_ = CORRELATED if correlated else FREEDOM
    sd = SPREAD * np.abs(rng.standard_t(freedom_, size=mean.shape))
    person = scale.back(scale.to(mean.T) + sd.T * rng.normal(size=(many, 2))).T
    pairs = [*zip(scale.back(kept.mean).T, mean, strict=True), *zip(kept.sd.T, sd, strict=True),
             *zip(scale.back(kept.scaled[:, 1]).T, person, strict=True)]  # fmt: skip
    if correlated:
        pairs.append((kept.correlation[:, 1, 0], rng.uniform(-1, 1, many)))
    for seen, exact in pairs:
        for share in (0.05, 0.25, 0.5, 0.75, 0.95):
            below = seen < np.quantile(exact, share)
            size = array_stats.ess(below[None].astype(float), chain_axis=0, draw_axis=1)
            assert size > 100
            off = (below.mean() - share) / np.sqrt(share * (1 - share) / size)
            assert abs(off) < 4, (share, off)
