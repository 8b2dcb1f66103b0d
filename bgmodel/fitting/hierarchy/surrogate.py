"""Gaussian-process surrogates of people's log likelihoods, a hundred times as fast to evaluate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from bgmodel.fitting.hierarchy.approximation import Person
from bgmodel.support.compiling import compiled
from bgmodel.support.processes import SharedMap
from circuits.arrays import Array, Integers

POINTS, MOST_POINTS = 80, 1000
"""Number of points per parameter at which the exact log likelihood is evaluated, and largest number
of points: fitting them takes less time than evaluating the likelihood there."""
WIDER = 2.0
"""Factor by which the Gaussian of points that are not draws is wider than the draws, so that the
surrogate is right where a chain has not been yet."""
LENGTHS, AMPLITUDES = (3.0, 6.0, 12.0, 24.0), (0.3, 3.0, 30.0, 300.0)
"""Lengths of the kernel, in standard deviations of draws, and its amplitudes, nats. The pair with
the largest marginal likelihood is used."""
ERROR, GROWTH = 0.01, 0.02
"""Assumed standard deviation of the error at a point, nats, and its growth per nat below the
highest log likelihood: where chains rarely are, the surrogate need not be exact."""
FARTHEST = 60.0
"""Nats below the highest log likelihood at which points are left out: chains never get there, and
such differences would need large weights."""
COEFFICIENT = 100.0
"""Standard deviation of coefficients of the quadratic part under their prior, nats."""
MARGIN = 1.0
"""Nats above the highest known log likelihood at which an extrapolation is capped."""
RIDGE, SMALLEST = 0.01, 1e-4
"""Share of the variances of draws, and variance, that are added to these variances, for people
whose draws hardly moved."""


@dataclass(frozen=True)
class Surrogate:
    """Everyone's log likelihood, approximated by a quadratic function and a Gaussian process.

    In the height of a parameter above the lower end of its range, ``y = log(1 + exp(x))``: the log
    likelihood is constant in x towards both ends. Positions are ``u = R^-1 (y - c)``.
    """

    # Lower Cholesky factor of the covariance of each person's draws, which sets the size of steps.
    root: Array
    centre: Array  # c, (people, parameters), mean of the draws' heights
    inverse: Array  # R^-1, with R the lower Cholesky factor of their covariance.
    highest: Array  # (people, parameters), height of the upper end of each range
    quadratic: Array  # Lower triangle Q of ``(1, u)' Q (1, u)``.
    points: Array  # (people, parameters, points), positions of the kernels
    weights: Array  # w of each kernel ``w / (l^2 + distance^2)^2`` (Rasmussen & Williams 2006).
    length: Array  # l, (people,)
    ceiling: Array  # (people,), upper limit of the surrogate, nats

    @property
    def arrays(self) -> tuple[Array, ...]:
        """All arrays, as compiled functions take them."""
        return tuple(getattr(self, each.name) for each in fields(self))


def surrogate_of(
    over_people: SharedMap, draws: Array, log_likelihood: Array, rng: np.random.Generator
) -> Surrogate:
    """Return the surrogate from draws (draws, people, parameters), and from points around them."""
    jobs = [
        (k, draws[:, k], log_likelihood[:, k], of_person)
        for k, of_person in enumerate(rng.spawn(draws.shape[1]))
    ]
    parts = zip(*over_people(_of_person, jobs), strict=True)
    return Surrogate(*(np.array(part) for part in parts))


def _of_person(
    people: Sequence[Person], k: int, draws: Array, log_likelihood: Array, rng: np.random.Generator
) -> tuple[Any, ...]:
    person, size = people[k], draws.shape[1]
    number = min(POINTS * size, MOST_POINTS)
    highest = person.scale.heights
    heights = _heights(draws, highest)
    root, centre, inverse = _root(draws), heights.mean(axis=0), np.linalg.inv(_root(heights))
    distinct = np.unique(draws, axis=0, return_index=True)[1]
    chosen = distinct[_farthest((heights[distinct] - centre) @ inverse.T, number // 2)]
    around = draws.mean(axis=0) + WIDER * rng.normal(size=(number - len(chosen), size)) @ root.T
    logs = np.array([*log_likelihood[chosen], *(person(x) for x in around)])
    positions = np.concatenate([heights[chosen], _heights(around, highest)]) - centre
    fitted = _fitted(positions @ inverse.T, np.nan_to_num(logs, nan=-np.inf, neginf=-np.inf))
    return (root, centre, inverse, highest, *fitted)


def _root(draws: Array) -> Array:
    size = draws.shape[1]
    covariance = np.cov(draws.T).reshape(size, size)
    more = RIDGE * np.diagonal(covariance) + SMALLEST
    return np.asarray(np.linalg.cholesky(covariance + np.diag(more)))


def _heights(scaled: Array, highest: Array) -> Array:
    """Return distances of parameters from the lower ends of their ranges, in units of the scale."""
    return np.asarray(np.minimum(np.logaddexp(0.0, scaled), highest))


def _farthest(points: Array, number: int) -> Integers:
    """Return indices of points, each the farthest from those before it, to cover all modes."""
    chosen = [int((points**2).sum(axis=1).argmin())]
    squares = np.full(len(points), np.inf)
    while len(chosen) < min(number, len(points)):
        squares = np.minimum(squares, ((points - points[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(squares.argmax()))
    return np.array(chosen)


def _fitted(points: Array, logs: Array) -> tuple[Array, Array, Array, float, float]:
    """Return quadratic, points, weights, length and ceiling of one person's surrogate."""
    from scipy.linalg import cholesky, solve_triangular
    from scipy.spatial.distance import cdist

    (number, size), highest = points.shape, logs.max()
    depth = highest - logs
    near = depth < FARTHEST
    depth, some = depth[near], points[near]
    with_one = np.column_stack([np.ones(len(some)), some])
    rows, columns = np.tril_indices(size + 1)
    basis = with_one[:, rows] * with_one[:, columns]
    rest = COEFFICIENT**2 * basis @ basis.T + np.diag((ERROR + GROWTH * depth) ** 2)
    squares = cdist(some, some, "sqeuclidean")
    best = -np.inf
    for length in LENGTHS:
        kernel = length**4 / (length**2 + squares) ** 2
        for amplitude in AMPLITUDES:
            factor = cholesky(amplitude**2 * kernel + rest, lower=True)
            half = solve_triangular(factor, -depth, lower=True)
            evidence = -half @ half / 2 - np.log(np.diagonal(factor)).sum()
            if evidence > best:
                best, chosen = evidence, (length, amplitude, factor, half)
    length, amplitude, factor, half = chosen
    solved = solve_triangular(factor, half, lower=True, trans=1)
    quadratic = np.zeros((size + 1, size + 1))
    quadratic[rows, columns] = COEFFICIENT**2 * basis.T @ solved
    quadratic[0, 0] += highest
    # Everyone needs the same number of points: those that are left out have a weight of 0.
    weights = np.zeros(number)
    weights[near] = amplitude**2 * length**4 * solved
    return quadratic, np.ascontiguousarray(points.T), weights, length, highest + MARGIN


