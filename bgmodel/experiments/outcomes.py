"""Outcomes of an experiment's predictions, as a table and as a page."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd

from bgmodel.bootstrap import shown
from bgmodel.deciding.measures import (
    COUNTED,
    CUT_OFF,
    DIFFUSION_S,
    MEASURES,
    NO_DIFFUSION,
    OF_ALL,
    OF_DECIDED,
    OF_DIFFUSION,
    OF_STOP,
    P_RANGE,
    SHARES,
)
from bgmodel.deciding.tradeoff import decides_without_evidence
from bgmodel.experiments.expected import (
    AGREES,
    DISAGREES,
    FEWEST_DECIDED,
    OPEN,
    PERCENT,
    WITHOUT,
    Expected,
)
from bgmodel.experiments.record import (
    CONDITIONS,
    MANY_MISSED,
    UNCHANGED,
    ExperimentRecord,
    uncalibrated,
    unchanged,
)
from bgmodel.integrators.criterion import acts_as, gain_of
from circuits.anatomy import load_circuit

VERDICTS = {
    AGREES: "agrees",
    DISAGREES: "disagrees",
    OPEN: "leaves it open",
    WITHOUT: "decides without evidence, which is no agreement",
}
"""Wording of each verdict on a page."""
SMALLER = (
    "to test what remains, make the manipulation smaller, or add the edit compensate, which "
    "restores resting rates"
)
"""Next step if the manipulated circuit decides without evidence."""
PREDICTED = ("predicted before the run", "change", "trials", "verdict")
"""Heading of the verdicts on a page."""
Judged = Callable[..., str]
"""Takes a measure and a shift of its change, in its unit, and returns the verdict."""
UNITS = (
    (("mean_ms",), "_ms: ms"),
    (("decided",), "decided: trials"),
    (("mean_posterior",), "mean_posterior: a probability"),
    (
        ("drift",),
        "drift: 1/s, boundary_separation: no unit "
        f"(EZ-diffusion, noise s = {DIFFUSION_S:g} per √s)",
    ),
    (("accuracy",), "the others: shares of trials"),
)
"""Measures, and the units that a page prints."""


def outcomes(experiment: ExperimentRecord, table: pd.DataFrame) -> pd.DataFrame:
    """Compare the measures, as in ``Outcome``, with the predictions, one row per prediction.

    Columns measure, direction, at_least, value, low, high (of the change), outcome, reason,
    control_trials and manipulation_trials (the numbers of trials behind it). The outcome is
    "agrees" if the whole interval is beyond at_least in the direction (within +-at_least for
    "none"), "disagrees" if none of it is, otherwise "left open"; "decides without evidence",
    regardless of the prediction, if most manipulated trials decide before their first reading or
    most foreperiods end in a response within half a second.

    A verdict based on decided trials is left open, with the reason, unless it holds whatever
    the missed trials would have been, alike in both conditions. For the accuracy, verdicts on
    ``accuracy_all`` and ``accuracy_best``, the two ends, must be the same; for the mean time that
    on ``mean_all_ms``, and not both conditions may miss more than ``MANY_MISSED``; for choice_0 and
    the mean posterior, those with missed trials at 0 and at 1; for the median, the shares of missed
    trials must not differ by more than ``CUT_OFF``. It is also left open if the manipulated circuit
    is correct less often than by chance, if no decision differs between the conditions, if fewer
    than ``FEWEST_DECIDED`` trials are decided, or if the control is so close to the end of a
    measure's range that no change could be as large as predicted.
    """
    by = {name: rows.set_index("measure") for name, rows in table.groupby("condition")}
    rows = []
    for p in experiment.predictions:
        estimate, outcome, why = _compared(experiment, table, p)
        trials = (by[name].loc[p.measure, "trials"] for name in CONDITIONS[:2])
        rows.append((p.measure, p.direction, p.at_least, *estimate, outcome, why, *trials))
    names = ["measure", "direction", "at_least", "value", "low", "high", "outcome", "reason"]
    return pd.DataFrame(rows, columns=[*names, *(f"{name}_trials" for name in CONDITIONS[:2])])


def beside_published(experiment: ExperimentRecord, table: pd.DataFrame) -> pd.DataFrame:
    """Return the published effects with the model's, one row per effect.

    They are "compatible" if the 95 % interval of the model's minus the published effect includes 0
    (``Expected.z``), otherwise "differs".
    """
    rows = []
    for effect in experiment.effects:
        estimate, verdict, why = _compared(experiment, table, effect)
        numbers = (effect.middle, *effect.interval, *estimate)
        where = (_condition(effect), effect.measure)
        rows.append((*where, *numbers, effect.source, verdict, why))
    names = ["condition", "measure", "published", "published_low", "published_high"]
    names += ["value", "low", "high", "effect_source", "comparison", "comparison_reason"]
    return pd.DataFrame(rows, columns=names)


def _condition(expected: Expected) -> str:
    return PERCENT if expected.unit == PERCENT else CONDITIONS[2]


def _compared(
    experiment: ExperimentRecord, table: pd.DataFrame, expected: Expected
) -> tuple[tuple[float, ...], str, str]:
    """Return the model's change with its interval, the verdict on it, and its reason."""
    by = {name: rows.set_index("measure") for name, rows in table.groupby("condition")}
    control, ours = by[CONDITIONS[0]]["value"], by[_condition(expected)]
    ours = ours[["value", "low", "high"]].astype(float).reindex([*MEASURES, *OF_STOP])

    def judged(name: str, shift: float = 0.0) -> str:
        shift *= 100 / control[name] if expected.unit == PERCENT else 1
        return expected.outcome(*(ours.loc[name].to_numpy() + shift))

    outcome, why = _verdict(experiment, table, expected.measure, judged)
    if outcome == DISAGREES and (none := _no_room(expected, control[expected.measure])):
        outcome, why = OPEN, none
    return tuple(map(float, ours.loc[expected.measure])), outcome, why


