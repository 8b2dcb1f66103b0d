"""What an experiment's run says of its predictions, as a table and as a page."""

from __future__ import annotations

import numpy as np
import pandas as pd

from bgmodel.comparison.compare import reads_nothing, shown
from bgmodel.experiments.experiment import (
    AGREES,
    CONDITIONS,
    DISAGREES,
    FEWEST_DECIDED,
    OPEN,
    PERCENT,
    WITHOUT,
    Experiment,
)
from bgmodel.experiments.measures import (
    CUT_OFF,
    DIFFUSION_S,
    NO_DIFFUSION,
    OF_DECIDED,
    OF_DIFFUSION,
)

VERDICTS = {
    AGREES: "agrees",
    DISAGREES: "disagrees",
    OPEN: "leaves it open",
    WITHOUT: "decides without evidence, which is no agreement",
}
"""What a page says of the model."""
COMPATIBLE, DIFFERS, NO_INTERVAL = "compatible", "differs", "no interval to compare"
"""What is said of a published effect and the model's: their difference holds 0, or does not."""
UNITS = (
    (("mean_ms",), "_ms: ms"),
    (("decided",), "decided: trials"),
    (("criterion",), "criterion: a probability"),
    (("drift",), f"drift: 1/s, bound: no unit (EZ-diffusion, noise s = {DIFFUSION_S:g} per √s)"),
    (("accuracy",), "the others: shares of trials"),
)
"""Measures, and the unit that a page prints."""


def outcomes(experiment: Experiment, table: pd.DataFrame) -> pd.DataFrame:
    """Hold what was found to what was predicted.

    Parameters
    ----------
    experiment : Experiment
        With its predictions.
    table : DataFrame
        The measures, as from ``run_experiment``.

    Returns
    -------
    DataFrame
        One row per prediction: measure, direction, at_least, value, low, high (of the change), and
        outcome: "agrees" if the whole interval lies beyond at_least in the direction (within
        +-at_least for "none"), "disagrees" if none of it does, else "left open"; "decides
        without evidence", whatever was predicted, if most manipulated trials decide before their
        first reading or most foreperiods end in a response within half a second. Where fewer than
        ``FEWEST_DECIDED`` trials are decided, what is said of decisions is left open.
    """
    blind, few = _blind(experiment, table), _few(table)
    change = table[table["condition"] == "change"].set_index("measure")
    change = change[["value", "low", "high"]]
    rows = []
    for p in experiment.predictions:
        value, low, high = map(float, change.loc[p.measure].to_numpy())
        verdict = WITHOUT if blind else p.outcome(low, high)
        if not blind and few and p.measure in OF_DECIDED:
            verdict = OPEN
        rows.append((p.measure, p.direction, p.at_least, value, low, high, verdict))
    names = ["measure", "direction", "at_least", "value", "low", "high", "outcome"]
    return pd.DataFrame(rows, columns=names)


def _blind(experiment: Experiment, table: pd.DataFrame) -> bool:
    """Whether the manipulated circuit decides without evidence."""
    shares = table[table["condition"] == "manipulation"].set_index("measure")["value"]
    return bool(
        reads_nothing(shares["premature"], shares["anticipatory"], experiment.foreperiod_ms)
    )


def _few(table: pd.DataFrame) -> bool:
    """Whether the manipulated circuit decides too few trials to speak of."""
    chosen = (table["condition"] == "manipulation") & (table["measure"] == "decided")
    return bool(table.loc[chosen, "value"].item() < FEWEST_DECIDED)


def beside_published(experiment: Experiment, table: pd.DataFrame) -> pd.DataFrame:
    """Return the measures beside the published effects.

    Parameters
    ----------
    experiment : Experiment
        With its effects.
    table : DataFrame
        The measures, as from ``run_experiment``.

    Returns
    -------
    DataFrame
        One row per effect: condition ("change" or "percent"), measure, published, published_low,
        published_high, value, low, high (the model's), effect_source, and comparison:
        "compatible" if the 95 % interval of the model's minus the published one holds 0, else
        "differs"; "decides without evidence" and "left open" as in ``outcomes``. Both
        samples are independent: the ends of the interval are those of Zou & Donner 2008,
        ``d - sqrt((m - l_m)^2 + (u_p - p)^2)`` and ``d + sqrt((u_m - m)^2 + (p - l_p)^2)``,
        ``d = m - p``.
    """
    blind, few = _blind(experiment, table), _few(table)
    rows = []
    for effect in experiment.effects:
        condition = PERCENT if effect.unit == PERCENT else CONDITIONS[2]
        chosen = (table["condition"] == condition) & (table["measure"] == effect.measure)
        value, low, high = map(float, table.loc[chosen, ["value", "low", "high"]].to_numpy()[0])
        p_low, p_high = effect.interval
        apart = value - effect.value
        lower = apart - np.hypot(value - low, p_high - effect.value)
        upper = apart + np.hypot(high - value, effect.value - p_low)
        if blind:
            said = WITHOUT
        elif not np.isfinite(value) or (few and effect.measure in OF_DECIDED):
            said = OPEN
        elif np.isnan(p_low):
            said = NO_INTERVAL
        else:
            said = COMPATIBLE if lower <= 0 <= upper else DIFFERS
        numbers = (effect.value, p_low, p_high, value, low, high)
        rows.append((condition, effect.measure, *numbers, effect.source, said))
    names = ["condition", "measure", "published", "published_low", "published_high"]
    names += ["value", "low", "high", "effect_source", "comparison"]
    return pd.DataFrame(rows, columns=names)


