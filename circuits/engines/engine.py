"""Base classes of engines, records with options and capabilities, and the registry of engines."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Self, TypeVar, overload

import numpy as np
import numpy.typing as npt

from circuits.activity import Activity, checked_drive
from circuits.arrays import Array
from circuits.cells import CELLS
from circuits.checks import (
    check_free,
    check_kind,
    check_positive,
    check_range,
    check_types,
    is_whole,
)
from circuits.declaration.rows import OF_CELLS
from circuits.declaration.table import CircuitTable
from circuits.dynamics.ticks import TICK_MS, Clock, tick_ms
from circuits.dynamics.wiring import Wiring
from circuits.engines.stream import Stream
from circuits.errors import InputError, require


@dataclass(frozen=True, kw_only=True, repr=False)
class Engine:
    """Base class of all engines: a frozen record whose fields are the engine's options.

    A new engine derives from this class, or from ``TimedEngine`` or ``SpikingEngine``, sets ``id``
    and ``description``, declares its options as fields with defaults, and implements ``run``. The
    class variables describe its capabilities, and no other code distinguishes engines. The
    decorator ``register`` adds it to the registry.
    """

    id: ClassVar[str]  #: Name under which it is registered: ``engine="rate"``, ``--engine rate``.
    description: ClassVar[str]  #: One-line description.
    module: ClassVar[str]
    """Module with the implementation, ``run``, imported only when the engine runs. Not needed by
    an engine that overrides ``run``."""
    timed: ClassVar[bool] = True
    """Whether rates take time to change; a fixed point has no time constants and no delays."""
    spiking: ClassVar[bool] = False
    """Whether cells fire one by one, so that spikes can be recorded."""
    sparse: ClassVar[bool] = False
    """Whether connections can differ between cells (``probability`` below 1)."""
    threaded: ClassVar[bool] = False
    """Whether it is compiled and can run trials in several threads, stop a decided trial, and omit
    rates."""

    @property
    def noisy(self) -> bool:
        """Whether the result depends on the seed; if so, a run needs one."""
        return False

    @property
    def rates(self) -> bool:
        """Whether rates are recorded."""
        return True

    @property
    def sample_ms(self) -> float:
        """Time between samples of OUT, ms; an engine without time has one per reading."""
        return 1.0

    def __post_init__(self) -> None:
        check_types(self, f"the {self.id} engine")

    def __str__(self) -> str:
        return self.id

    def __repr__(self) -> str:
        text = ", ".join(f"{name}={value!r}" for name, value in self.changed().items())
        return f"{type(self).__name__}({text})"

    def changed(self) -> dict[str, object]:
        """Return the options that differ from their defaults."""
        values = {f.name: (getattr(self, f.name), f.default) for f in fields(self)}
        return {name: value for name, (value, default) in values.items() if value != default}

    def run(
        self,
        circuit: CircuitTable,
        drive: npt.ArrayLike,
        *,
        step_ms: float,
        seed: int | None = None,
        first_trial: int = 0,
    ) -> Activity:
        """Run a circuit.

        Parameters
        ----------
        circuit : Circuit
            The table.
        drive : array (trials, steps, channels), nats
            Accumulated evidence; 0 is rest. Each reading is held until the next.
        step_ms : float
            Time from one reading to the next, ms.
        seed : int, optional
            Key of all noise. The noise of trial t depends only on (seed, first_trial + t), not on
            the other trials. Engines without noise ignore it.
        first_trial : int
            Number of the first trial.

        Raises
        ------
        ValueError
            If the drive, a time or the circuit does not fit, or the seed of the noise is missing.
        """
        if self.noisy and seed is None:
            raise InputError(f"the {self.id} engine needs a seed", "seed", seed)
        run: Callable[..., Activity] = importlib.import_module(self.module).run
        return run(circuit, checked_drive(circuit, drive), self, step_ms, seed, first_trial)

    def stream(
        self,
        circuit: CircuitTable,
        *,
        step_ms: float,
        steps: int,
        seed: int | None = None,
        trial: int = 0,
    ) -> Stream:
        """Begin a trial that receives its readings one by one, at most ``steps``.

        The other arguments are those of ``run``. Raises InputError if this engine takes all
        readings at once.
        """
        if self.noisy and seed is None:
            raise InputError(f"the {self.id} engine needs a seed", "seed", seed)
        module = importlib.import_module(self.module) if hasattr(self, "module") else None
        stream: Callable[..., Stream] | None = getattr(module, "stream", None)
        if stream is None:
            raise InputError(
                f"the {self.id} engine takes all readings of a trial at once: for one by one take "
                "rate, population or spikes",
                "engine",
                self.id,
            )
        return stream(circuit, self, step_ms=step_ms, steps=steps, seed=seed, trial=trial)

    # ---- the same engine with other options; an engine without the option returns itself

    def tuned(
        self,
        *,
        workers: int | None = None,
        rates: bool | None = None,
        sample_ms: float | None = None,
    ) -> Self:
        """Return the engine with settings for many trials: threads, recorded rates, and samples.

        Settings that are None stay. An engine that is not made for many trials returns itself.
        """
        return self

    def until(self, level_nats: float, *, rates: bool = False) -> Self:
        """Return the engine set to stop a trial once its OUT falls below a level, nats."""
        return self

    def recording(self, names: tuple[str, ...]) -> Self:
        """Return the engine set to record the spikes of populations."""
        return self

    def coarse(self) -> Self:
        """Return the engine with longer ticks, for thousands of trials at many levels."""
        return self

    def at_rest(self) -> Engine:
        """Return the fastest engine for measuring the noise of OUT at rest."""
        return self

    # ---- questions about a run

    def ignores(self, field: str) -> bool:
        """Return whether the engine does not use a field of a row, such as ``"cell.cv"``."""
        return False

    def samples(self, steps: int, step_ms: float) -> int:
        """Return the number of samples of OUT in ``steps`` readings."""
        return round(steps * step_ms / self.sample_ms)

    def memory_bytes(self, circuit: CircuitTable, trials: int, samples: int) -> float:
        """Return an estimate of a run's memory, bytes, for simultaneous trials."""
        kept = 4.0 * trials * samples * blocks(circuit) if self.rates else 0.0
        return 8.0 * trials * samples * circuit.channels + kept


