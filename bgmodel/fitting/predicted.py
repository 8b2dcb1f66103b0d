"""Predictive accuracy of a model on held-out trials (cross-validation)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bgmodel.fitting.identify import directions
from bgmodel.fitting.likelihood import Likelihood
from bgmodel.fitting.optimum import optimum
from bgmodel.fitting.simulated.error import jackknifed, without_parts
from bgmodel.support.arrays import Array, Integers
from bgmodel.support.seeds import stream

FOLDS, FOLDS_SEED = 5, 24_301
"""Number of parts into which trials are divided, and the seed of the division."""


@dataclass(frozen=True)
class Predicted:
    """Log likelihood of each trial under the fit to the other folds."""

    each: Array  # (trials,), nats
    without: Array  # (parts, trials), without each part of simulated trials; no rows if exact


@dataclass(frozen=True)
class Better:
    """Advantage of one model's predictions over another's, summed over trials, nats."""

    nats: float
    error: float  # from the data and from the simulated trials of both models
    simulation_error: float  # the part due to simulated trials


def predicted(
    likelihood: Likelihood,
    *,
    start: Array | None = None,
    folds: int = FOLDS,
    seed: int = FOLDS_SEED,
    tell: Callable[[int], None] | None = None,
) -> Predicted:
    """Return the log likelihood of each trial under the fit to the other folds.

    The trials of each cell are divided evenly. With the same seed all models have the same folds,
    so that they can be compared trial by trial. Searches begin at ``start``; ``tell`` is called
    with the number of folds done.
    """
    part = _divided(likelihood.groups, folds, seed)
    each = np.empty(len(part))
    without = np.empty((len(likelihood.without_parts()), len(part)))
    starts = None if start is None else [start]
    for fold in range(folds):
        left = likelihood.part(np.flatnonzero(part != fold))
        rest = likelihood.part(np.flatnonzero(part == fold))
        vector = optimum(left, starts=starts).vector
        each[part == fold] = rest.unbiased(vector)
        if len(without):
            moved = without_parts(left, directions(left, vector))
            for row, less, (_, at) in zip(without, rest.without_parts(), moved, strict=True):
                row[part == fold] = less.each(at)
        if tell is not None:
            tell(fold + 1)
    return Predicted(each, without)


def better_by(first: Predicted, second: Predicted, person: Integers | None = None) -> Better:
    """Return the advantage of one model's predictions over another's, nats.

    Both must have the same folds and simulated evidence. With several people, indexed by ``person``
    (trials,), they are the sample, since trials of one person are alike; by default trials are.
    """
    apart = first.each - second.each
    if person is not None and person.max() > 0:
        apart = by_person(apart, person)
    sampling = float(apart.std(ddof=1) * math.sqrt(len(apart)))
    one, other = (
        each.without.sum(axis=1) if len(each.without) else np.zeros(1) for each in (first, second)
    )
    simulation_error = float(jackknifed(one - other))
    return Better(float(apart.sum()), math.hypot(sampling, simulation_error), simulation_error)


def by_person(trials: Array, person: Integers) -> Array:
    """Return the sum of a quantity over the trials of each person, (people,)."""
    return np.asarray(np.bincount(person, trials), dtype=np.float64)


def _divided(cell: Integers, folds: int, seed: int) -> Integers:
    cell = np.asarray(cell)
    order = stream(seed, "folds").permutation(len(cell))
    part = np.empty(len(cell), dtype=np.int64)
    first = 0
    for each in np.unique(cell):
        some = order[cell[order] == each]
        part[some] = (first + np.arange(len(some))) % folds
        first += len(some)
    return part
