"""A comparison of circuits, as text and as a figure."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from bgmodel.bootstrap import shown
from bgmodel.comparison.matched import OTHER_NOISE, equivalent
from bgmodel.comparison.thresholds import MSPRT, MSPRT_AT_GAIN
from bgmodel.deciding.tradeoff import MARGIN
from bgmodel.integrators.at_thresholds import CIRCUIT, DECODER
from circuits.plots import GREY, PALETTE, Look, panels, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH = 100
"""Largest number of columns of a page."""
SHOWN = {
    "agreement": ("same choice", "z.3f"),
    "agreement_chance": ("by chance", "z.3f"),
    "pearson_r": ("r of times", "z.3f"),
    "extra_ms": ("later, ms", "z.0f"),
}
"""Measures that a page shows: names and number formats."""
CHANCE = (
    "by chance: the trials of one model are shuffled among those with the same truth; the file has "
    "more measures"
)
CEILING = (
    f"{OTHER_NOISE}: the circuit compared with itself under noise of another seed, the highest "
    "agreement to be expected of anything without its noise"
)
NOT_REACHED = "not reached"
UNREACHED = (
    f"{NOT_REACHED}: no threshold at which evidence decides has this accuracy, or the deadline "
    "decides most trials there; a warning states the reason"
)
UNKNOWN = {
    "pearson_r": "all times are equal",
    "extra_ms": (
        "an accuracy is reached within 0.01 but not exceeded, so that the time at this accuracy is "
        "unknown: ask for a lower accuracy (--accuracies), or give more readings"
    ),
}
"""Reasons why a measure may be unknown at an accuracy that is reached."""
NO_INTERVAL = (
    "[unknown]: more than 5 % of the bootstrap's resamples have no value; give more trials"
)


def _plain(form: str) -> Callable[[float], str]:
    """Return a formatter of numbers that shows NaN as a dash."""
    return lambda value: f"{value:{form}}" if np.isfinite(value) else "-"


def verdicts(table: pd.DataFrame, cautions: Sequence[str] = ()) -> str:
    """Return one line per accuracy on the circuit and the first reference.

    A warning that names an accuracy is shown below its line, the others at the end.
    """
    reference = table["reference"].iloc[0]
    of = table[(table["model"] == CIRCUIT) & (table["reference"] == reference)]
    same = equivalent(of)
    lines, left = [f"circuit against {reference}:"], list(cautions)
    for accuracy in same.index:
        rows = of[of["accuracy"] == accuracy].set_index("measure")["value"]
        lines.append(f"  at {accuracy:g}: {_verdict(rows, bool(same[accuracy]))}")
        here = [text for text in left if f"{accuracy:g}" in _accuracies_in(text)]
        left = [text for text in left if text not in here]
        lines += [_wrapped(f"warning: {text}", "    ") for text in here]
    return "\n".join([*lines, *(_wrapped(f"warning: {text}", "  ") for text in left)])


def _verdict(rows: pd.Series, same: bool) -> str:
    """Return a sentence on the values of measures at one accuracy."""
    if rows.isna().all():
        return NOT_REACHED
    equal = f"as accurate once its mean delay is subtracted (within {MARGIN:g})"
    if not same:
        equal = f"not shown to be {equal}"
    late, chance = rows["extra_ms"], rows["agreement_chance"]
    later = f", {abs(late):.0f} ms {'later' if late > 0 else 'earlier'}" if late == late else ""
    return f"same choice {rows['agreement']:.3f} ({chance:.3f} by chance){later}; {equal}"


def _accuracies_in(text: str) -> list[str]:
    """Return the accuracies that a warning says cannot be compared, as written there."""
    match = re.search(r"accuracy (?:of )?((?:[\d.]+, )*[\d.]*\d)", text)
    return match[1].split(", ") if match else []


def _wrapped(text: str, indent: str = "") -> str:
    """Return a text in lines of at most ``WIDTH`` characters."""
    return textwrap.fill(text, WIDTH, initial_indent=indent, subsequent_indent=indent)


def page(table: pd.DataFrame) -> str:
    """Return the main measures at one accuracy as text, one line per model or variant.

    The accuracy is the first at which the circuit is compared. What is unknown is explained below.
    """
    known = table[(table["measure"] == "agreement") & table["value"].notna()]
    accuracy = (known if len(known) else table)["accuracy"].iloc[0]
    here = table[(table["accuracy"] == accuracy) & table["measure"].isin(SHOWN)]
    by = [name for name in ("reference", "model", "variant") if name in table]
    rows: dict[str, dict[str, dict[str, str]]] = {}
    for names, some in here.groupby(by, sort=False):
        *group, name = map(str, names)
        values = some.set_index("measure")
        cells = {m: _cell(values.loc[m], m) for m in SHOWN}
        if values["value"].isna().all():
            cells = {m: NOT_REACHED if m == "agreement" else "" for m in SHOWN}
        rows.setdefault(", ".join(group), {})[name] = cells
    title = f"at an accuracy of {accuracy:g}"
    wide = 2 + max(len(title) - 2, *(len(name) for part in rows.values() for name in part))
    columns = "".join(f"{name:<{w}}" for (name, _), w in zip(SHOWN.values(), WIDTHS, strict=True))
    lines = [f"{title:<{wide + 2}}{columns}"]
    for of, part in rows.items():
        lines += [f"{of}:"] if of else []
        for name, cells in part.items():
            texts = "".join(f"{text:<{w}}" for text, w in zip(cells.values(), WIDTHS, strict=True))
            lines.append(f"  {name:<{wide}}{texts}")
    text = "\n".join(line.rstrip() for line in lines)
    foot = [CHANCE, *([CEILING] if OTHER_NOISE in text else [])]
    foot += [*([UNREACHED] if NOT_REACHED in text else []), *_reasons(here)]
    return "\n".join([text, *map(_wrapped, foot)])


WIDTHS = (24, 11, 24, 0)
"""Widths of the columns of ``SHOWN``."""


def _reasons(here: pd.DataFrame) -> list[str]:
    """Return why measures are unknown at an accuracy that is reached, one line per measure."""
    by = [name for name in ("reference", "model", "variant") if name in here]
    here = here[here.groupby(by)["value"].transform(lambda values: values.notna().any())]
    lost = set(here.loc[here["value"].isna(), "measure"])
    reasons = [f"{SHOWN[name][0]} unknown: {why}" for name, why in UNKNOWN.items() if name in lost]
    loose = here["measure"].ne("agreement_chance") & here["value"].notna() & here["low"].isna()
    return [*reasons, NO_INTERVAL] if loose.any() else reasons


def _cell(row: pd.Series, measure: str) -> str:
    form = SHOWN[measure][1]
    if measure == "agreement_chance":
        return _plain(form)(row["value"])
    return shown(row["value"], row["low"], row["high"], form)


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
    from matplotlib.transforms import ScaledTranslation

    # In inches, since the layout changes the size of the Axes.
    below = ScaledTranslation(-0.2, -0.45, ax.figure.dpi_scale_trans)
    place: Look = {"loc": "upper left", "bbox_to_anchor": (0, 0), "borderaxespad": 0}
    place["bbox_transform"] = ax.transAxes + below
    ax.legend(ncols=columns, columnspacing=1.0, handlelength=2.0, **place)
