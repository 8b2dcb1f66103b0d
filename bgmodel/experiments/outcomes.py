"""What an experiment's run says of its predictions, as a table and as a page."""

from __future__ import annotations

import pandas as pd

from bgmodel.comparison.compare import reads_nothing, shown
from bgmodel.experiments.experiment import (
    AGREES,
    CONDITIONS,
    DISAGREES,
    FEWEST_DECIDED,
    OPEN,
    WITHOUT,
    Experiment,
)
from bgmodel.experiments.measures import CUT_OFF, DIFFUSION_S, OF_DECIDED, OF_DIFFUSION

VERDICTS = {
    AGREES: "agrees",
    DISAGREES: "disagrees",
    OPEN: "leaves it open",
    WITHOUT: "decides without evidence, which is no agreement",
}
"""What a page says of the model."""
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
        +-at_least for "none"), "disagrees" if none of it does, else "not decidable"; "decides
        without evidence", whatever was predicted, if most manipulated trials decide before their
        first reading or most foreperiods end in a response within half a second. Where fewer than
        ``FEWEST_DECIDED`` trials are decided, what is said of decisions is not decidable.
    """
    manipulated = table[table["condition"] == "manipulation"].set_index("measure")["value"]
    blind = reads_nothing(
        manipulated["premature"], manipulated["anticipatory"], experiment.foreperiod_ms
    )
    few = manipulated["decided"] < FEWEST_DECIDED
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
        f"{experiment.name} ({experiment.source})",
        f"published: {experiment.published}",
        experiment.note,
        *_edits(experiment),
        "",
        "value [95 % interval, by a bootstrap over trials]",
        f"{'':<16}" + "".join(f"{name:<26}" for name in CONDITIONS),
    ]
    for measure in table["measure"].unique():
        rows = table[table["measure"] == measure]
        if rows["value"].notna().any():
            cells = rows[["value", "low", "high"]].to_numpy()
            lines.append(f"{measure:<16}" + "".join(f"{_cell(measure, *c):<26}" for c in cells))
    lines += ["", _units(table), *_withheld(experiment, table), "", "predicted before the run:"]
    for measure, direction, at_least, *found, outcome in outcomes(experiment, table).to_numpy():
        by = "to within" if direction == "none" else "by"
        lines.append(
            f"{measure} {direction}, {by} {at_least:g}: the model {VERDICTS[outcome]} "
            f"({_cell(measure, *found)})"
        )
    return "\n".join(line.rstrip() for line in lines)


def _units(table: pd.DataFrame) -> str:
    """Return the units of the measures that are known, as text."""
    known = set(table.loc[table["value"].notna(), "measure"])
    return "units: " + "; ".join(unit for names, unit in UNITS if {*names} & known)


def _withheld(experiment: Experiment, table: pd.DataFrame) -> list[str]:
    """Return why a condition has no diffusion's parameters, a line per condition."""
    predicted = any(p.measure in OF_DIFFUSION for p in experiment.predictions)
    if not predicted and (experiment.task.evidence is not None or experiment.task.channels != 2):
        return []
    missed = table[table["measure"] == "missed"].set_index("condition")["value"]
    return [
        f"{', '.join(OF_DIFFUSION)} of the {condition} are withheld: the deadline cuts off "
        f"{missed[condition]:.1%} of trials, more than {CUT_OFF:.0%}; give more readings (t_max)"
        for condition in CONDITIONS[:2]
        if missed[condition] > CUT_OFF
    ]


def _edits(experiment: Experiment) -> list[str]:
    """Return what is edited in each condition that is, in the order in which it is done."""
    conditions = {"control": experiment.control, "manipulation": experiment.manipulation}
    edits = {name: condition.text() for name, condition in conditions.items()}
    return [f"{name}: {text}" for name, text in edits.items() if text]


def _cell(measure: str, value: float, low: float, high: float) -> str:
    form = ".0f" if measure.endswith("_ms") or measure == "decided" else ".3f"
    return shown(value, low, high, form)