def _verdict(
    experiment: ExperimentRecord, table: pd.DataFrame, measure: str, judged: Judged
) -> tuple[str, str]:
    """Return the verdict on a measure, and the reason if something else leaves it open."""
    if _blind(experiment, table):
        return WITHOUT, ""
    if unchanged(table):
        return OPEN, UNCHANGED
    if against := _below_chance(experiment, table):
        return OPEN, against
    verdict = judged(measure)
    if measure not in OF_DECIDED or verdict == OPEN:
        return verdict, ""
    if _both(table, "decided")[1] < FEWEST_DECIDED:
        return OPEN, f"fewer than {FEWEST_DECIDED} trials of a condition are decided"
    control, manipulation = _both(table, "missed")
    lost = f"the control misses {control:.1%} of trials, the manipulation {manipulation:.1%}"
    for name, other in _of_all(table, measure, judged).items():
        if other != verdict:
            return OPEN, f"{verdict} on decided trials, {other} on all ({name}): {lost}"
    # Times of missed trials are unbounded: if both conditions have many, either may be slower.
    unbounded = measure == "mean_ms" and min(control, manipulation) > MANY_MISSED
    if unbounded or (measure == "median_ms" and abs(manipulation - control) > CUT_OFF):
        return OPEN, f"{verdict} on decided trials, unknown on all: {lost}"
    return verdict, ""


def _of_all(table: pd.DataFrame, measure: str, judged: Judged) -> dict[str, str]:
    """Return verdicts on all trials, by how missed ones count; empty if no trial is missed."""
    missed = _both(table, "missed")
    if not any(missed):
        return {}
    if measure in COUNTED or measure not in SHARES:
        return {name: judged(name) for name in COUNTED.get(measure, ())}
    control, manipulation = (
        [lost * (at - value) for at in (0, 1)]
        for lost, value in zip(missed, _both(table, measure), strict=True)
    )
    shifts = zip((0, 1), control, manipulation, strict=True)
    return {f"missed ones at {at}": judged(measure, m - c) for at, c, m in shifts}


def _no_room(prediction: Expected, control: float) -> str:
    """Return the reason why no change could be as large as predicted, or an empty string."""
    p = prediction
    room = {"down": control, "up": 1 - control if p.measure in SHARES else np.inf}
    bounded = p.measure in SHARES or p.measure.endswith("_ms")
    if not bounded or p.at_least < room.get(str(p.direction), np.inf):
        return ""
    return (
        f"at {control:.4g} the control leaves no room for a change of {p.at_least:g} {p.direction}"
    )


def _blind(experiment: ExperimentRecord, table: pd.DataFrame) -> bool:
    """Whether the manipulated circuit decides without evidence."""
    _, premature = _both(table, "premature")
    _, anticipatory = _both(table, "anticipatory")
    return decides_without_evidence(premature, anticipatory, experiment.waited_ms)


