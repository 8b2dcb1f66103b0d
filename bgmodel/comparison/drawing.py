"""The figure of a comparison: speed and accuracy, decision times trial by trial, same choices."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from bgmodel.comparison.thresholds import MSPRT, MSPRT_AT_GAIN
from bgmodel.integrators.deciding import CIRCUIT, DECODER
from circuits.plots import GREY, PALETTE, Look, panels, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LOOKS: dict[str, Look] = {
    MSPRT: {"color": "k", "lw": 1.0, "ls": "--", "zorder": 4},
    MSPRT_AT_GAIN: {"color": "k", "lw": 1.6},
    CIRCUIT: {"color": PALETTE[1], "lw": 1.6, "zorder": 3},
    DECODER: {"color": PALETTE[0], "lw": 1.2, "zorder": 2},
}
"""Lines of tests, circuit and decoder; baseline models follow in ``OTHERS``."""
OTHERS: tuple[Look, ...] = (
    {"color": PALETTE[2], "ls": "-."},
    {"color": PALETTE[3], "ls": (0, (5, 1))},
    {"color": PALETTE[4], "ls": ":"},
    {"color": PALETTE[5], "ls": (0, (3, 1, 1, 1, 1, 1))},
)
RISEN = 0.98
"""Panel a ends where the last model has made this share of its rise in accuracy."""
MANY = 2000
"""Number of trials above which panel b is a density."""


@styled
def draw(curves: pd.DataFrame, pairs: pd.DataFrame, table: pd.DataFrame, chance: float) -> Figure:
    """Draw the three panels of a comparison."""
    figure, axes = panels(1, 3, size=(7.2, 3.2))
    _curves(axes[0, 0], curves, chance)
    _times(axes[0, 1], pairs)
    _same(axes[0, 2], table, pairs)
    return figure


def _curves(ax: Axes, curves: pd.DataFrame, chance: float) -> None:
    """Draw speed-accuracy curves with pointwise 95 % intervals."""
    others, latest_ms = iter(OTHERS * len(curves)), 0.0
    for name, rows in curves.groupby("model", sort=False):
        style = LOOKS.get(str(name)) or next(others)
        ax.plot(
            rows["mean_ms"], rows["accuracy"], label=str(name)[0].upper() + str(name)[1:], **style
        )
        band: Look = {"color": style["color"], "alpha": 0.15, "lw": 0}
        ax.fill_between(rows["mean_ms"], rows["low"], rows["high"], **band)
        low, high = rows["accuracy"].min(), rows["accuracy"].max()
        risen = rows["accuracy"] >= low + RISEN * (high - low)
        latest_ms = max(latest_ms, float(rows.loc[risen, "mean_ms"].min()))
    ax.axhline(chance, color=GREY, lw=0.8, ls=":")
    ax.set(xlabel="Mean decision time (ms)", ylabel="Expected accuracy")
    # Later, accuracy hardly varies; below the hastiest decisions there is nothing.
    low, high = curves["accuracy"].min(), curves["accuracy"].max()
    ax.set_xlim(0, 1.1 * latest_ms)
    ax.set_ylim(low - 0.06 * (high - low), high + 0.06 * (high - low))
    ax.set_title("a  Speed and accuracy")
    _legend_below(ax, columns=2 if len(ax.get_legend_handles_labels()[0]) > 4 else 1)


def _times(ax: Axes, pairs: pd.DataFrame) -> None:
    """Draw the circuit's decision times over those of the test, a point per trial."""
    title = "b  Decision times"
    ax.set(xlabel="Test, decision time (ms)", ylabel="Circuit, decision time (ms)")
    if not len(pairs):
        ax.text(0.5, 0.5, "No accuracy is reached", transform=ax.transAxes, ha="center")
        ax.set(title=title, xticks=[], yticks=[])
        return
    accuracy = float(np.sort(pairs["accuracy"].unique())[0])
    here = pairs[pairs["accuracy"] == accuracy]
    x, y = here["test_ms"].to_numpy(), here["circuit_ms"].to_numpy()
    same = (here["test_choice"] == here["circuit_choice"]).to_numpy()
    top = float(max(x.max(), y.max()))
    if len(here) > MANY:
        ax.hexbin(x, y, gridsize=35, bins="log", cmap="Greys", mincnt=1, lw=0, rasterized=True)
        ax.plot(
            [], [], ls="", marker="h", color="0.5", label=f"Trials (n = {len(here)}), log scale"
        )
    else:
        label = f"Same choice (n = {same.sum()})"
        dots: Look = {"ls": "", "ms": 2.5, "mew": 0, "alpha": 0.5, "rasterized": len(here) > 500}
        ax.plot(x[same], y[same], marker="o", color=PALETTE[0], label=label, **dots)
    cross: Look = {"ls": "", "marker": "x", "ms": 4, "mew": 1, "color": PALETTE[1]}
    ax.plot(x[~same], y[~same], label=f"Other choice (n = {(~same).sum()})", **cross)
    ax.plot([0, top], [0, top], color="k", lw=0.8, label="Equal times")
    late = float(np.median(y - x))
    lag = f"Median lag, {late:.0f} ms"
    ax.plot([0, top], [late, top + late], color="k", lw=0.8, ls="--", label=lag)
    ax.set(xlim=(0, 1.04 * top), ylim=(0, 1.04 * top))
    ax.set_title(f"{title}, accuracy {accuracy:g}")
    _legend_below(ax)


def _same(ax: Axes, table: pd.DataFrame, pairs: pd.DataFrame) -> None:
    """Draw the share of trials with the same choice, at each accuracy, with the chance level."""
    of = table[(table["model"] == CIRCUIT) & (table["reference"] == table["reference"].iloc[0])]
    marks: dict[str, Look] = {
        "agreement": {"label": "Observed, 95 % interval", "fmt": "o", "color": PALETTE[1]},
        "agreement_chance": {"label": "Trials shuffled (chance)", "fmt": "s", "color": GREY},
    }
    accuracies = list(pairs["accuracy"].unique())
    for name, style in marks.items():
        rows = of[(of["measure"] == name) & of["accuracy"].isin(accuracies)]
        at = [accuracies.index(each) for each in rows["accuracy"]]
        ends = np.clip([rows["value"] - rows["low"], rows["high"] - rows["value"]], 0, None)
        ax.errorbar(at, rows["value"], np.nan_to_num(ends), ms=4, capsize=3, lw=1, **style)
    ax.set_xticks(range(len(accuracies)), [f"{each:g}" for each in accuracies])
    ax.set(xlabel="Accuracy", ylabel="Share of trials", ylim=(None, 1.02))
    ax.set_xlim(-0.5, max(1, len(accuracies)) - 0.5)
    ax.set_title("c  Same choice as the test")
    _legend_below(ax)


def _legend_below(ax: Axes, columns: int = 1) -> None:
    """Put the legend below the Axes, where it covers no data."""
    place: Look = {"loc": "upper left", "bbox_to_anchor": (-0.12, -0.24), "borderaxespad": 0}
    ax.legend(ncols=columns, columnspacing=1.0, handlelength=2.0, **place)
