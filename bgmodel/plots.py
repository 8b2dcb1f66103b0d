"""Plots: each draws a table on an Axes and returns the Axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pandas as pd

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Grating orientation thresholds at 75 % correct: groove width, mm (Van Boven & Johnson 1994).
HUMAN_GROOVE_MM = {"finger": 0.94, "lip": 0.51, "tongue": 0.58}


def new_axes(ax: Axes | None = None) -> Axes:
    """Return the given Axes, or those of a new figure.

    Raises
    ------
    ValueError
        If something other than Axes is given.
    ImportError
        If Matplotlib is not installed.
    """
    from circuits.plots import panels

    found: Axes = panels(1, ax)[0]
    return found


def output(ax: Axes, time_ms: npt.ArrayLike, out_nats: npt.NDArray[np.floating]) -> Axes:
    """Draw OUT (ticks, hypotheses) of a trial against the time from the onset of evidence."""
    for hypothesis, values in enumerate(out_nats.T):
        ax.plot(np.asarray(time_ms), values, label=f"hypothesis {hypothesis}")
    ax.axvline(0, color="0.8", lw=0.8, zorder=0)
    ax.set(xlabel="time from the onset of evidence (ms)", ylabel="OUT (nats)")
    ax.legend()
    return ax


def posteriors(
    time_ms: npt.ArrayLike,
    posterior: npt.NDArray[np.floating],
    truth: int | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw posteriors (readings, hypotheses) of a trial; the true hypothesis is the thick line."""
    ax = new_axes(ax)
    for hypothesis, values in enumerate(posterior.T):
        label = f"hypothesis {hypothesis}" + (" (true)" if hypothesis == truth else "")
        ax.step(time_ms, values, where="post", lw=2.5 if hypothesis == truth else 1, label=label)
    ax.set(xlabel="time from the onset of evidence (ms)", ylabel="posterior", ylim=(-0.02, 1.02))
    ax.legend(frameon=False)
    return ax


def choice_times(ax: Axes, choice: npt.ArrayLike, time_ms: npt.ArrayLike) -> Axes:
    """Draw a histogram of decision times (trials,), stacked by choice; below 0 is undecided."""
    chosen, times = np.asarray(choice), np.asarray(time_ms)
    found = np.unique(chosen[chosen >= 0])
    parts = [times[chosen == c] for c in found]
    if parts:
        ax.hist(parts, bins=30, stacked=True, label=[f"chose {c}" for c in found])
        ax.legend()
    left = int((chosen < 0).sum())
    ax.set(xlabel="decision time from the onset of evidence (ms)", ylabel="trials")
    ax.set_title(f"{left} of {len(chosen)} undecided" if left else "")
    return ax


def conditions(table: pd.DataFrame, ax: Axes | Sequence[Axes] | None = None) -> Any:
    """Draw measures of conditions with their intervals, one panel per measure.

    Parameters
    ----------
    table : DataFrame
        Columns condition, measure, value, low, high; measures without a value are left out.
    ax : Axes, one per measure, optional
        Axes to draw on; those of a new figure by default.

    Returns
    -------
    array of Axes
        One per measure.
    """
    from circuits.plots import panels

    known = table[table["value"].notna()]
    measures = list(known["measure"].unique())
    axes = panels(len(measures), ax, 0.8)
    names = list(table["condition"].unique())
    for panel, measure in zip(axes, measures, strict=True):
        rows = known[known["measure"] == measure]
        error = np.abs(rows[["low", "high"]].to_numpy().T - rows["value"].to_numpy())
        at = [names.index(name) for name in rows["condition"]]
        panel.errorbar(rows["value"], at, xerr=error, fmt="o", ms=4, capsize=3)
        panel.set_yticks(range(len(names)), names)
        panel.set(xlabel=measure, ylim=(len(names) - 0.5, -0.5))
    return axes


def wilson(
    correct: npt.ArrayLike, trials: npt.ArrayLike, z: float = 1.96
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return Wilson's interval of a proportion (low, high), 95 % by default."""
    n = np.asarray(trials, dtype=float)
    p = np.asarray(correct, dtype=float) / n
    centre = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2)) / (1 + z**2 / n)
    return centre - half, centre + half


def psychometric(
    ax: Axes,
    x: npt.ArrayLike,
    correct: npt.ArrayLike,
    trials: npt.ArrayLike,
    **line: Any,
) -> Axes:
    """Draw proportion correct with Wilson intervals against a stimulus scale."""
    p = np.asarray(correct) / np.asarray(trials)
    low, high = wilson(correct, trials)
    error = np.clip(np.stack([p - low, high - p]), 0, None)
    ax.errorbar(np.asarray(x), p, yerr=error, capsize=2, **line)
    return accuracy_axis(ax)


