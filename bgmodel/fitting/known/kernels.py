"""Psychophysical kernels: the weight of the reading at each position in the choice."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from bgmodel.fitting.known.trials import KnownTrials
from bgmodel.support.arrays import Array, Integers
from circuits.errors import require

if TYPE_CHECKING:
    import pandas as pd

POSITIONS = 8
PRIOR_SD = 5.0
"""Standard deviation of the Gaussian prior of weights, per standard deviation of a reading: it
matters only where readings determine the choice, and weights would be infinite."""
STEPS, SMALL = 50, 1e-8
ALIGNED = FROM_ONSET, BEFORE = "onset", "response"
DATA = "data"
"""Name of the kernel of the data."""


def kernels(likelihood: Any, vector: Array, *, positions: int = POSITIONS) -> pd.DataFrame:
    """Return psychophysical kernels of the data and of a model, a ``KnownLikelihood``.

    The model's is of its choices given the response times of the data. To the columns of ``kernel``
    are added ``of``, "data" or the name of the model, and ``align``, "onset" or "response".
    """
    import pandas as pd

    of = {DATA: None, likelihood.model.name: likelihood.chosen(vector)}
    tables = [
        kernel(likelihood.trials, chosen, positions=positions, align=align).assign(
            of=name, align=align
        )
        for align in ALIGNED
        for name, chosen in of.items()
    ]
    return pd.concat(tables, ignore_index=True)


def kernel(
    trials: KnownTrials,
    chosen: Array | None = None,
    *,
    positions: int = POSITIONS,
    align: str = FROM_ONSET,
) -> pd.DataFrame:
    """Return the weight, per nat, of the reading at each position in the choice.

    A conditional logit, ``P(i) ~ exp(b_i + sum_k w_k x_ik)`` with x the log-likelihoods of
    readings: for two alternatives it is the logistic regression of choice on the difference of
    evidence at each position. Readings after the response are left out; position 1 is the first, or
    the last before the response. ``chosen`` (trials, alternatives) replaces choices by a model's
    probabilities.
    """
    import pandas as pd

    some = np.flatnonzero((trials.choice >= 0) & (trials.seen > 0))
    x = _aligned(trials, some, positions, align)
    there = np.any(x != 0, axis=(0, 2))
    x = x[:, there]
    target = np.zeros((len(some), trials.alternatives))
    target[np.arange(len(some)), trials.choice[some]] = 1.0
    if chosen is not None:
        target = chosen[some]
    # Alternatives but the first have a constant.
    constant = np.tile(np.eye(trials.alternatives)[1:], (len(some), 1, 1))
    design = np.concatenate([constant, x - x.mean(axis=2, keepdims=True)], axis=1)
    weights, errors = _logit(design, target)
    begin = trials.alternatives - 1
    read = (np.arange(positions) < trials.seen[some][:, None]).sum(axis=0)
    return pd.DataFrame(
        {
            "position": 1 + np.flatnonzero(there),
            "weight": weights[begin:],
            "standard_error": errors[begin:],
            "trials": read[there],
        }
    )


def _aligned(trials: KnownTrials, some: Integers, positions: int, align: str) -> Array:
    """Return readings by position, (trials, positions, alternatives); 0 after the last reading."""
    require(align in ALIGNED, "align", f"must be one of {', '.join(ALIGNED)}", align)
    readings = np.zeros((len(some), positions, trials.alternatives))
    for k in range(positions):
        at = np.full(len(some), k) if align == FROM_ONSET else trials.seen[some] - 1 - k
        good = (at >= 0) & (at < trials.seen[some])
        readings[good, k] = trials.log_likelihood[some[good], at[good]]
    return readings


def _logit(design: Array, target: Array) -> tuple[Array, Array]:
    """Return weights and standard errors of a conditional logit, by Newton's method.

    ``design`` is (trials, weights, alternatives), ``target`` the probability of each choice.
    """
    scale = np.maximum(design.std(axis=(0, 2)), 1e-12)
    x = design / scale[:, None]
    precision = np.eye(x.shape[1]) / PRIOR_SD**2
    weights = np.zeros(x.shape[1])
    for _ in range(STEPS):
        score = np.einsum("tki,k->ti", x, weights)
        p = np.exp(score - score.max(axis=1, keepdims=True))
        p /= p.sum(axis=1, keepdims=True)
        slope = np.einsum("tki,ti->k", x, target - p) - precision @ weights
        mean = np.einsum("tki,ti->tk", x, p)
        curve = np.einsum("tki,ti,tli->kl", x, p, x, optimize=True) - mean.T @ mean + precision
        step = np.linalg.solve(curve, slope)
        weights = weights + step
        if np.abs(step).max() < SMALL:
            break
    return weights / scale, np.sqrt(np.diag(np.linalg.inv(curve))) / scale
