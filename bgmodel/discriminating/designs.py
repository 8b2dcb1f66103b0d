"""The information of a trial of each task about two models, and the best task as an experiment."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar

import numpy as np

from bgmodel.discriminating.information import (
    CORRECT,
    MISSED,
    Information,
    Partition,
    Recorded,
    divergence,
    information,
)
from bgmodel.discriminating.space import Probe, Sessions, Space
from bgmodel.discriminating.trials import PairedTrials
from bgmodel.experiments.expected import Expected
from bgmodel.experiments.experiment import Experiment
from bgmodel.experiments.models import DecisionModel
from bgmodel.experiments.record import Changes
from bgmodel.names import CircuitName, EngineName
from bgmodel.stopping.task import StopTask
from circuits.anatomy import checked_circuit
from circuits.arrays import Array
from circuits.declaration.edits import Edits
from circuits.declaration.table_writer import is_path
from circuits.differences import differences
from circuits.errors import InputError, quiet

SHIFTS_MS = np.arange(-50.0, 51.0, 10.0)
"""Non-decision times that are tried if it is free, relative to the difference of median times."""
LEAST_SURE = 1.64
"""Tasks are ranked by the lower end of a one-sided 95 % interval."""


@dataclass(frozen=True)
class TaskDesign:
    """One task: its probes, the accuracy that sets thresholds, and its deadline."""

    probe: Probe
    accuracy: float
    deadline_ms: float

    def text(self) -> str:
        """Return the task in one line."""
        rest = f"accuracy {self.accuracy:g}, deadline {self.deadline_ms:g} ms"
        return f"{self.probe.text()}; {rest}"

    def row(self) -> dict[str, Any]:
        """Return its value on each axis."""
        values: dict[str, Any] = asdict(self.probe)
        return values | {"accuracy": self.accuracy, "deadline_ms": self.deadline_ms}


D = TypeVar("D", TaskDesign, Sessions)


@dataclass(frozen=True)
class Direction:
    """The information of a trial if one of the two models is true.

    ``partitions`` are the bins of each kind of trials, ``levels`` the thresholds of the true and of
    the other model, ``shift_ms`` the other's non-decision time less that of the true one; of
    recorded cells there are none.
    """

    information: Information
    partitions: list[Partition] = field(default_factory=list)
    levels: tuple[float, float] = (np.nan, np.nan)
    shift_ms: float = 0.0

    @property
    def low(self) -> float:
        """Lower end of the information, nats."""
        return self.information.nats - LEAST_SURE * self.information.error


@dataclass(frozen=True)
class TaskInformation(Generic[D]):
    """A task, or sessions, with the information of a trial, if either model is true."""

    design: D
    directions: tuple[Direction, Direction]

    @property
    def nats(self) -> float:
        """Information per trial, the smaller of both directions."""
        return min(direction.information.nats for direction in self.directions)

    @property
    def low(self) -> float:
        """Its lower end, by which tasks are ranked."""
        return min(direction.low for direction in self.directions)


def shares_of(trials: PairedTrials, probe: Probe) -> tuple[list[Probe], list[float]]:
    """Return the kinds of trials in a task, and the share of each."""
    if probe == probe.plain:
        return [probe], [1.0]
    share = trials.space.share
    return [probe.plain, probe], [1 - share, share]


def informed(
    trials: PairedTrials, probe: Probe, free_time: bool
) -> Iterator[TaskInformation[TaskDesign]]:
    """Yield the information of each task with these probes, at every accuracy and deadline.

    With ``free_time`` the other model has the non-decision time that is hardest to tell apart.
    """
    kinds, shares = shares_of(trials, probe)
    simulated = [[trials.simulated(k, kind) for kind in kinds] for k in (0, 1)]
    levels = [trials.levels(k, probe) for k in (0, 1)]
    for accuracy, deadline_ms in product(trials.space.accuracy, trials.space.deadline_ms):
        if any(accuracy not in each for each in levels):
            continue

        def recorded(k: int, level: float, until: float = deadline_ms) -> list[Recorded]:
            return [each.at(level, until) for each in simulated[k]]

        directions = []
        for k in (0, 1):
            level = levels[k][accuracy]
            true = recorded(k, level)
            tried = list(levels[1 - k].values()) if trials.free else [levels[1 - k][accuracy]]
            nearest = [(*_nearest(true, recorded(1 - k, x), shares, free_time), x) for x in tried]
            _, shift, rival = min(nearest, key=lambda each: each[0])
            other = [each.later(shift) for each in recorded(1 - k, rival)]
            directions.append(Direction(*information(true, other, shares), (level, rival), shift))
        yield TaskInformation(
            TaskDesign(probe, accuracy, deadline_ms), (directions[0], directions[1])
        )


def _nearest(
    true: list[Recorded], other: list[Recorded], shares: list[float], free_time: bool
) -> tuple[float, float]:
    """Return the divergence from a rival, and the shift of its times at which it is smallest."""
    if not free_time:
        return divergence(true, other, shares), 0.0
    middle = _median(true[0]) - _median(other[0])
    tried = []
    for shift in middle + SHIFTS_MS:
        tried.append((divergence(true, [o.later(shift) for o in other], shares), float(shift)))
    return min(tried)


def _median(one: Recorded) -> float:
    times: Array = one.time_ms[one.choice == 0]
    return float(np.median(times)) if len(times) else 0.0


def row(task: TaskInformation[D]) -> dict[str, Any]:
    """Return a task as a row of a table."""
    values = task.design.row()
    for name, direction in zip(("first", "second"), task.directions, strict=True):
        values[f"{name}_nats"] = direction.information.nats
        values[f"{name}_error"] = direction.information.error
    return values | {"nats": task.nats, "low": task.low}


FEWEST, MOST = 400, 4000
"""Trials of an experiment per condition: four times the median that is needed, within these."""
PREDICTED = 1000
"""Trials from which changes are predicted."""
CLEAR = 3.0
"""A change is predicted if it is larger than this many standard errors."""


def planned(
    models: tuple[DecisionModel, DecisionModel],
    check: TaskInformation[TaskDesign],
    space: Space,
    median: float,
    verdict: str,
    seed: int,
    folder: str | Path = ".",
) -> Experiment:
    """Return the best task as an experiment: the second model against the first."""
    probe, design = check.design.probe, check.design
    first, second = models = models[0], edited_from(*models, channels=probe.channels)
    _check_order(models, probe)
    levels = [way.levels[0] for way in check.directions]
    if min(levels) <= 0:
        reason = "the threshold of a model is not a posterior: OUT at its decision is 0 or less"
        raise InputError(reason, "second")
    stop = None
    if probe.stop_nats:
        delays = (space.stop_delay_ms,)
        stop = StopTask(amount_nats=probe.stop_nats, share=space.share, delays_ms=delays)
    control, manipulation = (
        Changes(edits=one.edits, posterior=round(float(np.exp(-level)), 4))
        for one, level in zip(models, levels, strict=True)
    )
    trials = int(np.clip(np.ceil(4 * median), FEWEST, MOST)) if np.isfinite(median) else MOST
    # The circuit's trials end a step after the last reading.
    readings = max(1, round(design.deadline_ms / space.step_ms) - 1)
    circuit = first.source
    if is_path(circuit):
        circuit = os.path.relpath(circuit, folder)
    return Experiment(
        name=f"{second.name} against {first.name}",
        note=f"Planned by bg.discriminate: {verdict}. These are the probe trials of the best "
        f"task ({design.text()}); each condition has its matched threshold.",
        circuit=CircuitName(circuit),
        edits=Edits(probe.lines),
        engine=EngineName(first.engine or "population"),
        seed=seed + 2,
        task=space.task(probe, trials, readings),
        stop=stop,
        control=control,
        manipulation=manipulation,
        predictions=_predictions(PairedTrials(models, space, seed, PREDICTED), check),
    )  # fmt: skip


def edited_from(
    first: DecisionModel, second: DecisionModel, channels: int | None = None
) -> DecisionModel:
    """Return the second model as edits of the first one's circuit, before the edits of either."""
    for model in (first, second):
        if not model.source:
            reason = "an experiment changes one circuit, given by name or file"
            raise InputError(f"{reason}, which {model.name} is not", "second")
    if first.source == second.source:
        return second
    circuits = [checked_circuit(model.source, channels) for model in (first, second)]
    edits = Edits([*differences(*circuits), *second.edits])
    return replace(second, source=first.source, edits=edits)


