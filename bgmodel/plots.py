"""Plots of decisions and evidence: those of results, and parts that figures share.

Functions that take Axes draw on them and return them; the others return a ``Figure``, which is what
every ``plot`` method returns.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from circuits.plots import (
    FROM_ONSET,
    GREY,
    PALETTE,
    Look,
    legend_above,
    look,
    mark_onset,
    one_panel,
    styled,
    titled,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CORRECT, ERROR = PALETTE[0], PALETTE[1]
Tops = dict[int, npt.NDArray[np.float64]]
"""Heights of the bins above (1) and below (-1) the axis."""
BINS = 30
"""Number of bins of a histogram of times."""
LABELS = {
    "accuracy": "Accuracy",
    "choice_0": "Choice of alternative 0",
    "mean_ms": "Mean decision time",
    "median_ms": "Median decision time",
    "accuracy_all": "Accuracy, missed as errors",
    "accuracy_best": "Accuracy, missed as correct",
    "mean_all_ms": "Mean time of all trials",
    "premature": "Premature responses",
    "anticipatory": "Anticipatory responses",
    "missed": "Missed trials",
    "decided": "Decided trials",
    "mean_posterior": "Mean posterior",
    "drift": "Drift",
    "boundary_separation": "Boundary separation",
    "non_decision_ms": "Non-decision time",
    "p_respond": "Responses on stop trials",
    "ssrt_ms": "Stop-signal reaction time",
    "failed_minus_go_ms": "Failed stops minus go time",
}
"""Measures of ``deciding.measures`` as a figure names them."""
UNITS = {"decided": "trials", "drift": "1/s"}


def labelled(measure: str) -> str:
    """Return a measure as the label of an axis, with its unit."""
    unit = "ms" if measure.endswith("_ms") else UNITS.get(measure, "")
    return LABELS.get(measure, measure) + (f" ({unit})" if unit else "")


@styled
def output(
    time_ms: npt.ArrayLike, out_nats: npt.NDArray[np.floating], ax: Axes | None = None
) -> Figure:
    """Draw OUT (ticks, hypotheses) of a trial against the time from the onset of evidence."""
    on_axes, (figure, ax) = ax is not None, one_panel(ax)
    for hypothesis, values in enumerate(out_nats.T):
        ax.plot(np.asarray(time_ms), values, label=f"Hypothesis {hypothesis}", **look(hypothesis))
    mark_onset(ax)
    ax.set(xlabel=FROM_ONSET, ylabel="OUT (nats)")
    legend_above(ax, on_axes=on_axes)
    return figure


@styled
def posteriors(
    time_ms: npt.ArrayLike,
    posterior: npt.NDArray[np.floating],
    truth: int | None = None,
    ax: Axes | None = None,
) -> Figure:
    """Draw posteriors (readings, hypotheses) of a trial; the true hypothesis is the thick line."""
    on_axes, (figure, ax) = ax is not None, one_panel(ax)
    for hypothesis, values in enumerate(posterior.T):
        label = f"Hypothesis {hypothesis}" + (" (true)" if hypothesis == truth else "")
        width = 2.5 if hypothesis == truth else 1.0
        ax.step(time_ms, values, where="post", lw=width, label=label, **look(hypothesis))
    ax.set(xlabel=FROM_ONSET, ylabel="Posterior probability", ylim=(-0.02, 1.02))
    legend_above(ax, on_axes=on_axes)
    return figure


@styled
def choice_times(
    choice: npt.ArrayLike,
    time_ms: npt.ArrayLike,
    forced: npt.ArrayLike,
    truth: npt.ArrayLike | None = None,
    ax: Axes | None = None,
) -> Figure:
    """Draw histograms of decision times: errors below correct responses, or one per choice.

    Choices below 0 are undecided. Without a truth there is one histogram per choice, stacked.
    Hatched parts are trials that the deadline decided. The title has the proportion correct of
    decided trials with Wilson's 95 % interval, and the numbers of trials.
    """
    on_axes, (figure, ax) = ax is not None, one_panel(ax)
    chosen, times, late = np.asarray(choice), np.asarray(time_ms), np.asarray(forced, dtype=bool)
    decided = chosen >= 0
    ax.set(xlabel=FROM_ONSET.replace("Time", "Decision time"), ylabel="Trials")
    facts = [f"n = {len(chosen)}"]
    if truth is None:
        groups = [
            (f"Chose {c}", chosen == c, look(int(c))["color"], 1)
            for c in np.unique(chosen[decided])
        ]
    else:
        right = decided & (chosen == np.asarray(truth))
        groups = [
            ("Correct", right, CORRECT, 1),
            ("Error", decided & ~right, ERROR, -1),
        ]
        if decided.any():
            low, high = (float(end) for end in wilson(right.sum(), decided.sum()))
            share = right.sum() / decided.sum()
            facts.insert(0, f"Accuracy {share:.3f} [{low:.3f}, {high:.3f}]")
    if not decided.all():
        facts.append(f"{int((~decided).sum())} undecided")
    if not decided.any():
        titled(ax, ", ".join(facts), on_axes=on_axes)
        ax.text(0.5, 0.5, "No trial was decided", transform=ax.transAxes, ha="center", color=GREY)
        ax.set(xticks=[], yticks=[])
        return figure
    edges = _edges(times[decided])
    late &= decided
    tops: Tops = {1: np.zeros(len(edges) - 1), -1: np.zeros(len(edges) - 1)}
    bars: Look = {"x": edges[:-1], "width": np.diff(edges), "align": "edge", "lw": 0.5}
    for label, some, colour, side in groups:
        counts = side * np.histogram(times[some & ~late], edges)[0]
        named = f"{label} (n = {int(some.sum())})"
        ax.bar(height=counts, bottom=tops[side], color=colour, label=named, **bars)
        tops[side] = tops[side] + counts
    highest = max(np.abs(top).max() for top in tops.values())
    for _, some, colour, side in groups:
        counts = side * np.histogram(times[some & late], edges)[0]
        ax.bar(height=counts, bottom=tops[side], fc="w", ec=colour, hatch="/////", **bars)
        tops[side] = tops[side] + counts
    if late.any():
        named = f"At the deadline (n = {int(late.sum())})"
        ax.bar(edges[0], 0, fc="w", ec=GREY, hatch="/////", label=named)
    _limit(ax, edges, tops, highest, {side for *_, side in groups})
    ax.axhline(0, color="k", lw=0.8)
    ax.yaxis.set_major_formatter(lambda value, _: f"{abs(value):g}")
    ax.locator_params(axis="y", integer=True)
    legend_above(ax, title=", ".join(facts), on_axes=on_axes)
    return figure


def _edges(times_ms: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
    """Return edges of bins; of times on a grid, as readings are, they lie between its places."""
    values = np.unique(times_ms)
    step = np.diff(values).min(initial=np.inf)
    places = (values - values[0]) / step
    if len(values) < 2 or np.abs(places - places.round()).max() > 1e-6:
        return np.histogram_bin_edges(times_ms, BINS)
    each = np.ceil((places[-1] + 1) / BINS)
    count = np.ceil((places[-1] + 1) / each)
    return np.asarray(values[0] + step * (each * np.arange(count + 1) - 0.5))


def _limit(
    ax: Axes,
    edges: npt.NDArray[np.floating],
    tops: Tops,
    highest: float,
    sides: set[int],
) -> None:
    """Set the limits by decisions before the deadline; write the number on a bar that is cut off.

    ``tops`` holds heights of all trials, (bins,), by side, 1 above and -1 below; ``highest`` is the
    largest height without trials that the deadline decided.
    """
    limits = [0.0, 0.0]
    for side in sides:
        most = np.abs(tops[side]).max()
        limit = min(most, 1.5 * highest) if highest else most
        limits[(side + 1) // 2] = side * 1.05 * limit
        for k in np.flatnonzero(np.abs(tops[side]) > 1.05 * limit):
            height = f"{abs(tops[side][k]):.0f} "
            vertical = "top" if side > 0 else "bottom"
            ax.text(edges[k], side * limit, height, ha="right", va=vertical, fontsize=7)
    ax.set_ylim(*limits)


@styled
def tradeoff(
    mean_ms: npt.ArrayLike,
    correct: npt.ArrayLike,
    decided: npt.ArrayLike,
    ax: Axes | None = None,
) -> Figure:
    """Draw accuracy against mean decision time, a point per threshold, with Wilson intervals."""
    on_axes, (figure, ax) = ax is not None, one_panel(ax)
    order = np.argsort(mean_ms)
    x, k, n = (np.asarray(values, dtype=float)[order] for values in (mean_ms, correct, decided))
    low, high = wilson(k, n)
    ends = np.clip(np.stack([k / n - low, high - k / n]), 0, None)
    ax.errorbar(x, k / n, ends, fmt="o-", ms=3, capsize=2, elinewidth=0.8, color=PALETTE[0])
    ax.set(xlabel="Mean decision time (ms)", ylabel="Proportion correct")
    if len(n):
        least, most = int(n.min()), int(n.max())
        many = f"{most}" if least == most else f"{least} to {most}"
        note = f"{many} decided trials per threshold; bars: 95 % intervals"
        titled(ax, note, on_axes=on_axes)
    return figure


def wilson(
    correct: npt.ArrayLike, trials: npt.ArrayLike, z: float = 1.96
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return Wilson's interval of a proportion (low, high), 95 % by default."""
    n = np.asarray(trials, dtype=float)
    p = np.asarray(correct, dtype=float) / n
    centre = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2)) / (1 + z**2 / n)
    return np.clip(centre - half, 0, 1), np.clip(centre + half, 0, 1)


