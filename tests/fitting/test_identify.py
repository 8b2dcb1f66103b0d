"""What can be told apart, against the score of drawn data."""

from dataclasses import dataclass

import numpy as np
import pytest

from bgmodel.fitting.design import design_of
from bgmodel.fitting.exact.algorithms import GapModel
from bgmodel.fitting.identify import Directions, directions
from bgmodel.fitting.likelihood import BinnedLikelihood, likelihood_of
from bgmodel.fitting.parameters import Parameter, freedom
from tests.drawn import TRUTH, drawn

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
    assert np.abs(seen - expected).max() > 0
    assert seen / scale == pytest.approx(expected / scale, abs=0.05)


def test_errors_are_those_of_the_inverse_of_the_information():
    errors = directions(likelihood_at(100), TRUE)
    assert errors.standard_errors == pytest.approx(
        np.sqrt(np.diag(np.linalg.inv(errors.information)))
    )
    assert errors.cosines == pytest.approx(errors.cosines.T)
    assert np.diag(errors.cosines) == pytest.approx(1)


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
    design = likelihood_at(100).design
    return likelihood_of(Doubled(), design, free=free)


def test_two_names_of_one_parameter_have_a_cosine_of_1_and_one_makes_up_for_the_other():
    errors = directions(of_doubled(["bound", "times"]), np.array([0.6, 1.0]))
    assert errors.cosines == pytest.approx(1, abs=1e-6)
    (caution,) = errors.cautions()
    # The bound is their product: 0.6 times 1.
    assert "bound by +0.012 is compensated by one of times by -0.02" in caution
    assert not directions(of_doubled(["sensitivity", "times"]), np.array([8.0, 1.0])).cautions()


def test_a_parameter_that_moves_nothing_is_named_and_leaves_the_errors_of_others():
    errors = directions(of_doubled(["sensitivity", "bound", "idle"]), np.array([8.0, 0.6, 0.5]))
    assert [each.split(":")[0] for each in errors.cautions()] == [
        "nothing in this design depends on idle"
    ]
    without = directions(of_doubled(["sensitivity", "bound"]), np.array([8.0, 0.6]))
    assert errors.standard_errors == pytest.approx([*without.standard_errors, np.inf])


def test_opposite_directions_are_named_too_and_a_right_angle_is_not():
    def at(cosine):
        return Directions(["a", "b"], np.zeros(2), np.array([[1.0, cosine], [cosine, 1.0]]))

    assert [len(at(cosine).cautions()) for cosine in (0.96, -0.96, 0.94, -0.94)] == [1, 1, 0, 0]


def test_a_point_at_a_bound_is_looked_at_from_inside():
    likelihood = likelihood_at(100)
    tight = [
        Parameter(each.name, 0.6, 0.9, 0.7) if each.name == "bound" else each
        for each in likelihood.freedom.parameters
    ]
    freed = freedom(tight, {}, likelihood.design.cells, free=FREE)
    at_bound = directions(BinnedLikelihood(MODEL, likelihood.design, freed), TRUE)
    inside = directions(likelihood, TRUE)
    assert at_bound.standard_errors == pytest.approx(inside.standard_errors, rel=0.1)


@dataclass(frozen=True)
class Noisy(Doubled):
    """The same, its probabilities off by an error that goes with ``idle``, other in each half."""

    seeds: tuple[int, ...]

    def decided(self, values, strength, grid):
        mass = MODEL.decided(values, strength, grid)
        signs = [np.random.default_rng(seed).choice([-1, 1], mass.shape) for seed in self.seeds]
        off = np.mean(signs, axis=0)
        off -= (mass * off).sum(axis=(1, 2), keepdims=True) / mass.sum(axis=(1, 2), keepdims=True)
        return mass * (1 + 0.1 * off * values["idle"][:, None, None])

    def halves(self):
        return tuple(Noisy((seed,)) for seed in self.seeds)


class Squared(Noisy):
    """What it would be with the error of all trials in both factors."""

    def halves(self):
        return self, self

    def left_out(self):
        return ()


def test_the_error_of_stored_trials_is_no_information():
    """Its square would be."""
    design = likelihood_at(100).design
    vector = np.array([8.0, 0.6, 0.5])
    information = {}
    for kind in (Noisy, Squared):
        each = []
        for seed in range(20):
            model = kind((2 * seed, 2 * seed + 1))
            likelihood = likelihood_of(model, design, free=["sensitivity", "bound", "idle"])
            each.append(directions(likelihood, vector).information[2, 2])
        information[kind] = np.median(each)
    assert information[Noisy] < 0.1 * information[Squared]


def test_what_nothing_fixes_has_an_infinite_error():
    """Two that move alike, one that moves nothing, or no information at all."""

    def errors(*information):
        count = len(information)
        return Directions(list("abc")[:count], np.zeros(count), np.array(information))

    assert errors([4.0, 4.0], [4.0, 4.0]).standard_errors.tolist() == [np.inf, np.inf]
    assert errors([0.0, 0.0], [0.0, 0.0]).standard_errors.tolist() == [np.inf, np.inf]
    assert errors([4.0, 0.0], [0.0, 0.0]).standard_errors.tolist() == [0.5, np.inf]


def test_a_cosine_is_between_minus_1_and_1_where_information_is_an_estimate():
    """Products of the derivatives of two halves may be larger than the squares."""
    for sign in (1, -1):
        one = Directions(["a", "b"], np.zeros(2), np.array([[1.0, sign * 1.3], [sign * 1.3, 1.0]]))
        assert one.cosines.tolist() == [[1, sign], [sign, 1]]
        assert np.isinf(one.standard_errors).all()


def test_errors_that_are_infinite_without_a_pair_alike_are_said():
    """Three directions in one plane: each pair has a cosine of -1/2."""
    names = ["a", "b", "c"]
    flat = Directions(names, np.ones(3), 1.5 * np.eye(3) - 0.5 * np.ones((3, 3)))
    assert np.isinf(flat.standard_errors).all()
    (caution,) = flat.cautions()
    assert caution.startswith("no standard error can be given for a, b, c:")
    assert not Directions(names, np.ones(3), np.eye(3)).cautions()
