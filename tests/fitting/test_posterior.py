"""What can be told apart, against the score of drawn data; the sampler on known densities."""

from dataclasses import dataclass

import numpy as np
import pytest

from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.design import design_of
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.parameters import Parameter, freedom
from bgmodel.fitting.posterior import (
    ENOUGH,
    Directions,
    _correlated,
    directions,
    posterior,
)
from tests.drawn import TRUTH, drawn
from tests.fitting.test_optimum import within

MODEL = GapModel()
VALUES = {"sensitivity": 8.0, "bound": 0.6}
FREE = ["sensitivity", "bound", "t0_s", "t0_sd_s"]
TRUE = np.array([8.0, 0.6, TRUTH["t0_s"], TRUTH["t0_sd_s"]])


def likelihood_at(trials, seed=21, strengths=(0.05, 0.3), **options):
    some = drawn(MODEL, strengths, trials, seed, **VALUES)
    options.setdefault("free", FREE)
    return likelihood_of(MODEL, design_of(some), **options)


def test_information_is_the_covariance_of_the_score():
    likelihood = likelihood_at(20_000)
    steps = 0.01 * TRUE
    score = []
    for k, step in enumerate(steps):
        moved = np.eye(4)[k] * step
        both = likelihood.each(TRUE + moved) - likelihood.each(TRUE - moved)
        score.append(both / (2 * step))
    seen = np.cov(score) * likelihood.design.trials.sum()
    expected = directions(likelihood, TRUE).information
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert seen / scale == pytest.approx(expected / scale, abs=0.05)


class Doubled:
    """The test, its bound a product of two parameters, and one that moves no more than rounding."""

    name, threshold_name = "doubled", "bound"
    parameters = (
        *MODEL.parameters,
        Parameter("times", 0.5, 2.0, 1.0, free=False),
        Parameter("idle", 0.0, 1.0, 0.5, free=False),
    )

    def decided(self, values, strength, grid):
        bound = values["bound"] * values["times"]
        mass = MODEL.decided({**values, "bound": bound}, strength, grid)
        return mass * (1 + 1e-13 * values["idle"][:, None, None])

    def halves(self):
        return self, self

    def left_out(self):
        return ()


def of_doubled(free):
    return likelihood_of(Doubled(), likelihood_at(100).design, free=free)


def test_two_names_of_one_parameter_have_a_cosine_of_1_and_one_makes_up_for_the_other():
    errors = directions(of_doubled(["bound", "times"]), np.array([0.6, 1.0]))
    assert errors.cosines == pytest.approx(1, abs=1e-6)
    (caution,) = errors.cautions()
    # The bound is their product: 0.6 times 1.
    assert "bound by +0.012 is compensated by one of times by -0.02" in caution
    assert not directions(of_doubled(["sensitivity", "times"]), np.array([8.0, 1.0])).cautions()


def test_a_parameter_that_moves_nothing_is_named_and_leaves_the_errors_of_others():
    errors = directions(of_doubled(["sensitivity", "bound", "idle"]), np.array([8.0, 0.6, 0.5]))
    (caution,) = errors.cautions()
    assert caution.startswith("nothing in this design depends on idle:")
    without = directions(of_doubled(["sensitivity", "bound"]), np.array([8.0, 0.6]))
    assert errors.standard_errors == pytest.approx([*without.standard_errors, np.inf])


def of_information(*rows):
    return Directions(list("abc")[: len(rows)], np.ones(len(rows)), np.array(rows))


def test_opposite_directions_are_named_too_and_a_right_angle_is_not():
    for c, named in ((0.96, 1), (-0.96, 1), (0.94, 0), (-0.94, 0)):
        assert len(of_information([1.0, c], [c, 1.0]).cautions()) == named
    # Of an estimate, products of the derivatives of two halves may be larger than the squares.
    for c in (1.3, -1.3):
        beyond = of_information([1.0, c], [c, 1.0])
        assert beyond.cosines.tolist() == [[1, np.sign(c)], [np.sign(c), 1]]
        assert np.isinf(beyond.standard_errors).all()


def test_what_nothing_fixes_has_an_infinite_error_and_is_said():
    """Two that move alike, one that moves nothing, no information at all, three in one plane."""
    two = of_information([4.0, 4.0], [4.0, 4.0]), of_information([0.0, 0.0], [0.0, 0.0])
    assert np.isinf([each.standard_errors for each in two]).all()
    assert of_information([4.0, 0.0], [0.0, 0.0]).standard_errors.tolist() == [0.5, np.inf]
    flat = of_information(*(1.5 * np.eye(3) - 0.5))
    assert np.isinf(flat.standard_errors).all()
    (caution,) = flat.cautions()
    assert caution.startswith("no standard error can be given for a, b, c:")
    assert not of_information(*np.eye(3)).cautions()


def test_a_point_at_a_bound_is_looked_at_from_inside():
    likelihood = likelihood_at(100)
    at_bound = directions(within(likelihood, Parameter("bound", 0.6, 0.9, 0.7)), TRUE)
    inside = directions(likelihood, TRUE)
    assert at_bound.standard_errors == pytest.approx(inside.standard_errors, rel=0.1)


