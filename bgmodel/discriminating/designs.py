"""The information of a trial of each task about two models, in either direction."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from itertools import product
from typing import Any, Generic, TypeVar

import numpy as np

from bgmodel.discriminating.information import (
    Information,
    Partition,
    Recorded,
    divergence,
    information,
)
from bgmodel.discriminating.space import Probe, Sessions
from bgmodel.discriminating.trials import Trials
from bgmodel.support.arrays import Array

SHIFTS_MS = np.arange(-50.0, 51.0, 10.0)
"""Non-decision times that are tried if it is free, relative to the difference of median times."""
LEAST_SURE = 1.64
"""Tasks are ranked by the lower end of a one-sided 95 % interval."""


@dataclass(frozen=True)
class Design:
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


D = TypeVar("D", Design, Sessions)


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


def shares_of(trials: Trials, probe: Probe) -> tuple[list[Probe], list[float]]:
    """Return the kinds of trials in a task, and the share of each."""
    if probe == probe.plain:
        return [probe], [1.0]
    share = trials.space.share
    return [probe.plain, probe], [1 - share, share]


def informed(trials: Trials, probe: Probe, free_time: bool) -> Iterator[TaskInformation[Design]]:
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
        yield TaskInformation(Design(probe, accuracy, deadline_ms), (directions[0], directions[1]))


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
