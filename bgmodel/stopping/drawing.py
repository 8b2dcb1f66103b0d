"""The figure of stop-signal trials: inhibition function, and times of responses, with models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bgmodel.stopping.estimates import (
    estimate_ssrt,
    inhibition_function,
    ssrt_by_delay,
)
from bgmodel.stopping.trials import StopTrials
from bgmodel.support.arrays import Array
from circuits.errors import DataWarning, quiet
from circuits.plots import GREY, PALETTE, Look, panels, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


MOST_DELAYS, STEP_MS = 12, 50.0
"""Largest number of delays drawn one by one, and the steps to which more are pooled."""


@styled
def draw(
    trials: StopTrials,
    models: Mapping[str, Sequence[StopTrials]] | None = None,
    heading: str = "",
) -> Figure:
    """Draw the inhibition function and times; models are given by copies with their responses."""
    with quiet(DataWarning):  # few trials are in the title
        ssrt = estimate_ssrt(trials, checked=False)
    go = trials.rt_ms[~trials.stop]
    failed = trials.rt_ms[trials.stop]
    figure, ((left, right),) = panels(1, 2, size=(6.4, 2.8))
    shown = _pooled(trials)
    table = inhibition_function(shown)
    ends = np.abs(table[["low", "high"]].to_numpy() - table[["p_respond"]].to_numpy()).T
    style: Look = {"ms": 4, "color": PALETTE[0], "label": "Stop trials"}
    left.errorbar(table["ssd_ms"], table["p_respond"], ends, fmt="o", capsize=2, **style)
    if models:
        delays, place = np.unique(shown.ssd_ms[trials.stop], return_inverse=True)
        styles = zip(models.items(), PALETTE[2:], ("--", ":", "-.", "-"), strict=False)
        for (name, model), colour, dashes in styles:
            rt_ms = np.array([each.rt_ms[trials.stop] for each in model])
            p = np.bincount(place, (~np.isnan(rt_ms)).mean(axis=0)) / np.bincount(place)
            left.plot(delays, p, color=colour, ls=dashes, label=name)
            _cumulative(right, rt_ms.ravel(), f"Failed stops, {name}", colour, dashes)
    else:
        delays = np.linspace(0, float(np.nanmax(trials.ssd_ms)), 200)
        ssrt_ms = ssrt_by_delay(inhibition_function(trials))
        race = np.searchsorted(np.sort(go), delays + ssrt_ms, side="right") / len(go)  # NaN is last
        left.plot(delays, race, color=GREY, label=f"Race, SSRT {ssrt_ms:.0f} ms")
    left.set(xlabel="Stop-signal delay (ms)", ylabel="Share with a response", ylim=(-0.03, 1.03))
    left.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    _cumulative(right, go, "Go trials", PALETTE[0], "-")
    failed = failed if models else failed[~np.isnan(failed)]
    _cumulative(right, failed, "Failed stops", PALETTE[1], "--")
    right.set(xlabel="Response time (ms)", ylabel="Cumulative share", ylim=(-0.03, 1.03))
    right.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    stops = int(trials.stop.sum())
    title = f"{len(go)} go trials, {stops} stop trials; bars: 95 % Wilson intervals"
    title += ", delays to the nearest 50 ms" if shown is not trials else ""
    title = f"{heading}: {title}" if heading else title
    refused = f"\nThe consensus guide accepts no SSRT: {ssrt.refusal}" if ssrt.refusal else ""
    figure.suptitle(title + refused, x=0.01, ha="left")
    return figure


def _pooled(trials: StopTrials) -> StopTrials:
    """Return the trials with delays to the nearest step of 50 ms where there are many delays."""
    if len(np.unique(trials.ssd_ms[trials.stop])) <= MOST_DELAYS:
        return trials
    return replace(trials, ssd_ms=np.round(trials.ssd_ms / STEP_MS) * STEP_MS)


def _cumulative(ax: Axes, times_ms: Array, label: str, colour: str, style: str) -> None:
    """Draw the share of trials that responded up to a time; trials without a response are in it."""
    made = np.sort(times_ms[~np.isnan(times_ms)])
    if len(made):
        ax.step(made, np.arange(1, len(made) + 1) / len(times_ms), where="post", color=colour,
                ls=style, label=label)  # fmt: skip
