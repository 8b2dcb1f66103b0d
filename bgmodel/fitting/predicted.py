"""How well a model predicts trials that it was not fitted to."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from bgmodel.arrays import Array
from bgmodel.fitting.optimum import Likelihood, optimum
from bgmodel.seeds import stream

FOLDS = 5
FOLDS_SEED = 24_301


def predicted(
    likelihood: Likelihood,
    *,
    start: Array | None = None,
    folds: int = FOLDS,
    seed: int = FOLDS_SEED,
    tell: Callable[[int], None] | None = None,
) -> Array:
    """Return the log likelihood of each trial under the fit to the other folds, (trials,), nats.

    The same seed divides the same trials alike for every model, so that two can be compared trial
    by trial.

    Parameters
    ----------
    likelihood : Likelihood
        Model, design, and what is free.
    start : array, optional
        Where each search begins, as the optimum for all trials; those of ``optimum`` if left out.
    folds : int
        Into how many parts the trials are divided, each cell evenly.
    seed : int
        Of the division.
    tell : function, optional
        Called with the number of folds done.
    """
    design = likelihood.design
    part = _divided(design.observed.cell, folds, seed)
    found = np.empty(len(part))
    starts = None if start is None else [start]
    for fold in range(folds):
        left = replace(likelihood, design=design.part(np.flatnonzero(part != fold)))
        rest = replace(likelihood, design=design.part(np.flatnonzero(part == fold)))
        found[part == fold] = rest.each(optimum(left, starts=starts).vector)
        if tell is not None:
            tell(fold + 1)
    return found


def better_by(first: Array, second: Array) -> tuple[float, float]:
    """Return by how many nats one model predicts better than another, and the standard error.

    Parameters
    ----------
    first, second : array (trials,)
        From ``predicted``, of the same trials and folds.
    """
    apart = first - second
    return float(apart.sum()), float(apart.std(ddof=1) * math.sqrt(len(apart)))


def _divided(cell: Sequence[int] | np.ndarray, folds: int, seed: int) -> np.ndarray:  # type: ignore[type-arg]
    cell = np.asarray(cell)
    order = stream(seed, "folds").permutation(len(cell))
    part = np.empty(len(cell), dtype=np.int64)
    first = 0
    for each in np.unique(cell):
        some = order[cell[order] == each]
        part[some] = (first + np.arange(len(some))) % folds
        first += len(some)
    return part