def _below_chance(experiment: ExperimentRecord, table: pd.DataFrame) -> str:
    """Return why a circuit that chooses below chance gets no verdict, or an empty string.

    If only one truth counts, a bias can move accuracy anywhere: then the posterior is used.
    """
    rows = table[table["condition"] == "manipulation"].set_index("measure")
    for name in ("accuracy", "mean_posterior")[experiment.truth is not None :]:
        value, high = rows.loc[name, ["value", "high"]].to_numpy(dtype=float)
        # Chance is at most 1/2; the number of alternatives requires reading the evidence table.
        if high < 1 / 2 and high < (chance := 1 / _channels(experiment)):
            numbers = f"{name} {value:.3f}, by chance {chance:.3g}"
            return f"the manipulation chooses against the evidence: {numbers}"
    return ""


def _channels(experiment: ExperimentRecord) -> int:
    """Return the number of alternatives."""
    if experiment.task.file is None:
        return experiment.task.channels
    return experiment.hypotheses


def _both(table: pd.DataFrame, measure: str) -> tuple[float, float]:
    """Return a measure of control and manipulation."""
    values = table[table["measure"] == measure].set_index("condition")["value"]
    return float(values["control"]), float(values["manipulation"])


def page(experiment: ExperimentRecord, table: pd.DataFrame) -> str:
    """Return an experiment and its outcome as text, 95 % intervals in brackets."""
    wide = 2 + table["measure"].str.len().max()
    lines = [
        _setting(experiment, table),
        f"{experiment.name} ({experiment.source})" if experiment.source else experiment.name,
        *([f"published: {experiment.published}"] if experiment.published else []),
        experiment.note,
        *_edits(experiment),
        "",
        *_verdicts(experiment, table),
        *_effects(experiment, table),
        "",
        "value [95 % interval, by a bootstrap over trials]",
        f"{'':<{wide}}" + "".join(f"{name:<26}" for name in CONDITIONS),
    ]
    for measure, cells in measured(table):
        lines.append(f"{measure:<{wide}}" + "".join(f"{cell:<26}" for cell in cells))
    warning = uncalibrated(experiment, table)
    lines += [
        "",
        _units(table),
        *unknown(experiment, table),
        *([warning] if warning else []),
    ]
    return "\n".join(line.rstrip() for line in lines)


def measured(table: pd.DataFrame, *, every: bool = False) -> list[tuple[str, list[str]]]:
    """Return each measure with the texts of control, manipulation and change, as on a page."""
    # Without missed trials these repeat the measures of decided ones.
    repeated = OF_ALL if not any(_both(table, "missed")) else ()
    lines = []
    rows = table[table["condition"] != PERCENT]
    names, numbers = rows["measure"].to_numpy(), rows[["value", "low", "high"]].to_numpy(float)
    for measure in dict.fromkeys(names):
        cells = numbers[names == measure]
        if every or (measure not in repeated and np.isfinite(cells[:, 0]).any()):
            lines.append((measure, [_cell(measure, *cell) for cell in cells]))
    return lines


def _setting(experiment: ExperimentRecord, table: pd.DataFrame) -> str:
    """Return task, engine, trials, gain, posterior, circuit and seed in one line."""
    gain = experiment.gain
    if gain is None:
        gain = gain_of(load_circuit(experiment.circuit, _channels(experiment)))
    trials = table.loc[table["measure"] == "missed", "trials"].iloc[0]
    return (
        f"task {experiment.task.text}; engine {experiment.engine}; {trials} trials per "
        f"condition; gain {gain:g}; posterior {experiment.stopping}; circuit "
        f"{experiment.circuit}; seed {experiment.seed}"
    )


def predicted(
    experiment: ExperimentRecord, table: pd.DataFrame
) -> tuple[list[tuple[str, ...]], list[str]]:
    """Return predictions and outcomes as the texts of a page, and why some are left open."""
    rows: list[tuple[str, ...]] = []
    reasons = []
    for row in outcomes(experiment, table).to_dict("records"):
        within = "within" if row["direction"] == "none" else "by"
        cell = _cell(row["measure"], row["value"], row["low"], row["high"])
        trials = " and ".join(f"{row[f'{name}_trials']:.0f}" for name in CONDITIONS[:2])
        asked = f"{row['measure']} {row['direction']}, {within} {row['at_least']:g}"
        rows.append((asked, cell, trials, f"the model {VERDICTS[row['outcome']]}"))
        if row["reason"]:
            reasons.append(f"{asked}: {row['reason']}")
    if any(VERDICTS[WITHOUT] in row[-1] for row in rows):
        reasons.append(SMALLER)
    return rows, reasons


