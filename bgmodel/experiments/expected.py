"""What is expected of a measure, the verdict on an estimate, and the figure of both."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pandas as pd

from bgmodel.bootstrap import Z95
from bgmodel.deciding.measures import (
    MEASURES,
    OF_ALL,
    OF_DECIDED,
    OF_DIFFUSION,
    OF_STOP,
    SHARES,
)
from bgmodel.plots import LABELS
from circuits.errors import DataWarning, InputError, require
from circuits.plots import GREY, PALETTE, Look, panels, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

AGREES, DISAGREES, OPEN = "agrees", "disagrees", "left open"
COMPATIBLE, DIFFERS, NO_INTERVAL = "compatible", "differs", "no interval to compare"
"""Comparison of a published effect with the model's: whether their difference includes 0."""
FAILS, UNANSWERED = "fails", "not answered"
"""Outcomes of a number of the exam: the circuit lacks the behaviour, or it does not apply."""
WITHOUT = "decides without evidence"
"""The outcome, regardless of the prediction, if the manipulated circuit ignores evidence."""
FEWEST_DECIDED = 20
"""Least number of trials decided in time for a statement on a condition's decisions."""
PERCENT = "percent"
"""Condition with the change in per cent of the control's value, for measures of decisions."""
RELATIVE = (*OF_DECIDED, *OF_ALL)
"""Measures with a change in per cent."""
LIKELY = dict.fromkeys((*MEASURES, *OF_STOP), (1.0, np.inf)) | dict.fromkeys(SHARES, (0.0, 0.5))
LIKELY |= dict.fromkeys(OF_DIFFUSION[:2], (0.0, 1.0))
"""Measures, with the range of sizes of a change (other than 0) without a warning."""
OF_UNITS = {"decided": "a number of trials", **dict.fromkeys(SHARES, "a share of trials")}
OF_UNITS |= dict.fromkeys(OF_DIFFUSION[:2], "in the units of EZ-diffusion, with a noise of s = 0.1")
"""What a warning says of the unit of a measure; of others that it is in ms."""


