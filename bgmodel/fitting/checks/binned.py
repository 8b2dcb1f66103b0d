"""Bins of time as narrow as a fit needs: fast decisions change within a bin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bgmodel.fitting.exact.responses import Grid
from bgmodel.fitting.identify import Directions, directions
from bgmodel.fitting.likelihood import STEP, BinnedLikelihood, Likelihood
from bgmodel.fitting.optimum import Optimum, optimum
from bgmodel.support.arrays import Array

LARGE = 1 / 3
"""A fit warns if bins move a parameter by more than this share of its standard error."""
PARTS = 4
"""Number of parts of a bin, by which the error of bins is estimated."""
LARGE_NATS, MOST_TIMES = 0.3, 3
"""A fit is repeated with narrower bins if these change its log likelihood by more, nats, or move a
parameter by more than ``LARGE``; and how often that may be."""


def resolved(fitted: Optimum) -> Optimum:
    """Return the optimum, fitted again with narrower bins of time while that changes it."""
    for _ in range(MOST_TIMES):
        likelihood, at = fitted.likelihood, fitted.vector
        if not _has_bins(likelihood):
            break
        there = directions(likelihood, at)
        share = np.abs(moved_by_bins(likelihood, there)) / there.standard_errors
        off = abs(finer(likelihood).each(at).sum() - fitted.log_likelihood)
        if off <= LARGE_NATS and not (share > LARGE).any():
            break
        fitted = optimum(finer(likelihood), starts=[at])
    return fitted


def _has_bins(likelihood: Likelihood) -> bool:
    """Whether densities are computed in bins of any width."""
    return isinstance(likelihood, BinnedLikelihood) and hasattr(likelihood.model, "any_width")


def finer(likelihood: Likelihood) -> Likelihood:
    """Return a likelihood with ``PARTS`` bins in place of each."""
    design = likelihood.design
    lapses = design.grid.lapse_bins
    grid = Grid(PARTS * design.grid.bins, design.grid.width_s / PARTS, lapses and PARTS * lapses)
    return replace(likelihood, design=replace(design, observed=replace(design.observed, grid=grid)))


def moved_by_bins(likelihood: Likelihood, there: Directions) -> Array:
    """Return the error of each estimate at the optimum that is due to bins, (parameters,).

    By a step of Fisher scoring in the likelihood with finer bins, which removes ``1 - 1 / PARTS``
    of an error in proportion to their width; 0 if the model has bins of one width only, or
    parameters are not identifiable.
    """
    if not (_has_bins(likelihood) and np.isfinite(there.standard_errors).all()):
        return np.zeros(len(there.vector))
    fine = finer(likelihood)
    low, high = likelihood.freedom.low, likelihood.freedom.high
    score = np.empty(len(there.vector))
    for k, step in enumerate(STEP * there.standard_errors):
        ends = np.array([there.vector, there.vector])
        ends[:, k] = np.clip(ends[:, k] + [-step, step], low[k], high[k])
        below, above = ((fine.each(end) - likelihood.each(end)).sum() for end in ends)
        score[k] = (above - below) / (ends[1, k] - ends[0, k])
    return np.asarray(-PARTS / (PARTS - 1) * np.linalg.solve(there.information, score))


def of_bins(likelihood: Likelihood, there: Directions) -> list[str]:
    """Return a warning if bins move a parameter by more than ``LARGE`` standard errors."""
    moved = moved_by_bins(likelihood, there)
    share = np.abs(moved) / there.standard_errors
    named = [
        f"{name} by about {by:+.1g} ({size:.1f} standard errors)"
        for name, by, size in zip(there.names, moved, share, strict=True)
        if size > LARGE
    ]
    if not named:
        return []
    off = (likelihood.each(there.vector) - finer(likelihood).each(there.vector)).sum()
    return [
        f"decisions are so fast that bins of {likelihood.design.grid.width_s:g} s move the "
        f"estimates of {', '.join(named)}, and the log likelihood by {off:+.1f} nats"
    ]