def _verdicts(experiment: ExperimentRecord, table: pd.DataFrame) -> list[str]:
    """Return predictions and outcomes, one line per prediction."""
    if not experiment.predictions:
        return ["no prediction was made before the run, so there is no verdict"]
    compared, reasons = predicted(experiment, table)
    rows = [PREDICTED, *compared]
    widths = [2 + max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["".join(f"{t:<{w}}" for t, w in zip(row, widths, strict=True)) for row in rows]
    return [*lines, *reasons]


def _effects(experiment: ExperimentRecord, table: pd.DataFrame) -> list[str]:
    """Return each published effect with the model's, one line per effect."""
    lines = ["", "published effects, and the model's:"] if experiment.effects else []
    for row in beside_published(experiment, table).to_dict("records"):
        relative = row["condition"] == PERCENT
        in_ms = row["measure"].endswith("_ms")
        form = "+.1f" if relative else "+.0f" if in_ms else "+.3f"
        published = f"{row['published']:{form}}"
        if np.isfinite(row["published_low"]):
            ends = (row["published_low"], row["published_high"])
            published = shown(row["published"], *ends, form)
        model = shown(row["value"], row["low"], row["high"], form)
        told = " ".join(row["effect_source"].split())
        unit = " in %" if relative else ""
        lines.append(
            f"{row['measure']}{unit}: {published}, the model {model}: {row['comparison']} ({told})"
            + (f": {row['comparison_reason']}" if row["comparison_reason"] else "")
        )
    return lines


def _units(table: pd.DataFrame) -> str:
    """Return the units of the measures that are not NaN, as text."""
    known = set(table.loc[table["value"].notna(), "measure"])
    return "units: " + "; ".join(unit for names, unit in UNITS if {*names} & known)


def unknown(experiment: ExperimentRecord, table: pd.DataFrame) -> list[str]:
    """Return why measures of a condition are unknown, one sentence per condition and reason."""
    return [*_withheld(experiment, table), *_without_ssrt(table)]


def _withheld(experiment: ExperimentRecord, table: pd.DataFrame) -> list[str]:
    """Return why a condition has no diffusion parameters, one line per condition."""
    predicted = any(p.measure in OF_DIFFUSION for p in experiment.predictions)
    if not predicted and (experiment.task.file is not None or experiment.task.channels != 2):
        return []
    values = table.set_index(["condition", "measure"])["value"]
    lines = []
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
        lines.append(f"{', '.join(OF_DIFFUSION)} of the {condition} are withheld: {why}")
    return lines


def _without_ssrt(table: pd.DataFrame) -> list[str]:
    """Return why a condition has no stop-signal reaction time, one line per condition."""
    values = table.set_index(["condition", "measure"])["value"]
    low, high = P_RANGE
    return [
        f"ssrt_ms of the {condition} is unknown: at no delay do {low:.0%} to {high:.0%} of stop "
        "trials have a response; give other delays, or staircases"
        for condition in CONDITIONS[:2]
        if np.isnan(values.get((condition, "ssrt_ms"), 0.0))
    ]


def _edits(experiment: ExperimentRecord) -> list[str]:
    """Return the edits of each edited condition, in the order in which they are made."""
    conditions = {"control": experiment.control, "manipulation": experiment.manipulation}
    edits = {name: condition.edits.text() for name, condition in conditions.items()}
    notes = dict.fromkeys(note for one in conditions.values() for note in one.edits.notes())
    return [
        *(f"{name}: {text}" for name, text in edits.items() if text),
        *filter(None, [shift_of(experiment)]),
        *notes,
    ]


def shift_of(experiment: ExperimentRecord) -> str:
    """Return the criterion that the manipulation amounts to; empty if it is no such change."""
    channels = _channels(experiment)
    control, manipulation = (one.table(channels) for one in experiment.conditions)
    shift = acts_as(manipulation, control)
    return shift and f"the manipulation {shift}"


def _cell(measure: str, value: float, low: float, high: float) -> str:
    form = "z.0f" if measure.endswith("_ms") or measure == "decided" else "z.3f"
    return shown(value, low, high, form)
