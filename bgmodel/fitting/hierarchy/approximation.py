"""Gaussian approximations of each person's likelihood, from which proposals are made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bgmodel.fitting.hierarchy.group import SPREAD, Group, Scale, group_of
from bgmodel.fitting.likelihood import Likelihood
from bgmodel.support.processes import SharedMap, shared_map
from circuits.arrays import Array, Integers, Truths

ROUNDS = 2
"""Number of rounds of the EM algorithm that finds the start."""
STEP = 0.02
"""Step of numerical gradients on the scale."""
FLAT = 100.0
"""Variance of the Gaussian that approximates the prior of means in proposals."""
HEAVY = 8.0
"""Degrees of freedom of proposals: their tails are heavier than those of a posterior."""


@dataclass(frozen=True)
class Person:
    """One person's likelihood on the scale, which is the same for everyone."""

    likelihood: Likelihood
    scale: Scale

    def __call__(self, scaled: Array) -> float:
        """Return the log likelihood, nats."""
        return float(self.likelihood.each(self.scale.back(scaled)).sum())

    def gradient(self, scaled: Array) -> Array:
        """Return the gradient of the log likelihood, by central differences, (parameters,)."""
        steps = STEP * np.eye(len(scaled))
        return np.array([self(scaled + h) - self(scaled - h) for h in steps]) / (2 * STEP)

    def peak(self, group: Group, start: Array) -> Array:
        """Return the most probable parameters given the group's distribution, (parameters,)."""
        from scipy.optimize import minimize

        def loss(scaled: Array) -> float:
            return -self(scaled) - float(group.log_prior(scaled))

        minimum = minimize(loss, start, method="L-BFGS-B", options={"eps": STEP / 10, "ftol": 1e-7})
        return np.asarray(minimum.x)

    def expanded(self, scaled: Array) -> tuple[Array, Array]:
        """Return gradient and expected information of the log likelihood at a point."""
        slope = self.scale.slope(scaled)
        information, _ = self.likelihood.information(self.scale.back(scaled))
        # That of a circuit, estimated from two halves of its trials, may have negative eigenvalues.
        values, vectors = np.linalg.eigh(information * np.outer(slope, slope))
        return self.gradient(scaled), (vectors * np.maximum(values, 0)) @ vectors.T


@dataclass(frozen=True)
class Expansion:
    """Everyone's log likelihood to second order: ``g'(x - x0) - (x - x0)'H(x - x0) / 2``."""

    point: Array  # x0, (people, parameters)
    slope: Array  # g, (people, parameters)
    precision: Array  # H, (people, parameters, parameters), positive semi-definite

    @property
    def pull(self) -> Array:
        """Coefficient of x, g + H x0, (people, parameters)."""
        return np.asarray(np.einsum("pij,pj->pi", self.precision, self.point) + self.slope)

    def times(self, group: Group) -> Proposal:
        """Return the product with the group's distribution: a Gaussian for each person."""
        means, own = group.means, group.precision
        pull = means / group.variance if group.correlation is None else means @ own
        return proposal_of(self.precision + own, self.pull + pull)

    def shared(self, scores: Array, now: Array, which: Integers, group: Group) -> Proposal:
        """Return the proposal for a group's means and standard deviations, given standard scores z.

        Parameters are ``x = m + s z + offsets``, so that an expansion in x is one in (m, s); those
        at ``which`` are drawn, the others keep their values ``now``.
        """
        _, prior, _, _ = group.law
        both = np.stack([np.ones(scores.shape), scores], axis=1)  # people, (m, s), parameters
        size = 2 * scores.shape[1]
        precision = np.einsum("pai,pij,pbj->aibj", both, self.precision, both).reshape(size, size)
        near = np.where(prior[:, 6] > 0, prior[:, 6], 1 / FLAT)
        precision += np.diag(np.append(near, np.full(scores.shape[1], 1 / SPREAD**2)))
        offsets = np.broadcast_to(group.offsets, scores.shape)
        away = np.einsum("pij,pj->pi", self.precision, offsets)
        pull = np.einsum("pai,pi->ai", both, self.pull - away)
        pull[0] += near * prior[:, 5]
        pull = pull.ravel()
        rest = np.setdiff1d(np.arange(size), which)
        pull = pull[which] - precision[np.ix_(which, rest)] @ now[rest]
        return proposal_of(precision[np.ix_(which, which)], pull)


