"""Comparisons of circuits as text."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd

from bgmodel.comparison.compare import MARGIN, MOST_FORCED, equivalent, shown


def behaviour(table: pd.DataFrame) -> str:
    """Return what variants do at the intact circuit's threshold as text.

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
    said = [NOT_REACHED, "without evidence", "mostly at the deadline"]
    wide.insert(0, "decides", np.select([blind.isna(), blind > 0, late], said, "by evidence"))
    wide = wide.rename_axis(columns=None)
    forms = {name: _plain(".0f" if name.endswith("_ms") else ".3f") for name in wide.columns[1:]}
    legend = "mean_ms in ms; the other numbers are shares of trials"
    return f"{wide.to_string(formatters=forms)}\n{legend}"


def _plain(form: str) -> Callable[[float], str]:
    """Return a formatter of numbers; what is not known is a dash."""
    return lambda value: f"{value:{form}}" if np.isfinite(value) else "-"


def page(table: pd.DataFrame) -> str:
    """Return a comparison as text, a column an accuracy, 95 % intervals in brackets.

    Parameters
    ----------
    table : DataFrame
        As from ``compare_with_msprt`` or, of the kind "value", from ``compare_edits``.
    """
    by = [name for name in ("reference", "model", "variant") if name in table]
    parts = ["value [95 % interval, by a bootstrap over trials]\n"]
    for names, part in table.groupby(by, sort=False):
        whole = part[part["accuracy"].isna()].set_index("measure").T
        same = equivalent(part)
        columns = {f"at {accuracy:g}": _column(part, accuracy, same) for accuracy in same.index}
        what = ", ".join(map(str, names))
        parts.append(f"{what}: {_line(whole)}")
        parts.append(pd.DataFrame(columns).fillna("").to_string() + "\n")
    text = "\n".join(parts).rstrip()
    return f"{text}\n\n{UNREACHED}" if NOT_REACHED in text else text


NOT_REACHED = "not reached"
UNREACHED = (
    f"{NOT_REACHED}: no threshold has this accuracy, or the deadline decides most trials there; "
    "ask for lower accuracies (--accuracies), or give more readings"
)


def _line(whole: pd.DataFrame) -> str:
    """Return the extra time as text: offset and slope of a line over accuracies."""
    if whole["offset_ms"].isna()["value"]:
        return "too few accuracies from .85 to .98 are reached to say how much later it decides"
    late, slope = _cell(whole["offset_ms"], ".0f"), _cell(whole["slope"], ".3f")
    return (
        f"{late} ms later, and {slope} of the reference's time (a line over accuracies .85 to .98)"
    )


SHOWN = {
    "agreement": ("same choice", ".3f"),
    "error_agreement": ("same where the reference errs", ".2f"),
    "pearson_r": ("r of times", ".3f"),
    "spearman_r": ("r of their ranks", ".3f"),
    "within_50_ms": ("within 50 ms of the median lag", ".2f"),
    "extra_ms": ("later, ms", ".0f"),
    "accuracy_gap": ("accuracy gained in equal time", "+.3f"),
}
"""Measures at an accuracy: what ``page`` calls them, and how it prints them."""


def _column(part: pd.DataFrame, accuracy: float, same: pd.Series) -> dict[str, str]:
    """Return what is shown at one accuracy."""
    here = part[part["accuracy"] == accuracy].set_index("measure").T
    measures = {m: name for m, (name, _) in SHOWN.items() if m in here}
    if here.loc["value"].isna().all():
        return dict.fromkeys(measures.values(), NOT_REACHED)
    known = {name: _cell(here[m], SHOWN[m][1]) for m, name in measures.items()}
    return known | {f"equal within {MARGIN:g}": "yes" if same[accuracy] else "not established"}


def _cell(row: pd.Series, form: str) -> str:
    return shown(row["value"], row["low"], row["high"], form)