def accuracy_axis(ax: Axes, chance: float | None = 0.5) -> Axes:
    """Label the y axis as proportion correct and mark chance, if it is one number."""
    if chance is not None:
        ax.axhline(chance, color="0.8", lw=0.8, zorder=0)
    ax.set_ylabel("proportion correct")
    return ax


def human_thresholds(ax: Axes, level: float = 0.75) -> Axes:
    """Mark human grating-orientation thresholds on an axis of groove width, mm."""
    for marker, (site, groove) in zip("o^s", HUMAN_GROOVE_MM.items(), strict=True):
        ax.plot(groove, level, marker, color="0.3", mfc="w", ms=5, label=f"human {site}")
    return ax


def trajectories(
    ax: Axes,
    z: npt.NDArray[np.float64],
    steps: npt.NDArray[np.float64],
    delta: float,
    **line: Any,
) -> Axes:
    """Draw evidence Z (trials, 1 + t_max), each until its decision, with both bounds."""
    for path, stop in zip(z, steps.astype(int), strict=True):
        ax.plot(np.arange(stop + 1), path[: stop + 1], **line)
        ax.plot(stop, path[stop], "o", ms=2.5, color=line.get("color"))
    for bound in (-delta / 2, delta / 2):
        ax.axhline(bound, color="k", lw=0.8)
    ax.set(xlabel="readings", ylabel="evidence Z (nats)")
    return ax


def speed_accuracy(
    ax: Axes,
    mean_steps: npt.ArrayLike,
    accuracy: npt.ArrayLike,
    chance: float | None = 0.5,
    **line: Any,
) -> Axes:
    """Draw accuracy against mean decision time in readings."""
    ax.plot(np.asarray(mean_steps), np.asarray(accuracy), **line)
    ax.set_xlabel("mean decision time (readings)")
    return accuracy_axis(ax, chance)


def acquisition(ax: Axes, runs: pd.DataFrame, **line: Any) -> Axes:
    """Draw gaps (a row per run, a column per trial) over trials: median and 10-90 % of runs."""
    low, middle, high = np.percentile(runs.to_numpy(), [10, 50, 90], axis=0)
    ax.plot(runs.columns, middle, **line)
    ax.fill_between(runs.columns, low, high, color=line.get("color"), alpha=0.2, lw=0)
    ax.set(xlabel="trial", ylabel="gap δ (nats)")
    return ax


def reliability(ax: Axes, table: pd.DataFrame, **line: Any) -> Axes:
    """Draw observed frequency against stated posterior (columns stated, observed, count)."""
    ax.plot([0, 1], [0, 1], color="0.8", lw=0.8, zorder=0)
    low, high = wilson(table["observed"] * table["count"], table["count"])
    error = np.clip(np.stack([table["observed"] - low, high - table["observed"]]), 0, None)
    ax.errorbar(table["stated"], table["observed"], yerr=error, fmt="o", ms=3, **line)
    ax.set(xlabel="stated posterior", ylabel="observed frequency")
    return ax


def channel_lines(ax: Axes, table: pd.DataFrame, *, steps: bool = False, **line: Any) -> Axes:
    """Draw one line per channel over time (columns channel, time_ms, value), in colours C0, C1, ...

    With ``steps`` a value holds until the next.
    """
    for channel, rows in table.groupby("channel"):
        style = {"color": f"C{channel}", **line}
        how = "steps-post" if steps else "default"
        ax.plot(rows["time_ms"], rows["value"], drawstyle=how, **style)
    return ax


def raster(ax: Axes, spikes: pd.DataFrame, *, channels: int, neurons: int, **dots: Any) -> Axes:
    """Draw the spikes of the first neurons of each channel, one row per neuron, channel 0 on top.

    Parameters
    ----------
    ax : Axes
        Dots are rasterized: many of them make a vector file large.
    spikes : DataFrame
        One row per spike: channel, neuron and time_ms.
    channels, neurons : int
        Number of channels, and of neurons shown of each.
    """
    shown = spikes[spikes["neuron"] < neurons]
    for channel in range(channels):
        rows = shown[shown["channel"] == channel]
        style = {"color": f"C{channel}", "marker": "s", "ms": 0.7, "mew": 0, "ls": "", **dots}
        ax.plot(rows["time_ms"], channel * neurons + rows["neuron"], rasterized=True, **style)
    ax.set(ylim=(channels * neurons - 0.5, -0.5), yticks=[])
    return ax
