"""Comparisons of circuits as text."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd

from bgmodel.bootstrap import shown
from bgmodel.comparison.matched import MOST_FORCED, OTHER_NOISE, equivalent
from bgmodel.deciding.tradeoff import MARGIN
from bgmodel.integrators.deciding import CIRCUIT

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
    "more measures, each with its chance level"
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


def behaviour(table: pd.DataFrame) -> str:
    """Return the behaviour of edited circuits at the threshold of the unedited one, as text."""
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
    table = table[table["accuracy"].notna()]
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


WIDTHS = (22, 11, 24, 0)
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