def _check_order(models: tuple[DecisionModel, DecisionModel], probe: Probe) -> None:
    """Raise ValueError if one list of edits would not do what was done one after the other."""
    if probe.edits and any(one.edits.compensates for one in models):
        raise InputError(
            "in one list of edits compensation comes last, and would undo the manipulation "
            f"({probe.edits}) of a model that has compensated before",
            "edits",
        )


def _predictions(trials: PairedTrials, check: TaskInformation[TaskDesign]) -> tuple[Expected, ...]:
    """Return the changes of probe trials that are clear, half of each as the least."""
    design = check.design
    with quiet():
        first, second = (
            trials.simulated(k, design.probe).at(way.levels[0], design.deadline_ms)
            for k, way in enumerate(check.directions)
        )
    made = []
    for name, (control, manipulation) in _measures(first, second, design.probe).items():
        if (size := _clear(control, manipulation)) is not None:
            way: Literal["up", "down"] = "up" if size > 0 else "down"
            made.append(Expected(name, way, float(f"{abs(size) / 2:.1g}")))
    return tuple(made)


def _measures(first: Recorded, second: Recorded, probe: Probe) -> dict[str, tuple[Array, Array]]:
    """Return the values of each measure in the trials of both models; NaN where it is undefined."""
    both = first, second
    missed = [one.choice == MISSED for one in both]
    if probe.stop_nats:
        return {"p_respond": (1.0 - missed[0], 1.0 - missed[1])}
    right = [
        np.where(gone, np.nan, m.choice == CORRECT) for gone, m in zip(missed, both, strict=True)
    ]
    times = [np.where(gone, np.nan, m.time_ms) for gone, m in zip(missed, both, strict=True)]
    return {
        "accuracy": (right[0], right[1]),
        "mean_ms": (times[0], times[1]),
        "missed": (missed[0] + 0.0, missed[1] + 0.0),
    }


def _clear(first: Array, second: Array) -> float | None:
    """Return the change from the first to the second, or None if it is within the error."""
    change = float(np.nanmean(second) - np.nanmean(first))
    errors = [np.nanstd(x) / np.sqrt(max(1, np.isfinite(x).sum())) for x in (first, second)]
    error = float(np.hypot(*errors))
    return change if abs(change) > CLEAR * error else None