@dataclass(frozen=True, kw_only=True, repr=False)
class TimedEngine(Engine):
    """Base class of engines with dynamics."""

    ticks_ms: ClassVar[tuple[float, ...]] = (0.5, 0.25, 0.2)
    """Ticks longer than ``TICK_MS`` that are exact enough, the longest first."""

    dt_ms: float | None = None
    """One tick, ms; by default the longest of 0.5, 0.25, 0.2 and 0.1 that divides all times. Where
    cells spike it is 0.25 if all cell types of the circuit allow it, as Phase does, or else 0.1."""
    sample_ms: float = 1.0  #: Time from one recorded sample to the next, ms.
    settle_ms: float = 300.0  #: Time at rest before the first reading, ms; it is not recorded.

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(sample_ms=self.sample_ms)
        check_range(0, math.inf, settle_ms=self.settle_ms)
        if self.dt_ms is not None:
            check_positive(dt_ms=self.dt_ms)

    def longest_ms(self, wiring: Wiring) -> float:
        """Return the longest tick that is exact enough for a circuit."""
        return self.ticks_ms[0]

    def clock(self, wiring: Wiring, steps: int, step_ms: float) -> Clock:
        """Return the times of a run, with the engine's tick or the longest that suits a circuit."""
        times, dt, longest = (self.sample_ms, self.settle_ms), self.dt_ms, self.longest_ms(wiring)
        allowed = tuple(ms for ms in self.ticks_ms if ms <= longest)
        dt = tick_ms(wiring, allowed, step_ms, *times) if dt is None else dt
        return Clock(steps, step_ms, dt, *times)


@dataclass(frozen=True, kw_only=True, repr=False)
class SpikingEngine(TimedEngine):
    """Base class of spiking engines, which all draw the same noise and produce the same spikes."""

    spiking: ClassVar[bool] = True
    sparse: ClassVar[bool] = True
    # Words of noise, four ticks each, then fill every whole millisecond.
    ticks_ms: ClassVar[tuple[float, ...]] = (0.25,)
    cell_bytes: ClassVar[float] = 100.0
    """Measured memory per cell, bytes, for each trial or thread that runs at the same time."""

    spikes: tuple[str, ...] = ()  #: Populations whose spikes are recorded.

    def __post_init__(self) -> None:
        """Accept any collection of names of populations, or one name."""
        spikes = (self.spikes,) if isinstance(self.spikes, str) else self.spikes
        names = spikes if isinstance(spikes, Collection) else (None,)
        if not all(isinstance(name, str) for name in names):
            raise InputError.of("spikes", "must be names of populations, such as ('STN',)", spikes)
        object.__setattr__(self, "spikes", tuple(spikes))
        super().__post_init__()

    def longest_ms(self, wiring: Wiring) -> float:
        """Return the longest tick that all cell types of a circuit allow."""
        allowed = (row.cell.longest_tick_ms for row in wiring.rows if row.spiking)
        return min(allowed, default=TICK_MS)

    @property
    def noisy(self) -> bool:
        """Always true: every cell has independent noise."""
        return True

    def recording(self, names: tuple[str, ...]) -> Self:
        """Return the engine set to record the spikes of populations."""
        return replace(self, spikes=names)

    def memory_bytes(self, circuit: CircuitTable, trials: int, samples: int) -> float:
        """Include connections, and the cells of all trials or threads that run at the same time."""
        of_cells = self.cell_bytes * cells(circuit) * self.copies(trials)
        return super().memory_bytes(circuit, trials, samples) + connection_bytes(circuit) + of_cells

    def at_rest(self) -> Engine:
        """Return the compiled engine, which produces the same spikes, recording only OUT."""
        return engine_of("spikes", dt_ms=self.dt_ms, settle_ms=self.settle_ms, rates=False)

    def copies(self, trials: int) -> int:
        """Return the number of trials whose cells are in memory at the same time."""
        return 1


