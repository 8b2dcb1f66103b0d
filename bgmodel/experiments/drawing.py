"""The figure of an experiment: a forest plot of changes, with predictions and published effects."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from bgmodel.deciding.measures import OF_ALL, SHARES
from bgmodel.experiments.expected import AGREES, DISAGREES, FAILS, OPEN, UNANSWERED, WITHOUT
from bgmodel.plots import LABELS
from circuits.plots import GREY, PALETTE, Look, panels, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LOOKS: dict[str, Look] = {
    "": {"marker": "o", "ms": 3, "color": "k"},
    AGREES: {"marker": "o", "ms": 6, "color": PALETTE[0]},
    DISAGREES: {"marker": "X", "ms": 7, "color": PALETTE[1]},
    OPEN: {"marker": "o", "ms": 6, "color": GREY, "mfc": "w"},
    WITHOUT: {"marker": "s", "ms": 6, "color": GREY, "mfc": "w"},
    FAILS: {"marker": "v", "ms": 6, "color": PALETTE[1], "mfc": "w"},
    UNANSWERED: {"marker": "_", "ms": 6, "color": GREY},
}
"""Marker of each outcome, which differ in shape or filling, not only in colour."""
GROUPS = {
    "Change (share of trials or probability)": SHARES,
    "Change (ms)": tuple(name for name in LABELS if name.endswith("_ms")),
    "Change (1/s)": ("drift",),
    "Change (no unit)": ("boundary_separation",),
}
"""Measures that share an axis, by its label."""
COLUMNS = (8, 104)
"""Places of the values and of the verdict, points from the right end of the Axes."""
TITLE = 105
"""Most characters of a line of the title."""


@styled
def forest(
    measures: pd.DataFrame, verdicts: pd.DataFrame, published: pd.DataFrame, title: str
) -> Figure:
    """Draw the change of each measure with its interval."""
    by = {name: rows.set_index("measure") for name, rows in measures.groupby("condition")}
    change = by["change"].join(
        verdicts.set_index("measure")[["direction", "at_least", "outcome"]], how="left"
    )
    change["from"], change["to"] = by["control"]["value"], by["manipulation"]["value"]
    effects = published[published["condition"] == "change"].set_index("measure")
    groups = {}
    for label, names in GROUPS.items():
        rows = change.reindex([name for name in LABELS if name in names]).dropna(subset=["value"])
        if not by["control"]["value"]["missed"] and not by["manipulation"]["value"]["missed"]:
            rows = rows.drop(index=[name for name in OF_ALL if name in rows.index])
        if len(rows):
            groups[label] = rows
    heights = [len(rows) for rows in groups.values()]
    size = (7.2, 0.26 * sum(heights) + 0.5 * len(groups) + 0.9)
    figure, axes = panels(len(groups), size=size, height_ratios=[0.4 + h for h in heights])
    layout: Any = figure.get_layout_engine()
    layout.set(rect=(0, 0, 0.62, 1))  # numbers and verdicts are on the right
    for ax, (label, rows) in zip(axes[:, 0], groups.items(), strict=True):
        _panel(ax, rows, effects)
        ax.set_xlabel(label, labelpad=1)
    _beside(axes[0, 0], -0.95, "Control → manipulation", "Verdict" if len(verdicts) else "")
    shown = [k for k in LOOKS if k in set(change["outcome"].fillna(""))]
    handles = [_entry(ls="", label=k.capitalize() or "No prediction", **LOOKS[k]) for k in shown]
    if len(verdicts):
        from matplotlib.patches import Patch

        handles.append(Patch(fc="0.88", ec=GREY, label="Predicted"))
    if len(effects):
        handles.append(_entry(ls="", marker="D", ms=4, color=GREY, mfc="w", label="Published"))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), handlelength=1.2)
    axes[0, 0].set_title(" ")  # room for the headings
    figure.suptitle(textwrap.fill(title, TITLE), x=0.01, ha="left")
    return figure


def _entry(**style: Any) -> Any:
    """Return an entry of the legend."""
    from matplotlib.lines import Line2D

    return Line2D([], [], **style)


def _beside(ax: Axes, y: float, *texts: str) -> None:
    """Write the texts of the columns on the right of the Axes, in the row of a measure."""
    style: Look = {"va": "center", "fontsize": 7, "in_layout": False, "annotation_clip": False}
    for x_points, text in zip(COLUMNS, texts, strict=True):
        at: Look = {"xytext": (x_points, 0), "textcoords": "offset points"}
        ax.annotate(text, (1, y), xycoords=ax.get_yaxis_transform(), **at, **style)


def _panel(ax: Axes, rows: pd.DataFrame, effects: pd.DataFrame) -> None:
    """Draw the changes that share a unit, one row each."""
    here = effects[effects.index.isin(rows.index)]
    least = rows["at_least"].to_numpy(dtype=float)
    published = here[["published", "published_low", "published_high"]].to_numpy(dtype=float)
    values = rows[["low", "high", "value"]].to_numpy(dtype=float)
    known = np.concatenate([values.ravel(), [0.0], least, -least, published.ravel()])
    known = known[np.isfinite(known)]
    room = 0.06 * (np.ptp(known) or 1.0)
    limits = known.min() - room, known.max() + room
    for y, (name, row) in enumerate(rows.iterrows()):
        outcome = row["outcome"] if isinstance(row["outcome"], str) else ""
        if outcome:
            low, high = _predicted(row["direction"], row["at_least"], limits)
            ax.barh(y, high - low, left=low, height=0.76, fc="0.88", ec=GREY, lw=0.6, zorder=0)
        ends_of = [[max(0.0, row["value"] - row["low"])], [max(0.0, row["high"] - row["value"])]]
        ax.errorbar(
            row["value"], y, xerr=np.nan_to_num(ends_of), capsize=2, lw=1.0, **LOOKS[outcome]
        )
        if name in here.index:
            e = here.loc[str(name)]
            span = [[e["published"] - e["published_low"]], [e["published_high"] - e["published"]]]
            style: Look = {"fmt": "D", "ms": 4, "color": GREY, "mfc": "w", "capsize": 2, "lw": 0.8}
            ax.errorbar(e["published"], y + 0.28, xerr=np.nan_to_num(span), **style)
        form = ".0f" if str(name).endswith("_ms") else ".3f"
        numbers = f"{row['from']:{form}} → {row['to']:{form}}"
        _beside(ax, y, numbers, outcome.capitalize())
    ax.axvline(0, color=GREY, lw=0.8, zorder=1)
    ax.set_yticks(range(len(rows)), [LABELS[str(name)] for name in rows.index])
    ax.tick_params(axis="y", length=0)
    ax.locator_params(axis="x", nbins=6)
    ax.set(xlim=limits, ylim=(len(rows) - 0.5, -0.5))


def _predicted(direction: str, at_least: float, limits: tuple[float, float]) -> tuple[float, float]:
    """Return the range of changes that a prediction allows, within the limits of an axis."""
    return {
        "up": (at_least, limits[1]),
        "down": (limits[0], -at_least),
        "none": (-at_least, at_least),
    }[direction]
