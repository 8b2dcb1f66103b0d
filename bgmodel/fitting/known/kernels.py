"""How a model of known evidence fits: hazards per reading, psychophysical kernels, their figure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from bgmodel.fitting.known.trials import KnownTrials, intervals
from circuits.arrays import Array, Integers
from circuits.errors import require
from circuits.plots import GREY, PALETTE, panels, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bgmodel.fitting.likelihood import Peak

POSITIONS = 8
PRIOR_SD = 5.0
"""Standard deviation of the Gaussian prior of weights, per standard deviation of a reading: it
matters only where readings determine the choice, and weights would be infinite."""
STEPS, SMALL = 50, 1e-8
ALIGNED = FROM_ONSET, BEFORE = "onset", "response"
DATA = "data"
"""Name of the kernel of the data."""


def kernels(likelihood: Any, vector: Array) -> pd.DataFrame:
    """Return psychophysical kernels of the data and of a model, aligned to onset and response."""
    of = {DATA: None, likelihood.model.name: likelihood.chosen(vector)}
    tables = [
        kernel(likelihood.trials, chosen, align=align).assign(of=name, align=align)
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

    By a conditional logit, ``P(i) ~ exp(b_i + sum_k w_k x_ik)`` with x the log-likelihoods of
    readings; ``chosen`` (trials, alternatives) replaces choices by a model's probabilities.
    """
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
    """Return weights and standard errors of a conditional logit, by Newton's method."""
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


FEWEST = 10
"""Readings that fewer trials reach are left out."""


def hazards(likelihood: Any, vector: Array) -> pd.DataFrame:
    """Return the share of running trials that respond after each reading and before the next.

    Intervals are shifted by the mean non-decision time; ``standard_error`` is under the model.
    """
    values, trials = likelihood.values(vector), likelihood.trials
    starts, ends = (each + values["t0_s"][:, None] for each in intervals(trials))
    before, after = (likelihood.answered(values, each).sum(axis=2) for each in (starts, ends))
    every = np.clip((after - before) / np.maximum(1 - before, 1e-12), 0.0, 1.0)
    rows = []
    for k in range(starts.shape[1] if trials.timed else 0):
        running = (k < trials.seen) & (trials.until_s >= starts[:, k])
        if running.sum() < FEWEST:
            continue
        share, ended = every[running, k], (trials.until_s < ends[:, k])[running]
        error = float(np.sqrt((share * (1 - share)).sum())) / int(running.sum())
        rows.append((k + 1, int(running.sum()), ended.mean(), share.mean(), error))
    names = ["reading", "running", "observed", "predicted", "standard_error"]
    return pd.DataFrame(rows, columns=names)


LOOK: dict[str, Any] = {"color": "k", "marker": "o", "ls": "", "ms": 3, "elinewidth": 0.8}
TITLES = (
    "a  Hazard per reading",
    "b  Kernel from the first reading",
    "c  Kernel before the response",
)


@styled
def draw_known(peaks: Mapping[str, Peak], title: str) -> Figure:
    """Draw hazards per reading and psychophysical kernels, data (95 % intervals) and models."""
    design = next(iter(peaks.values()))[0].design
    shares, kerns = (
        {name: table(*peak) for name, peak in peaks.items()} for table in (hazards, kernels)
    )
    figure, grid = panels(1, 3, size=(7.2, 2.9))
    axes: list[Axes] = list(grid.ravel())
    share, weight = next(iter(shares.values())), next(iter(kerns.values()))
    bars = 1.96 * share["standard_error"]
    axes[0].errorbar(share["reading"], share["observed"], bars, label="Data", **LOOK)
    for ax, align in zip(axes[1:], ALIGNED, strict=True):
        kernel = weight[(weight["of"] == DATA) & (weight["align"] == align)]
        ax.errorbar(kernel["position"], kernel["weight"], 1.96 * kernel["standard_error"], **LOOK)
        ax.axhline(0, color=GREY, lw=0.6, zorder=0)
    for k, name in enumerate(peaks):
        colour = PALETTE[k % len(PALETTE)]
        hazard, weights = shares[name], kerns[name]
        axes[0].plot(hazard["reading"], hazard["predicted"], color=colour, label=name)
        for ax, align in zip(axes[1:], ALIGNED, strict=True):
            kernel = weights[(weights["of"] != DATA) & (weights["align"] == align)]
            ax.plot(kernel["position"], kernel["weight"], color=colour)
    axes[0].set(xlabel="Reading", ylabel="Share of running trials that respond", ylim=(0, None))
    axes[1].set(xlabel="Reading", ylabel="Weight in the choice (per nat)")
    axes[2].set(xlabel="Readings before the response", ylabel="Weight in the choice (per nat)")
    axes[2].invert_xaxis()
    for ax, text in zip(axes, TITLES, strict=True):
        ax.set_title(text)
        ax.locator_params(axis="x", integer=True)
    figure.legend(loc="outside lower center", ncols=5)
    figure.suptitle(
        f"{title}: {design.trials.sum()} trials; bars: 95 % intervals", x=0.01, ha="left"
    )
    return figure