def page(experiment: Experiment, table: pd.DataFrame) -> str:
    """Return an experiment and its outcome as text, 95 % intervals in brackets.

    Parameters
    ----------
    experiment : Experiment
        What was run.
    table : DataFrame
        The measures, as from ``run_experiment``.
    """
    lines = [
        f"{experiment.name} ({experiment.source})" if experiment.source else experiment.name,
        *([f"published: {experiment.published}"] if experiment.published else []),
        experiment.note,
        *_edits(experiment),
        "",
        "value [95 % interval, by a bootstrap over trials]",
        f"{'':<16}" + "".join(f"{name:<26}" for name in CONDITIONS),
    ]
    for measure in table["measure"].unique():
        rows = table[table["measure"] == measure]
        if rows["value"].notna().any():
            cells = rows.loc[rows["condition"] != PERCENT, ["value", "low", "high"]].to_numpy()
            lines.append(f"{measure:<16}" + "".join(f"{_cell(measure, *c):<26}" for c in cells))
    lines += ["", _units(table), *_withheld(experiment, table), "", "predicted before the run:"]
    for measure, direction, at_least, *found, outcome in outcomes(experiment, table).to_numpy():
        by = "to within" if direction == "none" else "by"
        lines.append(
            f"{measure} {direction}, {by} {at_least:g}: the model {VERDICTS[outcome]} "
            f"({_cell(measure, *found)})"
        )
    return "\n".join(line.rstrip() for line in [*lines, *_effects(experiment, table)])


def _effects(experiment: Experiment, table: pd.DataFrame) -> list[str]:
    """Return each published effect beside the model's, a line per effect."""
    lines = ["", "published, as a number, and the model's:"] if experiment.effects else []
    for row in beside_published(experiment, table).to_dict("records"):
        relative = row["condition"] == PERCENT
        whole = row["measure"].endswith("_ms")
        form = "+.1f" if relative else "+.0f" if whole else "+.3f"
        published = f"{row['published']:{form}}"
        if np.isfinite(row["published_low"]):
            ends = (row["published_low"], row["published_high"])
            published = shown(row["published"], *ends, form)
        model = shown(row["value"], row["low"], row["high"], form)
        told = " ".join(row["effect_source"].split())
        unit = " in %" if relative else ""
        lines.append(
            f"{row['measure']}{unit}: {published}, the model {model}: {row['comparison']} ({told})"
        )
    return lines


def _units(table: pd.DataFrame) -> str:
    """Return the units of the measures that are known, as text."""
    known = set(table.loc[table["value"].notna(), "measure"])
    return "units: " + "; ".join(unit for names, unit in UNITS if {*names} & known)


def _withheld(experiment: Experiment, table: pd.DataFrame) -> list[str]:
    """Return why a condition has no diffusion's parameters, a line per condition."""
    predicted = any(p.measure in OF_DIFFUSION for p in experiment.predictions)
    if not predicted and (experiment.task.evidence is not None or experiment.task.channels != 2):
        return []
    values = table.set_index(["condition", "measure"])["value"]
    found = []
    for condition in CONDITIONS[:2]:
        missed = values[condition, "missed"]
        if missed > CUT_OFF:
            why = (
                f"the deadline cuts off {missed:.1%} of trials, more than {CUT_OFF:.0%}; give more "
                "readings (t_max)"
            )
        elif np.isnan(values[condition, OF_DIFFUSION[-1]]):
            why = NO_DIFFUSION
        else:
            continue
        found.append(f"{', '.join(OF_DIFFUSION)} of the {condition} are withheld: {why}")
    return found


def _edits(experiment: Experiment) -> list[str]:
    """Return what is edited in each condition that is, in the order in which it is done."""
    conditions = {"control": experiment.control, "manipulation": experiment.manipulation}
    edits = {name: condition.text() for name, condition in conditions.items()}
    return [f"{name}: {text}" for name, text in edits.items() if text]


def _cell(measure: str, value: float, low: float, high: float) -> str:
    form = ".0f" if measure.endswith("_ms") or measure == "decided" else ".3f"
    return shown(value, low, high, form)
