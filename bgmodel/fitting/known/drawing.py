"""The figure of a fit on known evidence: hazards per reading and psychophysical kernels."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from bgmodel.fitting.known.hazards import hazards
from bgmodel.fitting.known.kernels import ALIGNED, DATA, kernels
from circuits.plots import GREY, PALETTE, panels, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bgmodel.fitting.likelihood import Peak

LOOK: dict[str, Any] = {"color": "k", "marker": "o", "ls": "", "ms": 3, "elinewidth": 0.8}
TITLES = (
    "a  Hazard per reading",
    "b  Kernel from the first reading",
    "c  Kernel before the response",
)


@styled
def draw_known(peaks: Mapping[str, Peak], title: str) -> Figure:
    """Draw hazards per reading and psychophysical kernels, data (95 % intervals) and models.

    A hazard is the share of running trials that respond after a reading, aligned by each model's
    non-decision time, and for data by the first model's.
    """
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
