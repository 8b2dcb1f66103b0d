"""Surrogates of people's log likelihoods, a hundred times as fast: Gaussian processes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from bgmodel.fitting.hierarchy.approximation import Person
from bgmodel.support.arrays import Array, Integers
from bgmodel.support.compiling import compiled

POINTS, MOST_POINTS = 80, 1000
"""Number of points per parameter at which the exact log likelihood is known, and largest number."""
WIDER = 2.0
"""Points other than draws are from a Gaussian so many times as wide as these."""
LENGTHS, AMPLITUDES = (3.0, 6.0, 12.0, 24.0), (0.3, 3.0, 30.0, 300.0)
"""Lengths of the kernel, in standard deviations of draws, and its amplitudes, nats. The ones with
the largest evidence are used."""
ERROR, GROWTH = 0.01, 0.02
"""Standard deviation of the error at a point, nats, and its growth per nat below the highest log
likelihood: where chains rarely are, the surrogate need not be exact."""
FARTHEST = 60.0
"""Nats below the highest log likelihood at which points are left out."""
COEFFICIENT = 100.0
"""Standard deviation of coefficients of the quadratic part under their prior, nats."""
HIGHER = 1.0
"""Nats above the highest log likelihood at which an extrapolation is cut."""
RIDGE = 1e-6
"""Added to the variances of draws, so that none is 0."""


@dataclass(frozen=True)
class Surrogate:
    """Everyone's log likelihood, approximated by a quadratic function and a Gaussian process.

    Parameters
    ----------
    centre, inverse : array (people, parameters), (people, parameters, parameters)
        Mean c of a person's draws, and inverse of the lower Cholesky factor of their covariance.
        The position of parameters x is ``u = inverse (x - c)``.
    quadratic : array (people, parameters + 1, parameters + 1)
        Lower triangle Q of the quadratic part ``(1, u)' Q (1, u)``.
    points, weights : array (people, parameters, points), (people, points)
        Positions of the kernels, and their weights w. The value of a kernel is
        ``w / (l^2 + distance^2)^2``, a rational quadratic (Rasmussen & Williams 2006).
    length : array (people,)
        l.
    highest : array (people,), nats
        Largest value.
    """

    centre: Array
    inverse: Array
    quadratic: Array
    points: Array
    weights: Array
    length: Array
    highest: Array

    @property
    def arrays(self) -> tuple[Array, ...]:
        """All arrays, as compiled functions take them."""
        return tuple(getattr(self, each.name) for each in fields(self))

    def __call__(self, scaled: Array) -> Array:
        """Return the log likelihood at everyone's parameters (people, parameters), nats."""
        return values(np.ascontiguousarray(scaled), self.arrays)


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
        Random numbers of the choice of points.
    """
    size = draws.shape[2]
    number = min(POINTS * size, MOST_POINTS)
    parts = []
    for k, person in enumerate(people):
        own, kept = np.unique(draws[:, k], axis=0, return_index=True)
        centre = draws[:, k].mean(axis=0)
        root = np.linalg.cholesky(np.cov(draws[:, k].T).reshape(size, size) + RIDGE * np.eye(size))
        inverse = np.linalg.inv(root)
        chosen = _apart((own - centre) @ inverse.T, number // 2)
        around = centre + WIDER * rng.normal(size=(number - len(chosen), size)) @ root.T
        logs = [*log_likelihood[kept[chosen], k], *(person(x) for x in around)]
        positions = (np.concatenate([own[chosen], around]) - centre) @ inverse.T
        parts.append((centre, inverse, *_fitted(positions, np.array(logs))))
    return Surrogate(*(np.array(each) for each in zip(*parts, strict=True)))


def _apart(points: Array, number: int) -> Integers:
    """Return which points to use: each is the farthest from all that are used already.

    So that the few draws of a remote mode are among them.
    """
    chosen = [int((points**2).sum(axis=1).argmin())]
    far = np.full(len(points), np.inf)
    while len(chosen) < min(number, len(points)):
        far = np.minimum(far, ((points - points[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(far.argmax()))
    return np.array(chosen)


def _fitted(points: Array, logs: Array) -> tuple[Array, Array, Array, float, float]:
    """Return all but the first two fields of a surrogate of one person, from points (n, size)."""
    (number, size), highest = points.shape, logs.max()
    below = logs - highest
    near = below > -FARTHEST
    below, some = below[near], points[near]
    with_one = np.column_stack([np.ones(len(some)), some])
    rows, columns = np.tril_indices(size + 1)
    basis = with_one[:, rows] * with_one[:, columns]
    rest = COEFFICIENT**2 * basis @ basis.T + np.diag((ERROR - GROWTH * below) ** 2)
    squares = ((some[:, None] - some) ** 2).sum(axis=2)
    best = -np.inf
    for length in LENGTHS:
        kernel = length**4 / (length**2 + squares) ** 2
        for amplitude in AMPLITUDES:
            factor = np.linalg.cholesky(amplitude**2 * kernel + rest)
            half = np.linalg.solve(factor, below)
            evidence = -half @ half / 2 - np.log(np.diagonal(factor)).sum()
            if evidence > best:
                best, chosen = evidence, (length, amplitude, np.linalg.solve(factor.T, half))
    length, amplitude, own = chosen
    quadratic = np.zeros((size + 1, size + 1))
    quadratic[rows, columns] = COEFFICIENT**2 * basis.T @ own
    quadratic[0, 0] += highest
    # Everyone has as many points: those that were left out have no weight.
    weights = np.zeros(number)
    weights[near] = amplitude**2 * length**4 * own
    return quadratic, np.ascontiguousarray(points.T), weights, length, highest + HIGHER


@compiled
def value(scaled: Array, person: int, surrogate: tuple[Array, ...]) -> float:
    """Return the log likelihood of one person at parameters (parameters,), nats."""
    centre, inverse, quadratic, points, weights, length, highest = surrogate
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
    return float(min(found + _kernels(weights[person], squares), highest[person]))


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