@dataclass(frozen=True)
class Proposal:
    """Multivariate t distributions, with any number of leading axes."""

    mean: Array  # (..., parameters)
    root: Array  # Lower Cholesky factors of the inverses of their scale matrices.

    def draw(self, rng: np.random.Generator) -> Array:
        """Return a draw from each, (..., parameters)."""
        widened = np.sqrt(HEAVY / rng.chisquare(HEAVY, size=self.mean.shape[:-1]))
        normal = rng.normal(size=self.mean.shape)
        away = np.linalg.solve(np.swapaxes(self.root, -1, -2), normal[..., None])[..., 0]
        return np.asarray(self.mean + widened[..., None] * away)

    def log_density(self, scaled: Array) -> Array:
        """Return the log density of each."""
        from scipy.special import gammaln

        size = self.mean.shape[-1]
        constant = gammaln((HEAVY + size) / 2) - gammaln(HEAVY / 2)
        constant -= size / 2 * np.log(HEAVY * np.pi)
        away = np.einsum("...ij,...i->...j", self.root, scaled - self.mean)
        determinant = np.log(np.diagonal(self.root, axis1=-2, axis2=-1)).sum(axis=-1)
        distance = (away**2).sum(axis=-1)
        return np.asarray(constant + determinant - (HEAVY + size) / 2 * np.log1p(distance / HEAVY))

    @property
    def variances(self) -> Array:
        """Diagonals of the scale matrices, (..., parameters)."""
        return np.asarray((np.linalg.inv(self.root) ** 2).sum(axis=-2))


def proposal_of(precision: Array, pull: Array) -> Proposal:
    """Return the proposal for log densities ``pull'x - x' precision x / 2``."""
    mean = np.linalg.solve(precision, pull[..., None])[..., 0]
    return Proposal(np.asarray(mean, float), np.asarray(np.linalg.cholesky(precision), float))


def estimates(likelihoods: Sequence[Likelihood], workers: int = 1) -> Array:
    """Return each person's parameters under a wide prior, (people, parameters), in their units."""
    scale = Scale.of(likelihoods[0].freedom)
    start = scale.to(np.array([each.starts()[-1] for each in likelihoods]))
    wide = Group(start.mean(axis=0), np.full(start.shape[1], (2 * SPREAD) ** 2))
    people = [Person(each, scale) for each in likelihoods]
    with shared_map(workers, people) as over_people:
        return scale.back(np.array(over_people(_peak, [(k, wide, x) for k, x in enumerate(start)])))


def started(
    over_people: SharedMap, start: Array, shared: Truths | bool = False
) -> tuple[Group, Expansion]:
    """Return the distribution of the group and the expansion around everyone's peak, by EM."""
    points, group = start, Group(start.mean(axis=0), np.full(start.shape[1], SPREAD**2))
    for _ in range(ROUNDS):
        expanded = over_people(_expanded_at_peak, [(k, group, x) for k, x in enumerate(points)])
        points, slopes, precisions = (np.array(part) for part in zip(*expanded, strict=True))
        expansion = Expansion(points, slopes, precisions)
        group = group_of(points, expansion.times(group).variances, shared)
    return group, expansion


def _peak(people: Sequence[Person], k: int, group: Group, start: Array) -> Array:
    return people[k].peak(group, start)


def _expanded_at_peak(
    people: Sequence[Person], k: int, group: Group, start: Array
) -> tuple[Array, Array, Array]:
    point = people[k].peak(group, start)
    return point, *people[k].expanded(point)
