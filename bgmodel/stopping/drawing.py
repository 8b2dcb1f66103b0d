"""The figure of stop-signal trials: inhibition function, and times of responses."""

from __future__ import annotations

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


@styled
def draw(trials: StopTrials) -> Figure:
    """Draw the inhibition function with that of a race, and the distributions of times."""
    with quiet(DataWarning):  # few trials are in the title
        found = estimate_ssrt(trials, checked=False)
    go = trials.rt_ms[~trials.stop]
    failed = trials.rt_ms[trials.stop]
    figure, ((left, right),) = panels(1, 2, size=(6.4, 2.8))
    table = inhibition_function(trials)
    ends = np.abs(table[["low", "high"]].to_numpy() - table[["p_respond"]].to_numpy()).T
    style: Look = {"ms": 4, "color": PALETTE[0], "label": "Stop trials"}
    left.errorbar(table["ssd_ms"], table["p_respond"], ends, fmt="o", capsize=2, **style)
    delays = np.linspace(0, float(np.nanmax(trials.ssd_ms)), 200)
    ssrt_ms = ssrt_by_delay(table)
    race = np.searchsorted(np.sort(go), delays + ssrt_ms, side="right") / len(go)  # NaN is last
    left.plot(delays, race, color=GREY, label=f"Race, SSRT {ssrt_ms:.0f} ms")
    left.set(xlabel="Stop-signal delay (ms)", ylabel="Share with a response", ylim=(-0.03, 1.03))
    left.legend(loc="upper left")
    _cumulative(right, go, "Go trials", PALETTE[0], "-")
    _cumulative(right, failed[~np.isnan(failed)], "Failed stops", PALETTE[1], "--")
    right.set(xlabel="Response time (ms)", ylabel="Cumulative share", ylim=(-0.03, 1.03))
    right.legend(loc="lower right")
    stops = int(trials.stop.sum())
    title = f"{len(go)} go trials, {stops} stop trials; bars: 95 % Wilson intervals"
    refused = f"\nThe consensus guide accepts no SSRT: {found.refusal}" if found.refusal else ""
    figure.suptitle(title + refused, x=0.01, ha="left")
    return figure


def _cumulative(ax: Axes, times_ms: Array, label: str, colour: str, style: str) -> None:
    """Draw the share of trials that responded up to a time; trials without a response are in it."""
    made = np.sort(times_ms[~np.isnan(times_ms)])
    if len(made):
        ax.step(made, np.arange(1, len(made) + 1) / len(times_ms), where="post", color=colour,
                ls=style, label=label)  # fmt: skip