@dataclass(frozen=True)
class Expected:
    """What is expected of a measure: a direction, or a value with its error.

    In an experiment the measure is that of the manipulation minus that of the control: a prediction
    is a direction, a published effect a value. A number of the exam is either.
    """

    measure: str
    """A name in ``measures.MEASURES`` or ``measures.OF_STOP``."""
    direction: Literal["up", "down", "none"] | None = None
    """Direction of a change; "none" means that it stays within ``at_least``."""
    at_least: float = 0.0
    """The smallest change that counts, in the measure's unit."""
    value: float | None = None
    """The value; in the middle of its interval if it is not given."""
    se: float | None = None
    """Its standard error."""
    low: float | None = None
    """Lower end of its 95 % interval, instead of a standard error."""
    high: float | None = None
    """Upper end of its 95 % interval."""
    unit: str = "own"
    """The measure's unit, or "percent" of the control's value if time scales differ."""
    source: str = ""
    """Where it was published, and how the number was derived."""

    def __post_init__(self) -> None:
        require(0 <= self.at_least < np.inf, "at_least", "must be >= 0", self.at_least)
        numbers = [number is not None for number in (self.value, self.se, self.low, self.high)]
        if self.direction is None:
            require(self.at_least == 0, "at_least", "is for a direction", self.at_least)
            whole = numbers[1:] in ([0, 0, 0], [1, 0, 0], [0, 1, 1])
            require(whole, "low", "must be given with high and without se", self.low)
            low, high = self.interval
            require(self.se is None or self.se > 0, "se", "must be > 0", self.se)
            require(not low > high, "low", "must be below high", self.low)
            inside = np.isfinite(self.middle) and not (self.middle < low or self.middle > high)
            must = "must lie between low and high, or there must be a direction"
            require(inside, "value", must, self.value)
        else:
            must = "must not be combined with a value or an interval"
            require(not any(numbers), "direction", must, self.direction)
            fits = self.direction != "none" or self.at_least > 0
            require(fits, "at_least", 'must be > 0 if the direction is "none"', self.at_least)
        self._check_fits()

    def _check_fits(self) -> None:
        """Refuse an unknown measure or an impossible size; warn if its unit seems to be another."""
        must = f"must be one of {', '.join(LIKELY)}"
        require(self.measure in LIKELY, "measure", must, self.measure)
        value = self.direction is None
        units = ("own", PERCENT) if value else ("own",)
        require(self.unit in units, "unit", f"must be {' or '.join(units)}", self.unit)
        what, size = ("value", abs(self.middle)) if value else ("at_least", self.at_least)
        if self.unit == PERCENT:
            must = f"must be one of {', '.join(RELATIVE)} for a change in percent"
            require(self.measure in RELATIVE, "measure", must, self.measure)
            if 0 < size < 1:
                DataWarning.warn(f"a change of {self.middle:g} percent is tiny: give -15 for -15 %")
            return
        if self.measure in SHARES and (size > 1 or (size == 1 and not value)):
            must = f"must be a share, below 1, got {size:g}: write 0.01 for 1 %"
            raise InputError(f"{what} of {self.measure} {must}", what)
        low, high = LIKELY[self.measure]
        if size and not low <= size <= high:
            DataWarning.warn(
                f"{what} = {size:g} is an unlikely change of {self.measure}, which is "
                f"{OF_UNITS.get(self.measure, 'in ms, not in s')}"
            )

    @property
    def interval(self) -> tuple[float, float]:
        """The ends of the 95 % interval; NaN if they are unknown."""
        if self.se is not None and self.value is not None:
            return self.value - Z95 * self.se, self.value + Z95 * self.se
        low, high = (np.nan if end is None else end for end in (self.low, self.high))
        return low, high

    @property
    def middle(self) -> float:
        """The value, by default the middle of its interval; NaN for a direction."""
        return sum(self.interval) / 2 if self.value is None else self.value

    def error(self, value: float) -> float:
        """Return the standard error on the side of another value; NaN if it is unknown.

        An interval counts as one of 95 %.
        """
        low, high = self.interval
        if self.se is not None:
            return self.se
        if self.value is None:
            return (high - low) / (2 * Z95)
        return (high - self.value if value > self.value else self.value - low) / Z95

    def z(self, value: float, below: float, above: float) -> float:
        """Return the difference of an estimate from the value, in standard errors of both.

        The estimate has one below and one above. Of two asymmetric intervals the sides count that
        point to each other, as of independent samples (Zou & Donner 2008).
        """
        apart = value - self.middle
        error = float(np.hypot(below if apart > 0 else above, self.error(value)))
        return apart / max(error, float(np.finfo(float).tiny))

    def outcome(self, value: float, low: float, high: float) -> str:
        """Return the verdict on an estimate from its 95 % interval; open if it is not finite.

        On a direction: "agrees" if the whole interval is beyond ``at_least`` (within it for
        "none"), "disagrees" if none of it is, otherwise "left open". On a value: "compatible" if
        the 95 % interval of the difference includes 0, otherwise "differs".
        """
        if not np.isfinite([value, low, high][self.direction is not None :]).all():
            return OPEN
        if self.direction is None:
            z = self.z(value, (value - low) / Z95, (high - value) / Z95)
            return NO_INTERVAL if np.isnan(z) else COMPATIBLE if abs(z) <= Z95 else DIFFERS
        if self.direction == "none":
            inside = -self.at_least < low and high < self.at_least
            outside = low >= self.at_least or high <= -self.at_least
            return AGREES if inside else DISAGREES if outside else OPEN
        if self.direction == "down":
            low, high = -high, -low
        return AGREES if low > self.at_least else DISAGREES if high <= self.at_least else OPEN


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
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

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
    handles: list[Any] = [
        Line2D([], [], ls="", label=k.capitalize() or "No prediction", **LOOKS[k]) for k in shown
    ]
    if len(verdicts):
        handles.append(Patch(fc="0.88", ec=GREY, label="Predicted"))
    if len(effects):
        style: Look = {"marker": "D", "ms": 4, "color": GREY, "mfc": "w"}
        handles.append(Line2D([], [], ls="", label="Published", **style))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), handlelength=1.2)
    axes[0, 0].set_title(" ")  # room for the headings
    figure.suptitle(textwrap.fill(title, TITLE), x=0.01, ha="left")
    return figure


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
