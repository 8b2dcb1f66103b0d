"""The window of response times that a fit uses."""

from __future__ import annotations

import math

import numpy as np

from bgmodel.fitting.exact.responses import EVERY_TIME
from bgmodel.support.arrays import Array, Integers, Truths
from bgmodel.support.checks import reals
from bgmodel.tables.columns import FEWEST
from circuits.errors import DataWarning, InputError, require

RANGES = 25.0
"""Interquartile ranges above the upper quartile at which the default window ends.

No decision of a constant gap is that late: an exponential tail, such as its own, exceeds this in
fewer than one of 10^12 trials. Lapses may.
"""
ENOUGH = 20
"""Least number of responses of a cell for its quartiles to be used separately."""


def fence_s(rt_s: Array, cell: Integers) -> float:
    """Return the end of the default window, s; infinity if the quartiles are equal.

    In each cell of at least 20 responses it is the upper quartile plus 25 interquartile ranges; the
    latest of these is used. Without such a cell all responses are pooled.
    """
    answered = np.isfinite(rt_s)
    groups = [rt_s[answered & (cell == each)] for each in np.unique(cell)]
    groups = [group for group in groups if len(group) >= ENOUGH] or [rt_s[answered]]
    fences = []
    for group in groups:
        lower, upper = np.quantile(group, [0.25, 0.75]) if len(group) else (0.0, 0.0)
        fences.append(upper + RANGES * (upper - lower) if upper > lower else math.inf)
    return float(max(fences))


def check_window(rt_window: tuple[float, float]) -> None:
    """Raise ValueError unless a window has an earliest and a later latest time, s (may be inf)."""
    ends = reals("rt_window", rt_window)
    require(
        ends.shape == (2,) and 0 <= ends[0] < ends[1],
        "rt_window",
        "must be an earliest and a later latest time, 0 s or more, such as 0.2 5 (inf "
        "for no latest one)",
        rt_window,
    )


def in_window(
    rt_s: Array,
    cell: Integers,
    rt_window: tuple[float, float] | None,
    deadline_s: float | None,
    who: str,
) -> tuple[tuple[float, float], Truths]:
    """Return the window of a fit, s, and which trials are in it; warn of excluded trials.

    By default, without a deadline, it ends at ``fence_s``. A trial without a response is always in
    the window; at least 10 responses must be.
    """
    rule = ""
    if rt_window is not None:
        check_window(rt_window)
        window = (float(rt_window[0]), float(rt_window[1]))
    elif deadline_s is None:
        window = (0.0, fence_s(rt_s, cell))
        rule = f" (upper quartile plus {RANGES:g} interquartile ranges)"
    else:
        window = EVERY_TIME
    inside = np.isnan(rt_s) | ((rt_s >= window[0]) & (rt_s <= window[1]))
    out, responses = int((~inside).sum()), int(np.isfinite(rt_s).sum())
    span = f"between {window[0]:g} and {window[1]:.3g} s{rule}"
    if out and responses - out < FEWEST:
        raise InputError(
            f"rt_window must leave at least {FEWEST} responses, got {responses - out} of "
            f"{responses} of {who} {span}",
            "rt_window",
        )
    if out:
        DataWarning.warn(
            f"{who}: {out} of {responses} response times are excluded from the fit, the longest "
            f"{rt_s[~inside].max():.3g} s: it uses those {span}. To change this: rt_window (at the "
            "terminal --columns rt_window=); 0,inf keeps all"
        )
    elif rule:
        # All trials are included: the likelihood is that of all times.
        window = EVERY_TIME
    return window, inside
