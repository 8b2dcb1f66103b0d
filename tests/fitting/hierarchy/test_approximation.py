"""Expansions of likelihoods, and the proposals made from them."""

import numpy as np
import pytest
from scipy.stats import multivariate_t

from bgmodel.fitting.hierarchy.approximation import FLAT, HEAVY, Expansion, Person, proposal_of
from bgmodel.fitting.hierarchy.group import SPREAD, Group
from bgmodel.support.seeds import stream

SEED = 24_313
PRECISION = np.array([[2.0, 0.6], [0.6, 1.0]])


def test_proposal_is_a_t_distribution_around_the_peak():
    proposal = proposal_of(PRECISION, PRECISION @ [0.5, -1.0])
    exact = multivariate_t([0.5, -1.0], np.linalg.inv(PRECISION), df=HEAVY)
    points = stream(SEED, "points").normal(size=(5, 2))
    assert proposal.log_density(points) == pytest.approx(exact.logpdf(points))
    assert proposal.variances == pytest.approx(np.diag(np.linalg.inv(PRECISION)))
    rng = stream(SEED, "draws")
    draws = np.array([proposal.draw(rng) for _ in range(4000)])
    assert draws.mean(axis=0) == pytest.approx([0.5, -1.0], abs=0.08)
    assert np.cov(draws.T) == pytest.approx(np.linalg.inv(PRECISION) * HEAVY / (HEAVY - 2), rel=0.2)


def test_an_expansion_times_the_group_is_the_product_of_gaussians():
    one = Expansion(np.array([[1.0, 2.0]]), np.array([[0.3, 0.0]]), PRECISION[None])
    product = one.times(Group(np.array([0.0, 1.0]), np.array([0.5, 4.0])))
    precision = PRECISION + np.diag([2.0, 0.25])
    pull = PRECISION @ [1.0, 2.0] + [0.3, 0.0] + [0.0, 0.25]
    assert product.mean[0] == pytest.approx(np.linalg.solve(precision, pull))


def test_given_scores_the_group_has_the_slope_and_curvature_of_its_people():
    rng = stream(SEED, "scores")
    points, scores = rng.normal(size=(2, 3, 2))
    precisions = np.array([k * PRECISION for k in (1, 2, 3)])
    expansion = Expansion(points, rng.normal(size=(3, 2)), precisions)

    def log(both):
        away = both[:2] + both[2:] * scores - points
        quadratic = np.einsum("pi,pij,pj->", away, precisions, away)
        # Gaussians with the variances of the priors.
        prior = (both[:2] ** 2).sum() / FLAT + (both[2:] ** 2).sum() / SPREAD**2
        return (expansion.slope * away).sum() - quadratic / 2 - prior / 2

    peak = expansion.shared(scores, np.zeros(4), np.arange(4)).mean
    for step in 1e-3 * np.eye(4):
        assert log(peak + step) == pytest.approx(log(peak - step), abs=1e-9)
        assert log(peak + step) < log(peak)
    # Those of one parameter alone, while the other one keeps its own.
    now, which = np.array([0.4, -0.3, 0.8, 1.2]), np.array([1, 3])
    partly = now.copy()
    partly[which] = expansion.shared(scores, now, which).mean
    for step in 1e-3 * np.eye(4)[which]:
        assert log(partly + step) == pytest.approx(log(partly - step), abs=1e-9)
        assert log(partly + step) < log(partly)


def test_gradient_and_information_of_a_person(group):
    likelihood = group.likelihoods["anna"]
    person = Person(likelihood, group.scale)
    at = group.scale.to(np.array([9.0, 0.55, 0.31]))
    assert person(at) == pytest.approx(likelihood(group.scale.back(at)))
    slope, information = person.expanded(at)
    step = np.array([1e-4, 0, 0])
    assert slope[0] == pytest.approx((person(at + step) - person(at - step)) / 2e-4, rel=0.02)
    assert np.linalg.eigvalsh(information).min() > 0