@dataclass(frozen=True)
class Noisy(Doubled):
    """The same, its probabilities off by an error that goes with ``idle``, other in each half.

    Squared, the error of all trials is in both factors.
    """

    seeds: tuple[int, ...]
    squared: bool

    def decided(self, values, strength, grid):
        mass = MODEL.decided(values, strength, grid)
        signs = [np.random.default_rng(seed).choice([-1, 1], mass.shape) for seed in self.seeds]
        off = np.mean(signs, axis=0)
        off -= (mass * off).sum(axis=(1, 2), keepdims=True) / mass.sum(axis=(1, 2), keepdims=True)
        return mass * (1 + 0.1 * off * values["idle"][:, None, None])

    def halves(self):
        return (self, self) if self.squared else tuple(Noisy((k,), False) for k in self.seeds)


def test_the_error_of_stored_trials_is_no_information():
    """Its square would be."""
    design, median = likelihood_at(100).design, {}
    for squared in (False, True):
        each = []
        for seed in range(20):
            model = Noisy((2 * seed, 2 * seed + 1), squared)
            likelihood = likelihood_of(model, design, free=["sensitivity", "bound", "idle"])
            each.append(directions(likelihood, np.array([8.0, 0.6, 0.5])).information[2, 2])
        median[squared] = np.median(each)
    assert median[False] < 0.1 * median[True]


class Known:
    """A log likelihood in some parameters between -10 and 10, Gaussian or flat."""

    def __init__(self, information, low=-10.0):
        self.information = np.asarray(information, float)
        self.names = "abcdef"[: len(self.information)]
        parameters = [Parameter(name, low, 10.0, max(low, 0.0)) for name in self.names]
        self.freedom = freedom(parameters, {}, 1)

    def __call__(self, vector):
        return float(self.heights(vector[None])[0])

    def heights(self, vectors):
        inside = (vectors >= self.freedom.low) & (vectors <= self.freedom.high)
        heights = -np.einsum("ki,ij,kj->k", vectors, self.information, vectors) / 2
        return np.where(inside.all(axis=1), heights, -np.inf)

    def draw(self, **options):
        there = Directions(list(self.names), self.freedom.start, self.information)
        return posterior(self, there, **options)


GAUSSIAN = Known(np.linalg.inv([[1.0, 1.2], [1.2, 4.0]]))


def test_draws_from_a_gaussian_have_its_covariance():
    chain = GAUSSIAN.draw()
    assert chain.long_enough
    assert chain.lasts > ENOUGH
    # It looks at the chain every 500 steps, and stops once the chain is long enough.
    assert len(chain.draws) in {32 * 250 * looks for looks in range(1, 5)}
    error = 4 / np.sqrt(chain.effective)
    assert np.cov(chain.draws.T) == pytest.approx(np.array([[1.0, 1.2], [1.2, 4.0]]), abs=4 * error)
    assert chain.draws.std(axis=0) == pytest.approx([1, 2], rel=error)
    assert np.abs(chain.draws.mean(axis=0) / [1, 2]).max() < error
    assert chain.interval(0.9)[1] == pytest.approx(1.645 * np.array([1, 2]), rel=2 * error)
    assert chain.log_density[:5] == pytest.approx([GAUSSIAN(x) for x in chain.draws[:5]])


def test_draws_in_six_parameters_are_as_wide_as_their_density():
    chain = Known(np.eye(6)).draw(steps=2000, most_steps=2000)
    error = 1 / np.sqrt(2 * 6 * chain.effective)
    assert chain.draws.std(axis=0).mean() == pytest.approx(1, abs=3 * error)
    assert error < 0.01


def test_without_information_draws_fill_the_bounds_evenly():
    chain = Known(np.zeros((2, 2)), low=2.0).draw()
    assert chain.draws.min() >= 2
    assert chain.draws.max() <= 10
    error = 4 * 8 / np.sqrt(12 * chain.effective)
    assert chain.draws.mean(axis=0) == pytest.approx(6, abs=error)
    assert chain.interval(0.9) == pytest.approx(np.array([[2.4, 2.4], [9.6, 9.6]]), abs=2 * error)


def test_the_same_seed_draws_the_same_and_another_one_others():
    one, same, other = (GAUSSIAN.draw(most_steps=40, seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(one.draws, same.draws)
    assert not np.array_equal(one.draws, other.draws)


def test_no_chain_is_worth_more_than_its_draws():
    """Where each draw takes back the last, the autocorrelation time would be below a step."""
    rng = np.random.default_rng(6)
    noise = rng.normal(size=(400, 8, 2))
    assert _correlated(np.diff(noise, axis=0)) == 1
    slow = np.cumsum(noise, axis=0)
    assert _correlated(slow) > 10
    # The slowest parameter counts; for one that does not move there is no estimate.
    both = np.stack([noise[1:, :, 0], slow[1:, :, 0]], axis=2)
    assert _correlated(both) == pytest.approx(_correlated(slow[1:, :, :1]))
    with np.errstate(invalid="ignore"):
        assert _correlated(np.zeros((400, 8, 1))) == 400
