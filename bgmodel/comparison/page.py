"""Comparisons of circuits as text."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd

from bgmodel.bootstrap import shown
from bgmodel.comparison.matched import MINUS_INTACT, MOST_FORCED, OTHER_NOISE, equivalent
from bgmodel.deciding.tradeoff import MARGIN


def behaviour(table: pd.DataFrame) -> str:
    """Return the behaviour of edited circuits at the threshold of the unedited one, as text.

    Parameters
    ----------
    table : DataFrame
        As from ``compare_edits``.
    """
    fixed = table[table["kind"] == "fixed"]
    rows = fixed.drop_duplicates(["variant", "accuracy"])[["variant", "accuracy"]]
    wide = fixed.pivot(index=["variant", "accuracy"], columns="measure", values="value")
    wide = wide.loc[list(rows.itertuples(index=False, name=None))]
    blind, late = wide.pop("without_evidence"), wide["forced"] > MOST_FORCED
    ways = [NOT_REACHED, "without evidence", "mostly at the deadline"]
    wide.insert(0, "decides", np.select([blind.isna(), blind > 0, late], ways, "by evidence"))
    wide = wide.rename_axis(columns=None)
    forms = {name: _plain(".0f" if name.endswith("_ms") else ".3f") for name in wide.columns[1:]}
    legend = "mean_ms in ms; the other numbers are shares of trials"
    return f"{wide.to_string(formatters=forms)}\n{legend}"


def _plain(form: str) -> Callable[[float], str]:
    """Return a formatter of numbers that shows NaN as a dash."""
    return lambda value: f"{value:{form}}" if np.isfinite(value) else "-"


def page(table: pd.DataFrame) -> str:
    """Return a comparison as text, one column per accuracy, 95 % intervals in brackets.

    Each row ends with the measure's name in the table, in round brackets. What is unknown is
    explained below.

    Parameters
    ----------
    table : DataFrame
        As from ``compare``, or the rows of kind "value" from ``compare_edits``.
    """
    by = [name for name in ("reference", "model", "variant") if name in table]
    parts = ["value [95 % interval, by a bootstrap over trials] (name in the table)\n"]
    for names, part in table.groupby(by, sort=False):
        whole = part[part["accuracy"].isna()].set_index("measure").T
        same = equivalent(part)
        change = MINUS_INTACT in names
        columns = {
            f"at {accuracy:g}": _column(part, accuracy, None if change else bool(same[accuracy]))
            for accuracy in same.index
        }
        what = ", ".join(map(str, names))
        parts.append(f"{what}: {_line(whole, change)}")
        parts.append(pd.DataFrame(columns).fillna("").to_string() + "\n")
    text = "\n".join(parts).rstrip()
    reasons = [*([UNREACHED] if NOT_REACHED in text else []), *_reasons(table)]
    return "\n".join([text, "", *_legend(table), *reasons])


def _legend(table: pd.DataFrame) -> list[str]:
    """Return the meaning of chance levels and ceilings, one line each."""
    found = [CHANCE]
    if "reference" in table and (table["reference"] == OTHER_NOISE).any():
        found.append(CEILING)
    return found


BY_CHANCE, BEYOND = "by chance", "beyond chance"
CHANCE = (
    f"{BY_CHANCE}: the same measure if the trials of one model are shuffled among those with the "
    f"same truth; {BEYOND}: (share - chance) / (1 - chance), 0 at chance and 1 where all agree"
)
CEILING = (
    f"{OTHER_NOISE}: the circuit compared with itself under noise of another seed, the highest "
    "agreement to be expected of anything without its noise; r without the circuit's noise: r / "
    "square root of the circuit's r with itself"
)
NOT_REACHED = "not reached"
UNREACHED = (
    f"{NOT_REACHED}: no threshold at which evidence decides has this accuracy, or the deadline "
    "decides most trials there; ask for other accuracies (--accuracies), or give more readings"
)


UNKNOWN = {
    "error_agreement": "the reference makes no errors in these trials: give more",
    "pearson_r": "all times are equal",
    "extra_ms": (
        "an accuracy is reached within 0.01 but not exceeded, so that the time at this accuracy is "
        "unknown: ask for a lower accuracy (--accuracies), or give more readings"
    ),
    "accuracy_gap": (
        "in equal time the accuracy is outside the range of the thresholds: ask for other "
        "accuracies (--accuracies), or give more readings"
    ),
}
"""Reasons why a measure may be unknown at an accuracy that is reached."""
NO_INTERVAL = (
    "[unknown]: more than 5 % of the bootstrap's resamples have no value; give more trials"
)


def _reasons(table: pd.DataFrame) -> list[str]:
    """Return why measures are unknown at accuracies that are reached, one line per measure."""
    at = table[table["accuracy"].notna() & table["measure"].isin(SHOWN)]
    by = [name for name in ("reference", "model", "variant", "accuracy") if name in at]
    at = at[at.groupby(by)["value"].transform(lambda values: values.notna().any())]
    lost = set(at.loc[at["value"].isna(), "measure"])
    found = [f"{SHOWN[name][0]} unknown: {why}" for name, why in UNKNOWN.items() if name in lost]
    loose = (at["value"].notna() & at["low"].isna()).any()
    return [*found, NO_INTERVAL] if loose else found


def _line(whole: pd.DataFrame, change: bool) -> str:
    """Return the extra time as text: offset and slope of a line over accuracies."""
    if whole["offset_ms"].isna()["value"]:
        return "too few accuracies from 0.85 to 0.98 are reached to estimate the extra time"
    late, slope = _cell(whole["offset_ms"], ".0f"), _cell(whole["slope"], ".3f")
    if change:
        return f"offset_ms {late}, slope {slope}: differences from the intact circuit"
    return (
        f"{late} ms (offset_ms) later, and {slope} (slope) of the reference's time (a line over "
        "accuracies 0.85 to 0.98)"
    )


SHOWN = {
    "agreement": ("same choice", ".3f"),
    "agreement_chance": (BY_CHANCE, ".3f"),
    "agreement_corrected": (BEYOND, ".3f"),
    "error_agreement": ("same where the reference errs", ".2f"),
    "error_agreement_chance": (BY_CHANCE, ".2f"),
    "within_50_ms": ("within 50 ms of the median lag", ".2f"),
    "within_50_ms_chance": (BY_CHANCE, ".2f"),
    "pearson_r": ("r of times", ".3f"),
    "pearson_r_chance": (BY_CHANCE, ".3f"),
    "r_noise_corrected": ("without the circuit's noise", ".3f"),
    "spearman_r": ("r of their ranks", ".3f"),
    "extra_ms": ("later, ms", ".0f"),
    "accuracy_gap": ("accuracy gained in equal time", "+.3f"),
}
"""Measures at an accuracy: names and number formats used by ``page``."""


def _column(part: pd.DataFrame, accuracy: float, same: bool | None) -> dict[str, str]:
    """Return the rows shown at one accuracy; same: whether accuracies are equivalent there."""
    here = part[part["accuracy"] == accuracy].set_index("measure").T
    measures = {m: f"{name} ({m})" for m, (name, _) in SHOWN.items() if m in here}
    if here.loc["value"].isna().all():
        return dict.fromkeys(measures.values(), NOT_REACHED)
    known = {name: _cell(here[m], SHOWN[m][1]) for m, name in measures.items()}
    if same is None:
        return known
    return known | {f"equal within {MARGIN:g}": "yes" if same else "not established"}


def _cell(row: pd.Series, form: str) -> str:
    return shown(row["value"], row["low"], row["high"], form)
