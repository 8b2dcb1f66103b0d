"""How well a model predicts trials that it was not fitted to."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bgmodel.fitting.identify import directions
from bgmodel.fitting.optimum import Likelihood, optimum
from bgmodel.fitting.simulation import jackknifed, without_parts
from bgmodel.support.arrays import Array
from bgmodel.support.seeds import stream

FOLDS = 5
FOLDS_SEED = 24_301


@dataclass(frozen=True)
class Predicted:
    """How well each trial is predicted by the fit to the other folds.

    Parameters
    ----------
    each : array (trials,), nats
        Log likelihood of each trial.
    without : array (parts, trials), nats
        The same with each part of the model's simulated trials left out in turn; no row where the
        model is exact.
    """

    each: Array
    without: Array


@dataclass(frozen=True)
class Better:
    """By how much one model predicts better than another.

    Parameters
    ----------
    nats : float
        Difference of the log likelihoods of all trials.
    error : float
        Its standard error, from the number of trials and from the simulated trials of both models.
    simulation_error : float
        The part of it that is due to the simulated trials.
    """

    nats: float
    error: float
    simulation_error: float


def predicted(
    likelihood: Likelihood,
    *,
    start: Array | None = None,
    folds: int = FOLDS,
    seed: int = FOLDS_SEED,
    tell: Callable[[int], None] | None = None,
) -> Predicted:
    """Return the log likelihood of each trial under the fit to the other folds.

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
    each = np.empty(len(part))
    without = np.empty((len(likelihood.model.left_out()), len(part)))
    starts = None if start is None else [start]
    for fold in range(folds):
        left = replace(likelihood, design=design.part(np.flatnonzero(part != fold)))
        rest = replace(likelihood, design=design.part(np.flatnonzero(part == fold)))
        vector = optimum(left, starts=starts).vector
        each[part == fold] = rest.each(vector)
        if len(without):
            moved = without_parts(left, directions(left, vector))
            for row, (less, at) in zip(without, moved, strict=True):
                row[part == fold] = replace(rest, model=less.model).each(at)
        if tell is not None:
            tell(fold + 1)
    return Predicted(each, without)


def better_by(first: Predicted, second: Predicted) -> Better:
    """Return by how many nats one model predicts better than another.

    Parameters
    ----------
    first, second : Predicted
        Of the same trials and folds. Parts of simulated trials have the same evidence in both.
    """
    apart = first.each - second.each
    sampling = float(apart.std(ddof=1) * math.sqrt(len(apart)))
    one, other = (
        each.without.sum(axis=1) if len(each.without) else np.zeros(1) for each in (first, second)
    )
    own = float(jackknifed(one - other))
    return Better(float(apart.sum()), math.hypot(sampling, own), own)


def _divided(cell: Sequence[int] | np.ndarray, folds: int, seed: int) -> np.ndarray:
    cell = np.asarray(cell)
    order = stream(seed, "folds").permutation(len(cell))
    part = np.empty(len(cell), dtype=np.int64)
    first = 0
    for each in np.unique(cell):
        some = order[cell[order] == each]
        part[some] = (first + np.arange(len(some))) % folds
        first += len(some)
    return part