@compiled
def value(scaled: Array, person: int, surrogate: tuple[Array, ...]) -> float:
    """Return the log likelihood of one person at parameters (parameters,), nats."""
    _, centre, inverse, highest, quadratic, points, weights, length, ceiling = surrogate
    size, number = points.shape[1:]
    squares = np.full(number, length[person] ** 2)
    at = np.ones(size + 1)
    total = 0.0
    away = np.minimum(np.logaddexp(0.0, scaled), highest[person]) - centre[person]
    for i in range(size):
        place = 0.0
        for j in range(i + 1):
            place += inverse[person, i, j] * away[j]
        at[i + 1] = place
        for n in range(number):
            squares[n] += (place - points[person, i, n]) ** 2
    for i in range(size + 1):
        for j in range(i + 1):
            total += quadratic[person, i, j] * at[i] * at[j]
    return float(min(total + _kernels(weights[person], squares), ceiling[person]))


def _kernels_of(weights: Array, squares: Array) -> float:
    total = 0.0
    for n in range(len(weights)):
        total += weights[n] / (squares[n] * squares[n])
    return total


# Terms may be added in any order, so that the sum is compiled to vector instructions.
_kernels = compiled(_kernels_of, fastmath={"reassoc"})


@compiled
def values(scaled: Array, surrogate: tuple[Array, ...]) -> Array:
    """Return the log likelihood at everyone's parameters (people, parameters), nats."""
    logs = np.empty(len(scaled))
    for person in range(len(scaled)):
        logs[person] = value(scaled[person], person, surrogate)
    return logs
