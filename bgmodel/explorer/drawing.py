"""The explorer's figures as SVG, narrow enough for a phone; a saved one is the one on the page."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

# Imported before threads draw: its import changes the warning filters of all threads for a moment,
# which could swallow a warning of another thread.
import matplotlib as mpl
import matplotlib.style
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bgmodel.explorer.circuit import WITHOUT_EVIDENCE, Shown
from bgmodel.plots import BINS, CORRECT, ERROR
from circuits.arrays import Array
from circuits.checks import place_of
from circuits.circuit import Circuit
from circuits.declaration.courses import DOPAMINE, Course
from circuits.drawing import draw
from circuits.plots import EDITABLE, FROM_ONSET, GREY, PALETTE, ROWS, STYLE, Look, look, smoothed

WIDE, OF_CIRCUIT = 4.0, 4.6
"""Width of figures, and of the drawing of the circuit, inches."""
LEFT, RIGHT = 0.15, 0.97
"""Edges of the axes, as fractions of the width."""
LANE = 0.84
"""Height of a nucleus in the drawing of a trial, as a fraction of the distance between nuclei."""
OF_OUT, OF_AXIS = 1.9, 0.55
"""Heights of OUT in that drawing, and of the title and the axis of its other rows, inches."""
FEW = 3
"""Largest number of alternatives with full names in a legend."""
SMOOTH_MS = 15.0
"""Standard deviation of the kernel that smooths rates, ms."""
POINTS: dict[str, Look] = {
    "Control": {"color": "k", "marker": "o", "mfc": "w"},
    "Manipulation": {"color": PALETTE[0], "marker": "s"},
}
"""Markers of both conditions."""
WINDOW: Look = {"color": GREY, "alpha": 0.25, "lw": 0, "zorder": 0}
"""Shading of the time in which a course acts."""
TEXT: Any = {"text.parse_math": False, **STYLE, **EDITABLE}
"""Style in which names of files and nuclei are text, not mathematics."""


def svg(figure: Figure) -> str:
    """Return a figure as SVG, the same text for the same figure."""
    out = io.StringIO()
    with mpl.rc_context(TEXT):
        figure.savefig(out, format="svg", dpi=150, metadata={"Date": None})
    text = out.getvalue()
    return text[text.index("<svg") :]


def _figure(high: float, wide: float = WIDE) -> Figure:
    """Return an empty figure that pyplot does not keep."""
    return Figure(figsize=(wide, high), dpi=96)


def times(trials: pd.DataFrame, *, edited: bool) -> str:
    """Draw the distributions of decision times, errors below correct responses, as SVG."""
    with mpl.rc_context(TEXT):
        figure, decided = _figure(2.7), trials[~trials["undecided"] & trials["correct"].notna()]
        ax = figure.add_axes((LEFT, 0.17, RIGHT - LEFT, 0.66))
        rt_ms = 1000 * decided["rt"].to_numpy() if len(decided) else np.array([0.0, 1000.0])
        edges = np.linspace(rt_ms.min(), np.quantile(rt_ms, 0.995) + 1, BINS + 1)
        for name in ("manipulation", "control") if edited else ("control",):
            rows = decided[decided["condition"] == name]
            _both_sides(ax, rows, edges, filled=name == "manipulation" or not edited)
        ax.axhline(0, color="k", lw=0.8)
        ax.set(xlabel=FROM_ONSET.replace("Time", "Decision time"), ylabel="Trials")
        ax.set_xlim(edges[0], edges[-1])
        ax.yaxis.set_major_formatter(lambda value, _: f"{abs(value):g}")
        ax.locator_params(axis="y", integer=True)
        ax.locator_params(axis="x", nbins=6)
        _legend(ax, 2)
        return svg(figure)


def _both_sides(ax: Axes, rows: pd.DataFrame, edges: Array, *, filled: bool) -> None:
    """Draw the histogram of correct responses above the axis, and that of errors below."""
    for correct, side in ((True, 1), (False, -1)):
        rt_ms = 1000 * rows.loc[(rows["correct"] == 1) == correct, "rt"].to_numpy()
        counts = side * np.histogram(rt_ms, edges)[0]
        label = f"{'correct' if correct else 'errors'} (n = {len(rt_ms)})"
        if filled:
            colour = CORRECT if correct else ERROR
            ax.stairs(counts, edges, fill=True, color=colour, label=label.capitalize())
        else:
            style = "-" if correct else "--"
            ax.stairs(counts, edges, color="k", lw=1.1, ls=style, label=f"Control, {label}")


def tradeoff(points: Mapping[str, pd.DataFrame], test: pd.DataFrame, chance: float) -> str:
    """Draw accuracy against mean time with the curve of the MSPRT on the same evidence, as SVG.

    Points have rows ``mean_ms`` and ``accuracy``, and columns value, low and high.
    """
    with mpl.rc_context(TEXT):
        figure = _figure(2.7)
        ax = figure.add_axes((LEFT, 0.17, RIGHT - LEFT, 0.68))
        ax.axhline(chance, color=GREY, lw=0.8, ls=":", label="Chance")
        ax.plot(test["mean_ms"], test["accuracy"], color=GREY, lw=1.6, label="Optimal test (MSPRT)")
        ends = np.array([rows.loc[["mean_ms", "accuracy"]] for rows in points.values()], np.float64)
        for (name, style), (x, y) in zip(POINTS.items(), ends, strict=False):
            bars = [np.nan_to_num([[v - low], [high - v]]) for v, low, high in (x, y)]
            ax.errorbar(
                x[0], y[0], bars[1], bars[0],
                ls="", ms=6, capsize=2, elinewidth=1.0, label=name, zorder=4, **style,
            )  # fmt: skip
        latest = ends[:, 0, 2].max()
        if np.isfinite(latest) and latest > 0:
            ax.set_xlim(0, 1.6 * latest)
        ax.set(xlabel="Mean decision time (ms)", ylabel="Proportion correct")
        ax.set_ylim(float(np.nanmin([chance, ends[:, 1, 1].min()])) - 0.08, 1.02)
        _legend(ax, 4)
        return svg(figure)


def trial(trials: Mapping[str, Shown]) -> str:
    """Draw one trial as SVG: OUT, -ln P and the threshold; spikes and rates of every nucleus."""
    with mpl.rc_context(TEXT):
        order = list(trials.items())[::-1]
        lane = 0.5 if len(order) == 1 else 0.42
        high = OF_OUT + sum(OF_AXIS + lane * len(one.rates_hz) for _, one in order)
        figure, bottom = _figure(high), high - OF_OUT
        ends = min(one.start_ms for _, one in order), max(one.end_ms for _, one in order)
        ax = figure.add_axes((LEFT, 1 - 1.62 / high, RIGHT - LEFT, 1.22 / high))
        _out(ax, order[0][1])
        ax.set_xlim(*ends)
        rates = [_smoothed(one) for _, one in order]
        wide = (RIGHT - LEFT - 0.11) / 2
        for (name, one), smooth in zip(order, rates, strict=True):
            tall = lane * len(one.rates_hz)
            bottom -= OF_AXIS + tall
            # All nuclei share two axes: two for each would be slow to draw.
            both = [
                figure.add_axes((left, (bottom + 0.42) / high, wide, tall / high))
                for left in (LEFT, RIGHT - wide)
            ]
            _spikes(both[0], one)
            _rates(both[1], one, smooth, rates)
            for ax, title in zip(both, ("Spikes", "Rate (Hz)"), strict=True):
                ax.set_title(f"{name}: {title[0].lower()}{title[1:]}" if len(order) > 1 else title)
                ax.set(xlim=ends, ylim=(len(one.rates_hz) - 1 + LANE, -0.02))
                ax.locator_params(axis="x", nbins=4)
                _events(ax, one)
        for ax in both:
            ax.set_xlabel("Time (ms)")
        return svg(figure)


def _events(ax: Axes, shown: Shown) -> None:
    """Mark the decision, and each course in the lane of its nucleus; of dopamine, in all lanes."""
    if np.isfinite(shown.decided_ms):
        ax.axvline(shown.decided_ms, color="k", lw=0.9)
    for row in shown.courses:
        for lane, name in enumerate(shown.rates_hz):
            if row.what == DOPAMINE or place_of(row.what)[0] == name:
                ax.broken_barh([_window(row, shown)], (lane, LANE), **WINDOW)


def _window(row: Course, shown: Shown) -> tuple[float, float]:
    """Return the start of a course and its length until the end of the trial, ms."""
    return row.from_ms, min(row.to_ms, shown.end_ms) - row.from_ms


def _smoothed(shown: Shown) -> dict[str, Array]:
    """Return smooth rates (ticks, channels) by nucleus."""
    time_ms = shown.time_ms
    apart_ms = float(np.median(np.diff(time_ms))) if len(time_ms) > 1 else 1.0
    return {
        name: smoothed(hz, apart_ms, SMOOTH_MS) if len(hz) > 2 else np.asarray(hz, np.float64)
        for name, hz in shown.rates_hz.items()
    }


def _out(ax: Axes, shown: Shown) -> None:
    """Draw OUT of each channel, -ln P of the evidence, the threshold and the decision."""
    count = shown.out.shape[1]
    name = "Alternative " if count <= FEW else "Alt. " if count <= 2 * FEW else ""
    for channel in range(count):
        style = look(channel)
        ax.plot(shown.time_ms, shown.out[:, channel], **style, label=f"{name}{channel}")
        if shown.test is not None:
            test_ms, ideal = shown.test
            ax.plot(test_ms, ideal[:, channel], color=style["color"], lw=0.9, ls=":")
    if shown.test is not None:
        ax.plot([], [], color="k", lw=0.9, ls=":", label="−ln P (MSPRT)")
    ax.axhline(shown.threshold, color=GREY, lw=0.9, ls="--", label="Threshold")
    if np.isfinite(shown.decided_ms):
        ax.axvline(shown.decided_ms, color="k", lw=0.9, label="Decision")
    for k, row in enumerate(shown.courses):
        ax.broken_barh(
            [_window(row, shown)], (0, 1), transform=ax.get_xaxis_transform(),
            label="Course" if k == 0 else None, **WINDOW,
        )  # fmt: skip
    ax.set_ylabel(f"OUT ({shown.unit})")
    ax.tick_params(labelbottom=False)
    if shown.unit == "nats":
        ax.set_ylim(bottom=0)
    _legend(ax, max(3, count // 2 + 2))  # two rows


def _spikes(ax: Axes, shown: Shown) -> None:
    """Draw the spikes of every nucleus, one lane each, with the cells of channel 0 on top."""
    labels: dict[float, str] = {}
    for lane, (name, rates) in enumerate(shown.rates_hz.items()):
        channels, spikes = rates.shape[1], shown.spikes.get(name)
        if spikes is None:
            labels[lane + LANE / 2] = "rates, no spikes"
        if name in shown.lost:
            labels[lane + LANE / 2] = shown.lost[name]
        cells = max(2, ROWS // channels)
        for channel in range(channels):
            if spikes is None:
                continue
            rows = spikes[(spikes["channel"] == channel) & (spikes["neuron"] < cells)]
            y = lane + LANE * (channel * cells + rows["neuron"] + 0.5) / (channels * cells)
            dots: Look = {**_look(channel, channels), "marker": "s", "ms": 1.1, "mew": 0, "ls": ""}
            ax.plot(rows["time_ms"], y, rasterized=True, **dots)
    names = list(shown.rates_hz)
    if shown.premature:
        labels = {len(names) / 2: WITHOUT_EVIDENCE.replace(" ", "\n")}
    for y, text in labels.items():
        ax.text(0.5, y, text, transform=ax.get_yaxis_transform(), ha="center", color=GREY,
                bbox={"fc": "w", "ec": "none", "pad": 1})  # fmt: skip
    ax.set_yticks(np.arange(len(names)) + LANE / 2, names)
    ax.tick_params(axis="y", length=0)


def _rates(
    ax: Axes, shown: Shown, rates: Mapping[str, Array], every: Sequence[Mapping[str, Array]]
) -> None:
    """Draw the rates of every nucleus, one lane each, from 0 to the highest in any condition."""
    ticks: dict[float, float] = {}
    for lane, (name, hz) in enumerate(rates.items()):
        highest = [np.nanmax(one[name], initial=0.0) for one in every if name in one]
        top, bottom = max(1e-3, *map(float, highest)), lane + LANE
        for channel in range(hz.shape[1]):
            y = bottom - LANE * hz[:, channel] / top
            ax.plot(shown.time_ms, y, **_look(channel, hz.shape[1]))
        step = 10.0 ** np.floor(np.log10(top))  # a tick at the leading digit
        ticks |= {bottom: 0.0, bottom - LANE * step * (top // step) / top: step * (top // step)}
        ax.axhline(bottom, color=GREY, lw=0.6)
    ax.set_yticks([*ticks], [f"{tick:g}" for tick in ticks.values()], fontsize=6.0)


def _look(channel: int, channels: int) -> Look:
    """Return the look of a channel; nuclei that all alternatives share are grey."""
    return look(channel) if channels > 1 else {"color": GREY}


def _legend(ax: Axes, columns: int) -> None:
    """Put the legend above the axes."""
    ax.legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns, borderaxespad=0.1,
        handlelength=1.5 if columns < 6 else 1.1, columnspacing=0.9, fontsize=7.0,
    )  # fmt: skip


def circuit(edited: Circuit, control: Circuit) -> str:
    """Draw the edited circuit as SVG; rows that differ from the control have a star.

    The ``id`` of a group is the name of its row, by which the page identifies a click.
    """
    with mpl.rc_context(TEXT):
        figure = _figure(4.2, OF_CIRCUIT)
        draw(edited, figure.add_axes((0.0, 0.12, 1.0, 0.88)), control)
        return svg(figure)
