"""The result of an exam: a row per number, totals per domain, a picture and JSON."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from bgmodel.bootstrap import Z95
from bgmodel.exam.measures import Estimate
from bgmodel.exam.numbers import Number
from bgmodel.exam.tables import Failed
from bgmodel.experiments.expected import AGREES, DISAGREES, FAILS, LOOKS, OPEN, UNANSWERED
from bgmodel.support.files import json_text, provenance
from bgmodel.support.references import cited
from bgmodel.support.saved import Facts
from bgmodel.support.tables import Readable
from circuits.plots import GREY, Look, panels, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

OUTCOMES = (AGREES, DISAGREES, OPEN, FAILS, UNANSWERED)
"""Outcomes of a number, in the order of bars."""
MOST_Z = 2.0
"""A value agrees within this many standard errors."""
COLUMNS = (
    "id", "domain", "about", "published", "unit", "value", "se", "z", "outcome", "reason", "trials",
    "weight", "set_by", "mark", "species", "source",
)  # fmt: skip


def scored(number: Number, included: str, estimate: Estimate | Exception) -> dict[str, Any]:
    """Return the row of a number, for an estimate or the reason for its absence.

    ``included`` is the name of the included circuit that was run, "" for others.
    """
    row: dict[str, Any] = {name: getattr(number, name, None) for name in COLUMNS}
    row |= {"published": number.published(), "reason": "", "z": np.nan, "trials": 0}
    row["set_by"] = "set by" if included in number.set_by else "predicted"
    if isinstance(estimate, Exception):
        outcome = FAILS if isinstance(estimate, Failed) else UNANSWERED
        return row | {"value": np.nan, "se": np.nan, "outcome": outcome, "reason": str(estimate)}
    row |= {"value": estimate.value, "se": estimate.se, "trials": estimate.trials}
    if number.direction is not None:
        half = Z95 * estimate.se
        outcome = number.outcome(estimate.value, estimate.value - half, estimate.value + half)
        reason = f"cannot tell with {estimate.trials} trials" if outcome == OPEN else ""
        return row | {"outcome": outcome, "reason": reason}
    z = number.z(estimate.value, estimate.se, estimate.se)
    return row | {"z": z, "outcome": AGREES if abs(z) <= MOST_Z else DISAGREES}


def totals(table: pd.DataFrame) -> pd.DataFrame:
    """Return the totals of each domain, one row each.

    Columns domain, numbers, agrees, disagrees, "left open", fails, "not answered" (counts),
    predicted_agrees (of those, how many were not set by the number), share (weight of those that
    agree over that of all that agree, disagree or fail; NaN without any), median_z (of the sizes of
    z).
    """
    rows = []
    for domain, part in table.groupby("domain", sort=False):
        counts = {name: int((part["outcome"] == name).sum()) for name in OUTCOMES}
        good = part["outcome"] == AGREES
        judged = part["outcome"].isin([AGREES, DISAGREES, FAILS])
        weight = float(part["weight"][judged].sum())
        share = float(part["weight"][good].sum()) / weight if weight else np.nan
        row = {"domain": domain, "numbers": len(part), **counts}
        row["predicted_agrees"] = int((good & (part["set_by"] == "predicted")).sum())
        rows.append(row | {"share": share, "median_z": part["z"].abs().median()})
    return pd.DataFrame(rows)


@dataclass(frozen=True, repr=False)
class ExamRecord(Facts):
    """The scores of a circuit, or of trial tables.

    Parameters
    ----------
    examinee : str
        Name of the circuit, or of the files.
    table : DataFrame
        One row per number: id, domain, about, published, unit, value with se (standard error from
        simulation), z (difference over the root of both variances; NaN for a direction), outcome
        (one of ``OUTCOMES``), reason, trials, weight, set_by ("set by" or "predicted"), mark,
        species, source.
    seed : int
        Seed of evidence and noise.
    parameters : dict
        Version and hash of the list, circuit and its hash, engine, gain, share of trials.
    """

    examinee: str
    table: pd.DataFrame
    seed: int
    parameters: dict[str, Any] = field(default_factory=dict)

    def facts(self) -> dict[str, str]:
        """Return how many numbers have each outcome, per domain."""
        facts = {"examinee": self.examinee, "list": f"version {self.parameters['list']['version']}"}
        for row in totals(self.table).to_dict("records"):
            judged = row[AGREES] + row[DISAGREES] + row[FAILS]
            facts[str(row["domain"])] = f"{row[AGREES]} of {judged} agree"
        return facts

    def summary(self) -> pd.DataFrame:
        """Return the totals of each domain, see ``totals``; there is no total over domains."""
        return Readable(totals(self.table))

    def to_dataframe(self) -> pd.DataFrame:
        """Return ``table``."""
        return self.table

    def text(self) -> str:
        """Return the report that the command prints: a row per number, and the totals."""
        lines = []
        for domain, part in self.table.groupby("domain", sort=False):
            lines.append(f"{domain}")
            lines += [_line(row) for row in part.to_dict("records")]
        shown = totals(self.table).drop(columns=["median_z"])
        shown["share"] = shown["share"].map(lambda x: "-" if np.isnan(x) else f"{x:.2f}")
        return "\n".join([*lines, "", shown.to_string(index=False), "", LEGEND])

    def plot(self) -> Figure:
        """Draw the exam on one page: z scores and directions of all numbers, and totals."""
        version = self.parameters["list"]["version"]
        title = f"{self.examinee}: exam, list {version}, seed {self.seed}"
        return page(self.table, self.summary(), title)

    def to_json(self, path: str | Path | None = None) -> str:
        """Return the record as JSON, with references and provenance; write it to a path."""
        about = provenance(self.seed, **self.parameters)
        sources = {text: [str(one) for one in cited([text])] for text in set(self.table["source"])}
        about["references"] = dict(sorted(sources.items()))
        tables = {"domains": totals(self.table), "records": self.table}
        return json_text({"examinee": self.examinee, **about, **tables}, path)


LEGEND = """\
±: one standard error; z: difference from the published number in standard errors.
agrees: within 2 standard errors (root of the published and the simulated variance), or the whole
95 % interval in the published direction; disagrees: not; left open: the interval contains both;
fails: the circuit does not do what the number is about; not answered: it cannot be asked.
share: weight of the numbers that agree among those that agree, disagree or fail. A: only the
abstract was read. *: the circuit, or an assumed size, was set by this number; predicted_agrees
counts the others that agree. An edited circuit carries no stars, although numbers may have set rows
that it kept."""


def _line(row: dict[Any, Any]) -> str:
    """Return a number as one line."""
    known = np.isfinite(row["value"])
    value = f"{row['value']:.3g} ± {row['se']:.2g}" if known else "-"
    z = f"z {row['z']:+.1f}" if np.isfinite(row["z"]) else ""
    mark = "A" if row["mark"] == "abstract" else ""
    mark += "*" if row["set_by"] == "set by" else ""
    name = f"{row['id']} {mark}".strip()
    why = f"  ({row['reason']})" if row["reason"] else ""
    unit = str(row["unit"])
    return f"  {name:24} {row['published']:>22} {value:>18} {unit:11} {z:8} {row['outcome']}{why}"


MOST_SHOWN, WITHOUT_Z = 6.0, 8.0
"""Larger z scores are drawn at the first, as arrows; outcomes without a z score at the second."""


@styled
def page(table: pd.DataFrame, totals: pd.DataFrame, title: str) -> Figure:
    """Draw all numbers of an exam and the totals of its domains."""
    size = (7.2, 0.165 * len(table) + 1.2)
    figure, axes = panels(1, 2, size=size, width_ratios=[3, 1.3])
    numbers, domains = axes[0]
    _numbers(numbers, table)
    _domains(domains, totals)
    for ax, name in zip((numbers, domains), "ab", strict=True):
        ax.set_title(name, loc="left", fontweight="bold")
    _legend(figure, [name for name in OUTCOMES if name in set(table["outcome"])])
    figure.suptitle(title, x=0.01, ha="left")
    return figure


def _legend(figure: Figure, names: list[str]) -> None:
    """Explain the marker and the bar of each outcome, and stars and arrows."""
    from matplotlib.legend_handler import HandlerTuple
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        (Line2D([], [], ls="", **LOOKS[name] | {"ms": 5}), Patch(lw=0.5, ec="k", **_fill(name)))
        for name in names
    ]
    handles += [Line2D([], [], ls="", marker=">", ms=5, color=GREY), Line2D([], [], ls="")]
    labels = [name.capitalize() for name in names]
    labels += [f"Beyond {MOST_SHOWN:g}", "* Set by this number"]
    figure.legend(
        handles, labels, loc="outside lower center", ncols=len(handles), fontsize=6,
        handler_map={tuple: HandlerTuple(ndivide=None)}, columnspacing=1.2, handletextpad=0.4,
    )  # fmt: skip


def _fill(name: str) -> dict[str, Any]:
    """Return the filling of the bar of an outcome."""
    face = {OPEN: "w", FAILS: "w", UNANSWERED: "0.8"}.get(name, LOOKS[name]["color"])
    hatch = {OPEN: "////", FAILS: "xxxx"}.get(name, "")
    return {"fc": face, "hatch": hatch}


def _numbers(ax: Axes, table: pd.DataFrame) -> None:
    """Draw a row per number: its z score, or on the right the outcome of one without."""
    ax.axvspan(-2, 2, color="0.9", lw=0, zorder=0)
    ax.axvline(MOST_SHOWN + 1, color=GREY, lw=0.5)
    for y, row in enumerate(table.to_dict("records")):
        z = row["z"]
        style: Look = LOOKS[row["outcome"]] | {"ms": 5, "ls": ""}
        if np.isfinite(z) and abs(z) > MOST_SHOWN:
            style["marker"] = ">" if z > 0 else "<"
        x = float(np.clip(z, -MOST_SHOWN, MOST_SHOWN)) if np.isfinite(z) else WITHOUT_Z
        ax.plot(x, y, clip_on=False, zorder=3, **style)
    starts = np.flatnonzero(table["domain"].ne(table["domain"].shift()))
    for start in starts[1:]:
        ax.axhline(start - 0.5, color=GREY, lw=0.5)
    names = table["id"] + np.where(table["set_by"] == "set by", " *", "")
    ax.set_yticks(range(len(table)), names, fontsize=6)
    ax.tick_params(axis="y", length=0)
    ticks = range(-6, 7, 2)
    ax.set_xticks([*ticks, WITHOUT_Z], [*map("{:g}".format, ticks), "direction\nor none"])
    ax.set(
        xlim=(-MOST_SHOWN - 0.5, WITHOUT_Z + 1), ylim=(len(table) - 0.5, -0.5),
        xlabel="Model less published (standard errors)",
    )  # fmt: skip


def _domains(ax: Axes, per_domain: pd.DataFrame) -> None:
    """Draw, for each domain, how many numbers have each outcome."""
    for y, row in enumerate(per_domain.to_dict("records")):
        left = 0
        for name in OUTCOMES:
            count = row[name]
            ax.barh(y, count, left=left, height=0.6, ec="k", lw=0.5, **_fill(name))
            left += count
        ax.text(0.05, y - 0.36, row["domain"], fontsize=6, va="bottom")
    ax.set(xlabel="Numbers", ylim=(len(per_domain) - 0.5, -0.8), yticks=[])
