"""The file of a sweep: what is run, which numbers change, and the resulting points."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cache, cached_property
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from bgmodel.conditions import Observed, circuit_seen_from, seen_from
from bgmodel.deciding.measures import MEASURES, OF_STOP
from bgmodel.integrators.criterion import fitting_gain, gain_of, largest_lead, lead_of
from bgmodel.stopping.task import StopTask
from bgmodel.support import files, toml_files
from bgmodel.support.checks import path_of
from bgmodel.support.seeds import stream
from bgmodel.tactile.source import SHIPPED, Tactile
from bgmodel.task import Gaussian, Task, kind_of, settings_of_tasks
from bgmodel.trials.named_evidence import NamedEvidence
from bgmodel.trials.task_trials import EvidenceTable, read_once, trials_of
from circuits.circuit import Circuit
from circuits.declaration.edits import VERBS, Edits, parsed
from circuits.declaration.table_writer import identity
from circuits.errors import InputError, require, within

BLOCK = 10_000
"""Largest number of trials in a shard: seconds of the population engine, minutes of spikes."""
OF_LEAD = 1000
"""Number of trials of a sweep to whose mean lead its gain is fitted."""
TASK, STOP = "task.", "stop."
Value = bool | int | float | str


@dataclass(frozen=True)
class Point(Observed):
    """One point of a sweep: all that its decisions depend on."""

    task: Task = field(default_factory=lambda: Gaussian(trials=1000))
    """The task, with the number of `trials` at each point."""

    @cached_property
    def edited(self) -> Circuit:
        """The edited circuit for this task's alternatives."""
        return super().edited

    @cached_property
    def used_gain(self) -> float:
        """The gain of all shards: given, or fitted to the first trials."""
        gain = gain_of(self.edited, self.gain)
        if self.gain is not None or largest_lead(self.edited) == math.inf:
            return gain
        seed = self.block_seed(0)
        return fitting_gain(gain, largest_lead(self.edited), lead_of_task(self.task, seed))

    @property
    def steps(self) -> int:
        """Number of readings of the longest trial."""
        return self.task.t_max

    def block(self, first: int, trials: int) -> NamedEvidence:
        """Return the trials of a block."""
        if isinstance(self.task, EvidenceTable):
            every = read_once(self.task)
            numbers = np.arange(every.evidence.trials)
            return every.where((numbers >= first) & (numbers < first + trials))
        return trials_of(self.task.changed(trials=trials), self.block_seed(first), "sweep")

    def block_seed(self, first: int) -> int:
        """Return the seed of evidence and noise for the block that begins with trial ``first``."""
        return int(stream(self.seed, "sweep", first).integers(2**62))

    def shards(self) -> list[Shard]:
        """Return the shards: blocks of trials to compute."""
        return [
            Shard(self, first, min(BLOCK, self.trials - first))
            for first in range(0, self.trials, BLOCK)
        ]


@cache
def lead_of_task(task: Task, seed: int) -> float:
    """Return the lead of the first trials of a sweep, which points with one task share."""
    if not isinstance(task, EvidenceTable):
        task = task.changed(trials=min(task.trials, OF_LEAD))
    return lead_of(trials_of(task, seed, "sweep").evidence)


OWN = tuple(f.name for f in fields(Point) if f.name not in ("task", "edits", "stop"))


def measures_of(point: Point) -> list[str]:
    """Return the names of the measures of a point, or of all points of a plan."""
    keys = point.each[0] if isinstance(point, Plan) else ()
    stops = point.stop is not None or any(key.startswith(STOP) for key in keys)
    return [*MEASURES, *(OF_STOP if stops else ())]


@dataclass(frozen=True)
class Shard:
    """A block of trials of one point, computed and stored as a unit."""

    point: Point
    first: int
    trials: int

    @cached_property
    def key(self) -> dict[str, Any]:
        """All that its numbers depend on."""
        of = self.point
        task = {**of.task.used(), "trials": self.trials}
        if isinstance(of.task, EvidenceTable):
            task["evidence"] = files.checksum(of.task.file)
        elif isinstance(of.task, Tactile):
            task["taps"] = files.checksum(of.task.taps or SHIPPED)
        return {
            "circuit": identity(of.edited),
            "engine": of.engine,
            "gain": of.used_gain,
            "posterior": of.stopping_posterior,
            **({} if of.threshold is None else {"threshold": of.threshold}),
            "foreperiod_ms": of.foreperiod_ms,
            **({} if of.stop is None else {"stop": of.stop.used()}),
            "seed": of.seed,
            "task": task,
            "first": self.first,
        }

    @property
    def name(self) -> str:
        """Its key as text."""
        return json.dumps(self.key, sort_keys=True)


