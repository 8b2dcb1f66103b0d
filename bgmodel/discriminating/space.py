"""The space of tasks, and the search for the task that separates two models."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from bgmodel.support import toml_files
from bgmodel.support.checks import check_positive, check_range, whole
from bgmodel.task import Gaussian
from circuits.declaration.edits import Edits
from circuits.errors import DataWarning, InputError, require

SHIPPED = Path(__file__).with_name("shipped")
OF_CIRCUITS = ("stop_nats", "edits")
"""Axes that only circuits have: tests have no nuclei."""
PROBED = ("channels", "d_prime", "conflict", *OF_CIRCUITS)
"""Axes for whose values trials are simulated; accuracies and deadlines are read from the same
trials."""
AXES = (*PROBED, "accuracy", "deadline_ms")
Place = tuple[int, ...]
POPULATION = 16
"""Places with which a search begins, spread evenly (Sobol)."""


@dataclass(frozen=True)
class Probe:
    """Trials to be simulated: what differs from plain trials, and what both have in common."""

    channels: int
    d_prime: float
    conflict: float = 0.0
    stop_nats: float = 0.0
    edits: str = ""

    @property
    def plain(self) -> Probe:
        """The plain trials that are interleaved with it."""
        return Probe(self.channels, self.d_prime)

    def text(self) -> str:
        """Return the probe in a few words."""
        parts = [f"N = {self.channels}", f"d' {self.d_prime:g}"]
        if self.conflict:
            parts.append(f"conflict {self.conflict:g}")
        if self.stop_nats:
            parts.append(f"stop signal {self.stop_nats:g} nats")
        return ", ".join([*parts, *self.lines])

    @property
    def lines(self) -> tuple[str, ...]:
        """The manipulation, as lines of edits."""
        return split(self.edits)


@dataclass(frozen=True, kw_only=True)
class Space:
    """The values of each axis that are tried, and what all tasks have in common.

    Half of the trials are plain, and half are probes with conflict, a stop signal or a manipulation
    (``share``). Both are decided at one threshold, which is set by the accuracy of plain trials.

    Raises
    ------
    ValueError
        For an axis that is empty, has a value twice or out of range, or an edit that is none.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = toml_files.STRICT
    axis_names: ClassVar[tuple[str, ...]] = AXES
    unit: ClassVar[str] = "task"

    channels: tuple[int, ...] = (2,)
    """Numbers of alternatives."""
    d_prime: tuple[float, ...] = (0.5,)
    """Discriminability per reading."""
    accuracy: tuple[float, ...] = (0.85,)
    """Accuracy of plain trials without a deadline, at which the threshold is set."""
    deadline_ms: tuple[float, ...] = (4000.0,)
    """Deadline of the decision, ms."""
    conflict: tuple[float, ...] = (0.0,)
    """Mean of one competitor relative to that of the truth, in probe trials."""
    stop_nats: tuple[float, ...] = (0.0,)
    """Stop signal to STN in probe trials, nats; 0 is none."""
    edits: tuple[str, ...] = ("",)
    """Manipulations of both circuits in probe trials; "" is none, and ";" joins several."""
    share: float = 0.5
    """Share of probe trials, if probes differ from plain trials."""
    stop_delay_ms: float = 200.0
    """Time of the stop signal from the onset of evidence, ms."""
    step_ms: float = 50.0
    """Time between readings, ms."""
    non_decision_sd_ms: float = 30.0
    """Standard deviation of the non-decision time, which is added to the times of both models."""

    def __post_init__(self) -> None:
        for name in AXES:
            values = getattr(self, name)
            require(len(values) > 0, name, "must have at least one value", values)
            once = len(set(values)) == len(values)
            require(once, name, "must not have a value twice, which is no difference", values)
        # 1 and 1.0 are one d', but other names of random numbers.
        object.__setattr__(self, "d_prime", tuple(map(float, self.d_prime)))
        object.__setattr__(self, "channels", tuple(whole("channels", n, 2) for n in self.channels))
        check_positive(step_ms=self.step_ms)
        for name, low, high in (
            *(("d_prime", 1e-3, 10), ("conflict", 0, 0.999), ("stop_nats", 0, 2)),
            *(("accuracy", 0.5, 0.999), ("deadline_ms", self.step_ms, 60_000)),
        ):
            for value in getattr(self, name):
                check_range(low, high, **{name: value})
        require(0 < self.share < 1, "share", "must be between 0 and 1", self.share)
        check_range(0, 1000, non_decision_sd_ms=self.non_decision_sd_ms)
        check_range(0, self.longest_ms, stop_delay_ms=self.stop_delay_ms)
        for name in ("non_decision_sd_ms", "stop_delay_ms"):
            if 0 < (value := getattr(self, name)) < 1:
                DataWarning.warn(f"{name} is {value:g}: is it in seconds?")
        for text in self.edits:
            Edits(split(text))

    @classmethod
    def from_toml(cls, path: str | Path) -> Space:
        """Read a space from a TOML file."""
        return toml_files.read(path, cls)

    @classmethod
    def shipped(cls) -> Space:
        """Return the space that ships with the package."""
        return cls.from_toml(SHIPPED / "default.toml")

    @property
    def longest_ms(self) -> float:
        """The latest deadline, ms."""
        return max(self.deadline_ms)

    @property
    def readings(self) -> int:
        """Readings up to the latest deadline."""
        return math.ceil(self.longest_ms / self.step_ms)

    def task(self, probe: Probe, trials: int, readings: int | None = None) -> Gaussian:
        """Return the task of some trials; by default with readings up to the latest deadline."""
        return Gaussian(
            probe.channels, probe.d_prime, probe.conflict, trials=trials,
            t_max=readings or self.readings, step_ms=self.step_ms,
        )  # fmt: skip

    def axes(self) -> dict[str, tuple[Any, ...]]:
        """Return the values of every axis for which trials are simulated."""
        return {name: getattr(self, name) for name in PROBED}

    def of_tests(self) -> Space:
        """Return the part of the space in which tests can be: without nuclei."""
        return replace(self, stop_nats=(0.0,), edits=("",))

    def without(self, text: str) -> Space:
        """Return the space without one manipulation."""
        others = tuple(each for each in self.edits if each != text)
        return replace(self, edits=others or ("",))


