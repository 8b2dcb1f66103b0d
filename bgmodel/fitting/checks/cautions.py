"""Warnings of a fit: numbers at bounds, late responses, short chains, errors."""

from __future__ import annotations

import numpy as np

from bgmodel.fitting.checks.binned import of_bins
from bgmodel.fitting.identify import Directions
from bgmodel.fitting.optimum import Optimum
from bgmodel.fitting.posterior import ENOUGH, Posterior
from bgmodel.fitting.simulated.error import Simulation

SMALL_SHARE = 1 / 3
"""A fit warns if the simulation error over the error from the data exceeds this ratio."""
VAGUE_SHARE = 0.5
"""A number that can't be near 0 is hardly identified if its error exceeds this share of it."""
LATEST_T0_S = 1.0
"""A fit warns if the non-decision time exceeds this, s: sensing and moving take less."""


def cautions(
    fitted: Optimum, there: Directions, simulated: Simulation, drawn: Posterior | None
) -> list[str]:
    """Return the warnings of a fit, apart from those of misfit and identifiability."""
    numerical = [*_rough(there, simulated), *of_bins(fitted.likelihood, there)]
    return [*numerical, *_ended(fitted), *_vague(fitted, there), *_late(fitted), *_short(drawn)]


def _ended(fitted: Optimum) -> list[str]:
    """Return a warning for each number that ends at a bound of its range."""
    return [
        f"{name} ends at a bound of its range, {value:.3g}: its standard error is meaningless"
        for (name, value), ends in zip(fitted.values.items(), fitted.at_bound, strict=True)
        if ends
    ]


def _vague(fitted: Optimum, there: Directions) -> list[str]:
    """Return a warning for each number that can't be near 0, and hardly differs from it."""
    errors = zip(fitted.values.items(), there.standard_errors, fitted.at_bound, strict=True)
    return [
        f"these trials hardly identify {name} ({value:.3g} +- {error:.2g}): fix it, or add trials "
        "with other evidence"
        for (name, value), error, ends in errors
        if name in fitted.likelihood.sized and not ends and VAGUE_SHARE * value < error < np.inf
    ]


def _late(fitted: Optimum) -> list[str]:
    """Return a warning for each non-decision time that is implausibly long."""
    return [
        f"{name} is {value:.3g} s, longer than sensing and moving take: check that rt begins at "
        "the onset of evidence, not of the trial"
        for name, value in fitted.values.items()
        if name.partition("[")[0] == "t0_s" and value > LATEST_T0_S
    ]


def _short(drawn: Posterior | None) -> list[str]:
    """Return a warning if a chain of draws is short compared with its autocorrelation time."""
    if drawn is None or drawn.long_enough:
        return []
    return [
        f"the chain of draws lasts {drawn.lasts:.0f} of its autocorrelation times, not "
        f"{ENOUGH}: its effective sample size is below {drawn.effective:.0f}, and "
        "intervals are rough"
    ]


def _rough(there: Directions, simulated: Simulation) -> list[str]:
    """Return a warning if the simulation error is more than a third of a standard error."""
    share = simulated.parameters / there.standard_errors
    rough = [
        f"{name} ({value:.0%})"
        for name, value in zip(there.names, share, strict=True)
        if value > SMALL_SHARE
    ]
    if not rough:
        return []
    return [
        "the error that comes from the number of simulated trials is more than a third of that "
        f"from the data: {', '.join(rough)}. Simulate more trials (trials)"
    ]