@styled
def learned_ratios(exact: npt.ArrayLike, learned: npt.ArrayLike, ax: Axes | None = None) -> Figure:
    """Draw learned against exact log-likelihoods of single readings, (readings,) each, nats.

    The dashed line is equality: weights are calibrated if the points lie along it.
    """
    on_axes, (figure, ax) = ax is not None, one_panel(ax)
    known, estimated = np.ravel(exact), np.ravel(learned)
    ax.plot(known, estimated, ".", ms=3, alpha=0.5, color=PALETTE[0])
    ends = [float(known.min()), float(known.max())]
    ax.plot(ends, ends, "--", color=GREY, lw=1, label="Equal")
    ax.set(xlabel="Exact log-likelihood (nats)", ylabel="Learned (nats)")
    legend_above(ax, on_axes=on_axes)
    return figure


def accuracy_axis(ax: Axes, chance: float | None = 0.5) -> Axes:
    """Label the y axis as proportion correct and mark chance, if it is one number."""
    if chance is not None:
        ax.axhline(chance, color="0.8", lw=0.8, zorder=0)
    ax.set_ylabel("proportion correct")
    return ax


def acquisition(ax: Axes, runs: pd.DataFrame, **line: Any) -> Axes:
    """Draw gaps (a row per run, a column per trial) over trials: median and 10-90 % of runs."""
    low, middle, high = np.percentile(runs.to_numpy(), [10, 50, 90], axis=0)
    ax.plot(runs.columns, middle, **line)
    ax.fill_between(runs.columns, low, high, color=line.get("color"), alpha=0.2, lw=0)
    ax.set(xlabel="trial", ylabel="boundary separation δ (nats)")
    return ax