@dataclass(frozen=True)
class Sessions:
    """Sessions of recorded cells, in place of a space of tasks: their names, cells and trials."""

    axis_names: ClassVar[tuple[str, ...]] = ("session",)
    unit: ClassVar[str] = "session"

    session: tuple[str, ...]
    cells: tuple[int, ...]
    trials: tuple[int, ...]

    def text(self) -> str:
        """Return the sessions in one line."""
        number, cells = len(self.session), sum(self.cells)
        where = f"session {self.session[0]}" if number == 1 else f"{number} sessions"
        return f"{where}, {cells} cell{'s' * (cells > 1)}, {sum(self.trials)} recorded trials"

    def each(self) -> Iterator[Sessions]:
        """Yield every session alone."""
        for name, cells, trials in zip(self.session, self.cells, self.trials, strict=True):
            yield Sessions((name,), (cells,), (trials,))

    def row(self) -> dict[str, Any]:
        """Return the values of a session in a table."""
        return {"session": self.session[0], "cells": self.cells[0], "trials": self.trials[0]}


def split(text: str) -> tuple[str, ...]:
    """Return the lines of a manipulation."""
    return tuple(line.strip() for line in text.split(";") if line.strip())


def check_space(space: Space | str | Path | None) -> Space:
    """Return a space, given as such, as a TOML file, or by default the shipped one."""
    if isinstance(space, Space):
        return space
    if space is None:
        return Space.shipped()
    if isinstance(space, (str, Path)):
        return Space.from_toml(space)
    raise InputError.of("space", "must be a Space or a .toml file", space)


def search(
    sizes: Sequence[int], score: Callable[[Place], float], *, evaluations: int, seed: int
) -> dict[Place, float]:
    """Return the score of each place of a grid that was tried; the best is the largest.

    Differential evolution (Storn & Price 1997; ``scipy.optimize``) begins with a Sobol sequence,
    which spreads the first places over the space, so that they are a map of it, and needs neither
    gradients nor scores without noise.
    """
    known: dict[Place, float] = {}
    if np.prod(sizes) <= evaluations:
        for place in np.ndindex(*sizes):
            known[place] = score(place)
        return known
    from scipy.optimize import differential_evolution
    from scipy.stats import qmc

    def cost(where: np.ndarray) -> float:
        place = tuple(round(float(x)) for x in where)
        if place not in known and len(known) < evaluations:
            known[place] = score(place)
        return -known.get(place, -np.inf) if np.isfinite(known.get(place, -np.inf)) else 1e9

    unit = qmc.Sobol(len(sizes), rng=np.random.default_rng(seed)).random(POPULATION)
    differential_evolution(
        cost, [(0, size - 1 + 1e-9) for size in sizes], integrality=np.ones(len(sizes), dtype=bool),
        init=np.floor(unit * np.asarray(sizes)), maxiter=50, polish=False, tol=0,
        callback=lambda *_: len(known) >= evaluations, rng=np.random.default_rng(seed),
    )  # fmt: skip
    return known
