"""The built-in engines, one record each; implementations are imported when they run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from circuits.declaration.rows import OF_TIME
from circuits.declaration.table import CircuitTable
from circuits.engines.engine import (
    CompiledEngine,
    Engine,
    SpikingEngine,
    blocks,
    of_cells_alone,
    register,
)
from circuits.errors import require

LAWS_AT_REST = ("table", "cells", "finite")
LAWS_OF_RATES = ("lines", "cells")
COARSE_MS, COARSE_SAMPLE_MS = 0.5, 2.0
"""Tick and sample interval of the rate engine for thousands of trials at each of many levels."""


@register
@dataclass(frozen=True, kw_only=True, repr=False)
class Algebra(Engine):
    """The fixed point of the table for every reading, without dynamics."""

    id: ClassVar[str] = "algebra"
    module: ClassVar[str] = "circuits.engines.algebra"
    description: ClassVar[str] = "the fixed point, exact"
    timed: ClassVar[bool] = False

    laws: str = "table"
    """How rates depend on the input: "table", by the lines (linear relations) of the rows; "cells",
    by the cells' f-I curves, which bend away from the lines; "finite", by these curves and the
    effect of the noise of finitely many cells on mean rates (``circuits.laws.fluctuation``)."""

    def __post_init__(self) -> None:
        known = ", ".join(LAWS_AT_REST)
        require(self.laws in LAWS_AT_REST, "laws", f"must be one of {known}", self.laws)

    def ignores(self, field: str) -> bool:
        """Return whether a field concerns cells or time, which the table's lines do not use."""
        # The fixed point with the cells' own f-I curves does use their constants.
        unused = of_cells_alone(field) or field.removeprefix("cell.") in OF_TIME
        return self.laws == "table" and unused

    def samples(self, steps: int, step_ms: float) -> int:
        """Return the number of readings: one sample each."""
        return steps

    def memory_bytes(self, circuit: CircuitTable, trials: int, samples: int) -> float:
        """Include the rates of all populations, which are computed in double precision."""
        outputs = 8.0 * trials * samples * circuit.channels
        return outputs + 12.0 * trials * samples * blocks(circuit)


@dataclass(frozen=True, kw_only=True, repr=False)
class PopulationsEngine(CompiledEngine):
    """Base class of engines that transmit rates instead of spikes."""

    @property
    def laws(self) -> str:
        """How rates depend on the input: by the lines of the table, after membrane filtering."""
        return "lines"

    @property
    def noise(self) -> bool:
        """Whether rates have the noise of a finite number of cells."""
        return False

    @property
    def by_cells(self) -> bool:
        """Whether rates follow the cells' f-I curves and lags."""
        return self.laws == "cells"


@register
@dataclass(frozen=True, kw_only=True, repr=False)
class Rates(PopulationsEngine):
    """Populations that follow the lines of their rows after membrane filtering, without noise."""

    id: ClassVar[str] = "rate"
    module: ClassVar[str] = "circuits.engines.population.run"
    description: ClassVar[str] = "rates with time constants and delays, without noise"

    def ignores(self, field: str) -> bool:
        """Return whether a field concerns cells, which the table's lines do not use."""
        return of_cells_alone(field)

    def coarse(self) -> Rates:
        """Return the engine with longer ticks and samples."""
        return replace(self, dt_ms=COARSE_MS, sample_ms=COARSE_SAMPLE_MS)


@register
@dataclass(frozen=True, kw_only=True, repr=False)
class Populations(PopulationsEngine):
    """Populations that follow their cells' f-I curves, with the noise of finitely many cells."""

    id: ClassVar[str] = "population"
    module: ClassVar[str] = "circuits.engines.population.run"
    description: ClassVar[str] = (
        "rates with the noise of a finite number of cells, by the cells' own laws"
    )

    laws: str = "cells"
    """How rates depend on the input: "cells", by the cells' f-I curves and lags, or "lines", by the
    lines of the table after membrane filtering."""
    noise: bool = True  #: Whether rates have the noise of a finite number of cells.

    def __post_init__(self) -> None:
        super().__post_init__()
        known = ", ".join(LAWS_OF_RATES)
        require(self.laws in LAWS_OF_RATES, "laws", f"must be one of {known}", self.laws)

    @property
    def noisy(self) -> bool:
        """Whether its noise is switched on."""
        return self.noise


@register
@dataclass(frozen=True, kw_only=True, repr=False)
class Spikes(CompiledEngine, SpikingEngine):
    """Spiking cells, every one of them simulated, compiled."""

    id: ClassVar[str] = "spikes"
    module: ClassVar[str] = "circuits.engines.spikes.run"
    description: ClassVar[str] = "spikes of every cell, compiled, for thousands of trials"
    cell_bytes: ClassVar[float] = 60.0

    def copies(self, trials: int) -> int:
        """Return the number of threads: each simulates one trial."""
        return self.workers


@register
@dataclass(frozen=True, kw_only=True, repr=False)
class Brian2(SpikingEngine):
    """Spiking cells in Brian2, generated from the table."""

    id: ClassVar[str] = "brian2"
    module: ClassVar[str] = "circuits.engines.brian2.run"
    description: ClassVar[str] = "spikes in Brian2"

    explicit: bool = False
    """Whether pathways of probability 1 have N^2 synapses instead of one input shared by all cells,
    to check that both give the same result."""

    def copies(self, trials: int) -> int:
        """Return the number of trials: one network simulates all of them."""
        return trials


@register
@dataclass(frozen=True, kw_only=True, repr=False)
class Plain(SpikingEngine):
    """Spiking cells in NumPy, one trial at a time: the readable reference."""

    id: ClassVar[str] = "plain"
    module: ClassVar[str] = "circuits.engines.plain"
    description: ClassVar[str] = "spikes in plain NumPy, the readable reference"
