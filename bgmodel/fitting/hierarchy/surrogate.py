"""Gaussian-process surrogates of people's log likelihoods, a hundred times as fast to evaluate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from bgmodel.fitting.hierarchy.approximation import Person
from bgmodel.support.arrays import Array, Integers
from bgmodel.support.compiling import compiled

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
RIDGE = 0.01
"""Added to the variances of draws on the scale, for people whose draws hardly moved."""


@dataclass(frozen=True)
class Surrogate:
    """Everyone's log likelihood, approximated by a quadratic function and a Gaussian process.

    Parameters
    ----------
    centre, root : array (people, parameters), (people, parameters, parameters)
        Mean c of a person's draws, and lower Cholesky factor R of their covariance. The position of
        parameters x is ``u = R^-1 (x - c)``.
    inverse : array (people, parameters, parameters)
        ``R^-1``.
    quadratic : array (people, parameters + 1, parameters + 1)
        Lower triangle Q of the quadratic part ``(1, u)' Q (1, u)``.
    points, weights : array (people, parameters, points), (people, points)
        Positions of the kernels, and their weights w. The value of a kernel is
        ``w / (l^2 + distance^2)^2``, a rational quadratic (Rasmussen & Williams 2006).
    length : array (people,)
        l.
    ceiling : array (people,), nats
        Upper limit of the surrogate.
    """

    centre: Array
    root: Array
    inverse: Array
    quadratic: Array
    points: Array
    weights: Array
    length: Array
    ceiling: Array

    @property
    def arrays(self) -> tuple[Array, ...]:
        """All arrays, as compiled functions take them."""
        return tuple(getattr(self, each.name) for each in fields(self))


def surrogate_of(
    people: Sequence[Person], draws: Array, log_likelihood: Array, rng: np.random.Generator
) -> Surrogate:
    """Return the surrogate from draws and from new points around them.

    Parameters
    ----------
    people : sequence of Person
        Exact log likelihoods.
    draws, log_likelihood : array (draws, people, parameters), (draws, people)
        Earlier draws on the scale, and their log likelihoods, nats.
    rng : Generator
        Random numbers of the points that are not draws.
    """
    size = draws.shape[2]
    number = min(POINTS * size, MOST_POINTS)
    parts = []
    for k, person in enumerate(people):
        own, kept = np.unique(draws[:, k], axis=0, return_index=True)
        centre = draws[:, k].mean(axis=0)
        root = np.linalg.cholesky(np.cov(draws[:, k].T).reshape(size, size) + RIDGE * np.eye(size))
        inverse = np.linalg.inv(root)
        chosen = _farthest((own - centre) @ inverse.T, number // 2)
        around = centre + WIDER * rng.normal(size=(number - len(chosen), size)) @ root.T
        logs = np.array([*log_likelihood[kept[chosen], k], *(person(x) for x in around)])
        positions = (np.concatenate([own[chosen], around]) - centre) @ inverse.T
        fitted = _fitted(positions, np.nan_to_num(logs, nan=-np.inf, neginf=-np.inf))
        parts.append((centre, root, inverse, *fitted))
    return Surrogate(*(np.array(each) for each in zip(*parts, strict=True)))


def _farthest(points: Array, number: int) -> Integers:
    """Return indices of points, each the farthest from those before it.

    So that the few draws of a remote mode are included.
    """
    chosen = [int((points**2).sum(axis=1).argmin())]
    squares = np.full(len(points), np.inf)
    while len(chosen) < min(number, len(points)):
        squares = np.minimum(squares, ((points - points[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(squares.argmax()))
    return np.array(chosen)


def _fitted(points: Array, logs: Array) -> tuple[Array, Array, Array, float, float]:
    """Fit one person's surrogate to log likelihoods at points (points, parameters).

    Returns quadratic, points, weights, length and ceiling.
    """
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
    own = solve_triangular(factor, half, lower=True, trans=1)
    quadratic = np.zeros((size + 1, size + 1))
    quadratic[rows, columns] = COEFFICIENT**2 * basis.T @ own
    quadratic[0, 0] += highest
    # Everyone needs the same number of points: those that are left out have a weight of 0.
    weights = np.zeros(number)
    weights[near] = amplitude**2 * length**4 * own
    return quadratic, np.ascontiguousarray(points.T), weights, length, highest + MARGIN


@compiled
def value(scaled: Array, person: int, surrogate: tuple[Array, ...]) -> float:
    """Return the log likelihood of one person at parameters (parameters,), nats."""
    centre, _, inverse, quadratic, points, weights, length, ceiling = surrogate
    size, number = points.shape[1:]
    squares = np.full(number, length[person] ** 2)
    at = np.ones(size + 1)
    found = 0.0
    for i in range(size):
        place = 0.0
        for j in range(i + 1):
            place += inverse[person, i, j] * (scaled[j] - centre[person, j])
        at[i + 1] = place
        for n in range(number):
            squares[n] += (place - points[person, i, n]) ** 2
    for i in range(size + 1):
        for j in range(i + 1):
            found += quadratic[person, i, j] * at[i] * at[j]
    return float(min(found + _kernels(weights[person], squares), ceiling[person]))


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
    found = np.empty(len(scaled))
    for person in range(len(scaled)):
        found[person] = value(scaled[person], person, surrogate)
    return found