@dataclass(frozen=True)
class Plan(Point):
    """A sweep: shared settings, and the values that change from point to point.

    A key of ``grid`` or ``points`` is a field of ``Point``, a field of its task such as
    ``task.d_prime`` or of its stop signals such as ``stop.amount_nats``, or an edit without its
    value: ``lesion STN``, ``scale STN->GPe``, ``set STN.bias_nats``, ``dopamine``. It replaces the
    same edit in ``edits``; a key that would change the same number as another edit, such as a
    factor on a weight that is set, is refused. A key that is a complete edit takes the values true
    and false: the edit is made, or not.
    """

    name: str = ""
    """The question in a few words."""
    grid: dict[str, tuple[Value, ...]] | None = None
    """Values by key: every combination is a point; the last key changes fastest."""
    points: tuple[dict[str, Value], ...] = ()
    """A list of points, instead of a grid; all have the same keys."""
    show: tuple[str, ...] = ("accuracy", "mean_ms", "missed")
    """Measures to draw."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if bool(self.grid) == bool(self.points):
            raise InputError("a sweep needs either [grid] or [[points]]: say what changes", "grid")
        if any(len(values) < 1 for values in (self.grid or {}).values()):
            raise InputError("each key of grid needs one value or more", "grid", self.grid)
        if any(set(point) != set(self.points[0]) or not point for point in self.points):
            raise InputError("all points must name the same keys, one or more", "points")
        self._check_once()
        for measure in self.show:
            every = measures_of(self)
            require(measure in every, "show", f"must name {', '.join(every)}", measure)

    def _check_once(self) -> None:
        """Refuse a key in two spellings, and a value or a point given twice."""
        names = [key.strip() for key in self.grid or self.points[0]]
        for name in names:
            if names.count(name) > 1:
                raise InputError(f"each key may be given once, got {name!r} in two spellings", name)
        for key, values in (self.grid or {}).items():
            if len(set(values)) < len(values):
                raise InputError(f"each value may be given once, got {key} = {list(values)}", key)
        if len({frozenset(point.items()) for point in self.points}) < len(self.points):
            raise InputError("each point may be given once, got one of them twice", "points")

    @cached_property
    def each(self) -> tuple[dict[str, Value], ...]:
        """The values of every point, by key."""
        if not self.grid:
            return self.points
        return tuple(dict(zip(self.grid, v, strict=True)) for v in product(*self.grid.values()))

    @property
    def axes(self) -> dict[str, list[Value]]:
        """The values of every key that changes, in order of first appearance."""
        return {key: list(dict.fromkeys(p[key] for p in self.each)) for key in self.each[0]}

    def all_points(self, folder: Path = Path()) -> list[Point]:
        """Return every point; relative paths are seen from a folder.

        A ValueError names the point at which a key or a value has no effect, and two points that
        are the same although written differently, such as a lesion of 0.1 and of 10%.
        """
        same = {f.name: getattr(self, f.name) for f in fields(Point)}
        points = [_point(Point(**same), point, folder) for point in self.each]
        seen: dict[object, Mapping[str, Value]] = {}
        for point, values in zip(points, self.each, strict=True):
            edits = frozenset((edit.place, edit.value) for edit in point.edits.parsed())
            first = seen.setdefault((replace(point, edits=Edits()), edits), values)
            if first is not values:
                same_run = f"{point_text(first)!r} and {point_text(values)!r} are the same point"
                raise InputError(f"{same_run}: give each once", "points")
        return points


def _point(same: Point, point: Mapping[str, Value], folder: Path) -> Point:
    owner = f"the point {point_text(point)}"
    try:
        values = _values(same, point, folder)
    except ValueError as error:
        raise within(owner, error, "points") from None
    point_read = toml_files.decoded(values, Point, owner)
    try:
        point_read.check()
    except ValueError as error:
        raise within(owner, error, "points") from None
    return point_read


def _values(same: Point, point: Mapping[str, Value], folder: Path) -> dict[str, Any]:
    """Return the fields of a point, as in a file."""
    values = asdict(same) | {"task": same.task.settings()}
    other = "table" if "task.evidence" in point else point.get("task.name", same.task.name)
    if other != same.task.name:
        has = [each.name for each in fields(kind_of(str(other)))]
        values["task"] = {k: v for k, v in values["task"].items() if k in has}
    values["stop"] = None if same.stop is None else same.stop.used()
    made: list[str] = []
    left_out: list[str] = []
    for key, value in point.items():
        key = key.strip()
        if key == "circuit":
            value = circuit_seen_from(folder, str(value))
        elif key in ("task.evidence", "task.taps"):
            value = str(folder / str(value))
        if key.startswith(TASK):
            values["task"][key.removeprefix(TASK)] = value
        elif key.startswith(STOP):
            values["stop"] = {**(values["stop"] or {}), key.removeprefix(STOP): value}
        elif key in OWN:
            values[key] = value
        elif isinstance(value, bool) and _is_whole(key):
            (made if value else left_out).append(key)
        else:
            made.append(_line(key, value))
    return values | {"edits": same.edits.replacing(made, left_out)}


def _is_whole(key: str) -> bool:
    """Whether a key is a complete edit, such as "compensate" or "lesion STN"."""
    try:
        return bool(parsed(key))
    except ValueError:
        return False


def _line(key: str, value: Value) -> str:
    """Return the edit of a key and its value; ValueError unless it begins with a verb."""
    verb = key.partition(" ")[0]
    if verb not in VERBS:
        of_task = [f"{TASK}{name}" for name in settings_of_tasks()]
        of_stop = [f"{STOP}{f.name}" for f in fields(StopTask)]
        every = ", ".join((*OWN, *of_task, *of_stop))
        raise InputError(
            f"there is no {key!r} to change; there are {every}, and edits, "
            f"which begin with {', '.join(VERBS)}, such as 'lesion STN'",
            key,
        )
    return f"{key}{'=' if verb == 'add' else ' '}{value}"


def point_text(point: Mapping[str, Value]) -> str:
    """Return a point as text."""
    return ", ".join(f"{key} = {value}" for key, value in point.items())


def read_plan(file: str | Path) -> Plan:
    """Read the file of a sweep."""
    path = path_of(file, "file")
    if path.suffix != ".toml":
        raise InputError(f"a sweep is a .toml file, got {str(file)!r}", "file", file)
    return seen_from(path.parent, toml_files.read(path, Plan))
