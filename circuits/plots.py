"""Style and parts shared by all plots, and the plot of a circuit's activity.

Every ``plot`` method returns a Matplotlib ``Figure``. Colours are those of Okabe & Ito (2008),
which people with a colour vision deficiency can tell apart.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import wraps
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array
from circuits.errors import require

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
Look = dict[str, Any]
"""Options of something drawn."""

PALETTE = (
    *("#0072B2", "#D55E00", "#009E73", "#CC79A7"),
    *("#E69F00", "#56B4E9", "#000000", "#999999"),
)
"""Colours of channels, conditions and models."""
GREY = "0.45"
"""Colour of marks that are not data: onset, thresholds, chance."""
STYLE: Any = {
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.titlelocation": "left",
    "axes.labelsize": 8.0,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "legend.fontsize": 7.0,
    "legend.frameon": False,
    "figure.titlesize": 8.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "lines.linewidth": 1.2,
    "figure.dpi": 120.0,
}
EDITABLE: Any = {"pdf.fonttype": 42, "svg.fonttype": "none", "svg.hashsalt": "bgmodel"}
"""Settings with which text in a vector file stays text."""
FROM_ONSET = "Time from the onset of evidence (ms)"
ROWS = 48
"""Largest number of cells per nucleus in a raster, over all channels."""


def styled(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Draw in the common style, whatever the user's settings are."""

    @wraps(function)
    def inner(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        try:
            import matplotlib
            import matplotlib.pyplot as plt
        except ImportError as error:
            raise ImportError("a plot needs Matplotlib: pip install matplotlib") from error
        with plt.rc_context(STYLE):
            result = function(*args, **kwargs)
            interactive = plt.isinteractive()
        # A notebook's backend turns interactive mode on with its first figure. Leaving the context
        # turned it off again, and later figures would not be shown.
        matplotlib.interactive(interactive)
        return result

    return inner


def panels(
    rows: int, columns: int = 1, *, size: tuple[float, float], **options: Any
) -> tuple[Figure, Any]:
    """Return a new figure of a size in inches, and its Axes (rows, columns)."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(
        rows, columns, figsize=size, squeeze=False, layout="constrained", **options
    )
    for ax in axes.flat:
        # Ticks are made only when they are drawn, with the settings of that time.
        ax.tick_params(labelsize=STYLE["xtick.labelsize"])
    return figure, axes


def one_panel(
    ax: Axes | None = None, size: tuple[float, float] = (4.8, 3.0)
) -> tuple[Figure, Axes]:
    """Return the given Axes and their figure, or those of a new figure."""
    from matplotlib.axes import Axes

    if ax is None:
        figure, axes = panels(1, size=size)
        return figure, axes[0, 0]
    require(isinstance(ax, Axes), "ax", "must be Matplotlib Axes, as from plt.subplots()", ax)
    root: Any = ax.get_figure(root=True)
    return root, ax


def saved(figure: Figure, path: Any, **options: Any) -> None:
    """Write a figure to a file, 200 dots per inch if it consists of pixels; text stays text."""
    import matplotlib.pyplot as plt

    with plt.rc_context(EDITABLE):
        figure.savefig(path, dpi=200, **options)
    plt.close(figure)


def look(channel: int) -> Look:
    """Return the colour and the line style of a channel, the same in every plot."""
    styles = ("-", "--", ":")
    return {
        "color": PALETTE[channel % len(PALETTE)],
        "ls": styles[channel // len(PALETTE) % len(styles)],
    }


def legend_above(
    ax: Axes, columns: int = 3, title: str = "", *, on_axes: bool = False, **options: Any
) -> None:
    """Put the legend of Axes above them, where it covers no data, and a title above both.

    With ``on_axes`` (the user's own Axes) the space above is for one title: the legend is inside.
    """
    if on_axes:
        ax.legend(loc="best", handlelength=1.4, **options)
        titled(ax, title, on_axes=True)
        return
    handles, labels = ax.get_legend_handles_labels()
    columns = min(columns, max(1, len(labels)))
    ax.legend(
        handles,
        labels,
        loc="lower left",
        bbox_to_anchor=(0, 1.0),
        borderaxespad=0.2,
        ncols=columns,
        columnspacing=1.0,
        handlelength=1.4,
        **options,
    )
    if title:
        rows = -(-len(labels) // columns)
        ax.set_title(title, pad=6 + 11 * rows)


def titled(ax: Axes, title: str, *, on_axes: bool) -> None:
    """Give Axes a title; with ``on_axes`` (the user's own Axes), only if they have none."""
    if not on_axes:
        ax.set_title(title)
    elif not ax.get_title():
        ax.set_title(title, loc="center")


def mark_onset(ax: Axes, **options: Any) -> None:
    """Mark the onset of evidence, time 0, by a thin line."""
    ax.axvline(0, color=GREY, lw=0.8, zorder=0, **options)


def channel_lines(ax: Axes, table: pd.DataFrame, *, steps: bool = False, **line: Any) -> Axes:
    """Draw one line per channel over time (columns channel, time_ms, value), each in its colour.

    With ``steps`` a value holds until the next.
    """
    for channel in sorted(table["channel"].unique()):
        rows = table[table["channel"] == channel]
        style = {**look(int(channel)), **line}
        how = "steps-post" if steps else "default"
        ax.plot(rows["time_ms"], rows["value"], drawstyle=how, **style)
    return ax


def raster(ax: Axes, spikes: pd.DataFrame, *, channels: int, neurons: int, **dots: Any) -> Axes:
    """Draw the spikes of the first neurons of each channel, one row per neuron, channel 0 on top.

    ``spikes`` has channel, neuron and time_ms. Dots, whose style is ``dots``, are rasterized,
    because many of them make a vector file large.
    """
    shown = spikes[spikes["neuron"] < neurons]
    for channel in range(channels):
        rows = shown[shown["channel"] == channel]
        colour = look(channel)["color"] if channels > 1 else GREY
        style: Look = {"color": colour, "marker": "s", "ms": 0.7, "mew": 0, "ls": "", **dots}
        ax.plot(rows["time_ms"], channel * neurons + rows["neuron"], rasterized=True, **style)
    ax.set(ylim=(channels * neurons - 0.5, -0.5), yticks=[])
    return ax


def smoothed(values: npt.NDArray[np.floating], apart_ms: float, sd_ms: float) -> Array:
    """Return time courses (ticks, channels) after a Gaussian kernel; NaN stays NaN.

    The kernel is cut off where the data end, so that the ends are not pulled towards 0.
    """
    # Importing scipy takes a while, so it is done only here.
    from scipy.ndimage import gaussian_filter1d

    known = np.isfinite(values)
    weights = known.astype(np.float64)
    parts = (np.where(known, values, 0.0).astype(np.float64), weights)
    kernel = {"sigma": sd_ms / apart_ms, "axis": 0, "mode": "constant"}
    total, weight = (gaussian_filter1d(part, **kernel) for part in parts)
    return np.where(known, total / np.where(weight > 0, weight, 1.0), np.nan)


@styled
def activity(
    time_ms: Array,
    rates_hz: Mapping[str, npt.NDArray[np.floating]],
    output: npt.NDArray[np.floating],
    *,
    unit: str = "nats",
    spikes: Mapping[str, pd.DataFrame] | None = None,
    threshold: float | None = None,
    smooth_ms: float = 20.0,
) -> Figure:
    """Draw one trial as ``Activity.plot``: rates and OUT (ticks, channels), and its spikes."""
    columns = 2 if spikes else 1
    count = len(rates_hz) + 1
    figure, axes = panels(
        count,
        columns,
        size=(4.8 if columns == 1 else 7.2, 0.62 * count + 0.9),
        sharex=True,
        height_ratios=[1.0] * len(rates_hz) + [1.5],
    )
    apart_ms = float(np.median(np.diff(time_ms))) if len(time_ms) > 1 else 0.0
    smooth = bool(len(time_ms) > 2 and smooth_ms > apart_ms)
    for row, (name, values) in zip(axes, rates_hz.items(), strict=False):
        shown = smoothed(values, apart_ms, smooth_ms) if smooth else values
        _lines(row[-1], time_ms, shown)
        row[-1].set_ylim(bottom=0)
        row[-1].locator_params(axis="y", nbins=3)
        row[0].set_ylabel(name, rotation=0, ha="right", va="center", labelpad=8)
        if spikes:
            _spikes(row[0], spikes.get(name), values.shape[1])
    below = axes[-1, -1]
    _lines(below, time_ms, output)
    below.set_ylabel(f"OUT\n({unit})", rotation=0, ha="right", va="center", labelpad=8)
    below.set_xlabel(FROM_ONSET)
    if len(time_ms) > 1:
        below.set_xlim(time_ms[0], time_ms[-1])
    if spikes:
        axes[-1, 0].set_axis_off()
        axes[-2, 0].set_xlabel(FROM_ONSET)
        axes[-2, 0].tick_params(labelbottom=True)
        axes[0, 0].set_title(f"Spikes of up to {ROWS} cells, channel 0 on top")
    kernel = f", smoothed (Gaussian kernel, s.d. {smooth_ms:g} ms)" if smooth else ""
    axes[0, -1].set_title(f"Rate (Hz){kernel}")
    channels = output.shape[1]
    handles = [_line(f"Channel {k}", **look(k)) for k in range(channels)]
    if channels > 1 and any(values.shape[1] == 1 for values in rates_hz.values()):
        handles.append(_line("Pooled nucleus", color=GREY))
    handles += _marks([ax for ax in axes.flat if ax.axison], time_ms, output, threshold, below)
    figure.legend(handles=handles, loc="outside lower center", ncols=2 + columns)
    return figure


def _spikes(ax: Axes, spikes: pd.DataFrame | None, channels: int) -> None:
    if spikes is not None:
        raster(ax, spikes, channels=channels, neurons=max(2, ROWS // channels), ms=1.0)
        return
    ax.set(yticks=[])
    style: Look = {"ha": "center", "va": "center", "color": GREY, "fontsize": 7}
    ax.text(0.5, 0.5, "No spikes recorded", transform=ax.transAxes, **style)


def _marks(
    axes: list[Axes],
    time_ms: Array,
    output: npt.NDArray[np.floating],
    threshold: float | None,
    below: Axes,
) -> list[Any]:
    """Mark onset, threshold and first crossing; return their entries of a legend."""
    handles = []
    if time_ms[0] < 0:
        for ax in axes:
            mark_onset(ax)
        handles.append(_line("Onset of evidence", color=GREY, lw=0.8))
    if threshold is None:
        return handles
    below.axhline(threshold, color=GREY, lw=0.8, ls="--")
    handles.append(_line(f"Threshold, {threshold:.2g}", color=GREY, lw=0.8, ls="--"))
    at = np.flatnonzero((time_ms > 0) & (output <= threshold).any(axis=1))
    label = f"First crossing, {time_ms[at[0]]:.0f} ms" if len(at) else "Never crossed"
    for ax in axes if len(at) else []:
        ax.axvline(time_ms[at[0]], color="k", lw=0.9, ls=":", zorder=3)
    handles.append(_line(label, color="k", lw=0.9, ls=":"))
    return handles


def _line(label: str, **style: Any) -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], label=label, **style)


def _lines(ax: Axes, time_ms: Array, values: npt.NDArray[np.floating]) -> None:
    """Draw a line per channel; a pooled nucleus is grey."""
    for channel in range(values.shape[1]):
        style: Look = look(channel) if values.shape[1] > 1 else {"color": GREY}
        ax.plot(time_ms, values[:, channel], **style)