@dataclass(frozen=True, kw_only=True, repr=False)
class CompiledEngine(TimedEngine):
    """Base class of the compiled engines, made for thousands of trials."""

    threaded: ClassVar[bool] = True

    rates: bool = True
    """Whether to record rates: 4 bytes per trial, sample and channel of each population."""
    drop_below: float | None = None
    """A trial ends when OUT falls below this, nats; later samples are NaN."""
    workers: int = 1  #: Number of threads; results do not depend on it.

    def __post_init__(self) -> None:
        super().__post_init__()
        allowed = is_whole(self.workers) and self.workers >= 1
        require(allowed, "workers", "must be a whole number >= 1", self.workers)
        require(self.drop_below == self.drop_below, "drop_below", "must be a number", math.nan)

    def tuned(self, **options: Any) -> Self:
        """Return the engine with settings for many trials; those that are None stay."""
        return replace(self, **{name: v for name, v in options.items() if v is not None})

    @property
    def level_nats(self) -> float:
        """OUT below which a trial ends; -inf for none."""
        return -math.inf if self.drop_below is None else float(self.drop_below)

    def outputs(self, trials: int, samples: int, wiring: Wiring) -> tuple[Array, Any]:
        """Return the output arrays of a run: OUT, and rows of the rates of blocks if recorded."""
        row = wiring.blocks if self.rates else 0
        out = np.empty((trials, samples, wiring.circuit.channels))
        return out, np.empty((trials, samples, row), np.float32)

    def until(self, level_nats: float, *, rates: bool = False) -> Self:
        """Return the engine set to stop a trial once its OUT falls below a level, nats."""
        return replace(self, drop_below=level_nats, rates=rates)

    def at_rest(self) -> Engine:
        """Return the engine set to record only OUT, sampled every ms."""
        return replace(self, rates=False, drop_below=None, sample_ms=1.0).recording(())


# ---- shared by engines


def of_cells_alone(field: str) -> bool:
    """Return whether a field of a row matters only if cells spike or their number is finite."""
    of_rates = {f"cell.{name}" for kind in CELLS.values() for name in kind.of_rates}
    return field in OF_CELLS or (field.startswith("cell.") and field not in of_rates)


ENGINES: dict[str, type[Engine]] = {}
"""All engines by id, in the order in which they were registered."""
E = TypeVar("E", bound=type[Engine])


def register(kind: E) -> E:
    """Register an engine in ``ENGINES``: a class decorator, above ``@dataclass(frozen=True)``.

    Raises
    ------
    ValueError
        If it is not a frozen dataclass derived from ``Engine``, an option has no default, or the
        id is taken by another engine.
    """
    name = check_kind(kind, Engine, "an engine")
    for word in ("id", "description"):
        text = getattr(kind, word, None)
        require(isinstance(text, str), word, "must be text", text, owner=name)
    check_free(kind.id, kind, ENGINES, "an engine")
    try:
        kind()
    except TypeError as error:
        raise InputError(f"every option needs a default: {error}", "engine", kind) from error
    ENGINES[kind.id] = kind
    return kind


def engine_of(engine: Engine | str, **options: object) -> Engine:
    """Return an engine from its id or from a record, with options (its fields) changed."""
    if not isinstance(engine, Engine):
        known = isinstance(engine, str) and engine in ENGINES
        require(known, "engine", f"must be one of {', '.join(ENGINES)}", engine)
        engine = ENGINES[engine]()
    names = [f.name for f in fields(engine)]
    for name in options:
        if name not in names:
            raise InputError(f"the {engine.id} engine takes no {name!r}: {', '.join(names)}", name)
    return replace(engine, **options) if options else engine


class EngineOrName:
    """A dataclass field that accepts an engine or its id, and stores the engine."""

    def __init__(self, default: str) -> None:
        self.default = default

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, of: None, owner: type) -> str: ...
    @overload
    def __get__(self, of: object, owner: type) -> Engine: ...
    def __get__(self, of: object | None, owner: type) -> Engine | str:
        if of is None:
            return self.default
        engine: Engine = vars(of)[self.name]
        return engine

    def __set__(self, of: object, value: Engine | str) -> None:
        vars(of)[self.name] = engine_of(value)


def blocks(circuit: CircuitTable) -> int:
    """Return the number of populations, counted in each channel that they have."""
    return sum(circuit.channels_of(row.name) for row in circuit.populations)


def cells(circuit: CircuitTable) -> float:
    """Return the number of spiking cells of a circuit."""
    rows = (row for row in circuit.populations if row.spiking)
    return float(sum(row.neurons * circuit.channels_of(row.name) for row in rows))


def connection_bytes(circuit: CircuitTable) -> float:
    """Return the memory of sparse connections: an index of 8 bytes each, and a mark per pair."""
    total = 0.0
    for p in circuit.projections:
        if circuit.is_sparse(p):
            ends = [circuit.population(name) for name in (p.source, p.target)]
            size = [float(row.neurons) * circuit.channels_of(row.name) for row in ends]
            total += size[0] * size[1] * (8 * p.probability + 1)
    return total
