"""What a trial of each task tells about two models, in either direction."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import product
from typing import Any

import numpy as np

from bgmodel.discriminating.information import Information, Partition, Recorded, divergence
from bgmodel.discriminating.information import information as informed
from bgmodel.discriminating.space import Probe
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


@dataclass(frozen=True)
class Direction:
    """What a trial tells if one of the two models is true."""

    information: Information
    partitions: list[Partition]
    levels: tuple[float, float]
    shift_ms: float = 0.0

    @property
    def low(self) -> float:
        """Lower end of the information, nats."""
        return self.information.nats - LEAST_SURE * self.information.error


@dataclass(frozen=True)
class Told:
    """A task with what its trials tell, if the first or if the second model is true."""

    design: Design
    directions: tuple[Direction, Direction]

    @property
    def nats(self) -> float:
        """Information per trial, the smaller of both directions."""
        return min(one.information.nats for one in self.directions)

    @property
    def low(self) -> float:
        """Its lower end, by which tasks are ranked."""
        return min(one.low for one in self.directions)


def shares_of(trials: Trials, probe: Probe) -> tuple[list[Probe], list[float]]:
    """Return the kinds of trials in a task, and the share of each."""
    if probe == probe.plain:
        return [probe], [1.0]
    share = trials.space.share
    return [probe.plain, probe], [1 - share, share]


def told(trials: Trials, probe: Probe, free_time: bool) -> Iterator[Told]:
    """Yield the information of each task with these probes, at every accuracy and deadline."""
    kinds, shares = shares_of(trials, probe)
    every = [[trials.simulated(k, kind) for kind in kinds] for k in (0, 1)]
    known = [trials.levels(k, probe) for k in (0, 1)]
    for accuracy, deadline_ms in product(trials.space.accuracy, trials.space.deadline_ms):
        if any(accuracy not in one for one in known):
            continue

        def recorded(k: int, level: float, until: float = deadline_ms) -> list[Recorded]:
            return [one.at(level, until) for one in every[k]]

        found = []
        for k in (0, 1):
            mine, rival = known[k][accuracy], known[1 - k][accuracy]
            true = recorded(k, mine)
            levels = list(known[1 - k].values()) if trials.free else [rival]
            nearest = [(*_nearest(true, recorded(1 - k, x), shares, free_time), x) for x in levels]
            _, shift, rival = min(nearest, key=lambda one: one[0])
            other = [one.later(shift) for one in recorded(1 - k, rival)]
            found.append(Direction(*informed(true, other, shares), (mine, rival), shift))
        yield Told(Design(probe, accuracy, deadline_ms), (found[0], found[1]))


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


def row(one: Told) -> dict[str, Any]:
    """Return a task as a row of a table."""
    design = one.design
    found: dict[str, Any] = asdict(design.probe)
    found |= {"accuracy": design.accuracy, "deadline_ms": design.deadline_ms}
    for name, way in zip(("first", "second"), one.directions, strict=True):
        found[f"{name}_nats"] = way.information.nats
        found[f"{name}_error"] = way.information.error
    return found | {"nats": one.nats, "low": one.low}
