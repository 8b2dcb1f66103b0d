"""The two tables of a circuit: populations, and the projections between them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array
from circuits.checks import check_channels, check_types
from circuits.declaration.rows import PATTERNS, SIGNS, SYNAPSES, Population, Projection
from circuits.errors import InputError, require, shown


@dataclass(frozen=True, repr=False)
class Network(Mapping[str, "Population | Projection"]):
    """Populations, each with a number of channels, and the projections between them, by name."""

    name: str  #: Name of the circuit.
    populations: tuple[Population, ...]  #: The table of populations.
    projections: tuple[Projection, ...]  #: The table of projections.
    channels: int = 2  #: Number of alternatives.
    _known: dict[str, Population] = field(init=False, repr=False, compare=False, hash=False)

    def __post_init__(self) -> None:
        check_types(self, str(self.name))
        check_rows(self.name, Population, self.populations)
        check_rows(self.name, Projection, self.projections)
        object.__setattr__(self, "_known", {p.name: p for p in self.populations})
        names = [p.name for p in self.populations]
        if twice := [name for name in names if names.count(name) > 1]:
            raise InputError(f"{self.name}: two populations are {twice[0]}", "populations")
        names = [p.name for p in self.projections]
        if twice := [name for name in names if names.count(name) > 1]:
            reason = f"{self.name}: two rows are {twice[0]}: each needs its own receptor"
            raise InputError(f"{reason} in synapse, such as AMPA and NMDA", "synapse")
        check_channels(self.channels)
        object.__setattr__(self, "channels", int(self.channels))
        for row in self.populations:
            _check_counts(row, self.channels_of(row.name), "intact_by_channel")
        for p in self.projections:
            self._check_projection(p)

    def _check_projection(self, p: Projection) -> None:
        channels = self.channels_of(p.target)
        what = self.population(p.source).transmitter
        if p.weight * SIGNS[what] < 0:
            must = f"the weight must be {'>=' if SIGNS[what] > 0 else '<='} 0, got {p.weight}"
            raise InputError(f"{p.name}: {p.source} releases {what}, so {must}", "weight")
        fits = SYNAPSES.get(p.synapse, what) == what
        must = f"must bind {what}, which {p.source} releases"
        require(fits, "synapse", must, p.synapse, owner=p.name)
        _check_counts(p, channels, "factors", "intact_by_channel")

    def population(self, name: str) -> Population:
        """Return a row by name."""
        if not isinstance(name, str) or name not in self._known:
            reason = f"{self.name} has no nucleus {shown(name)}: {', '.join(self._known)}"
            raise InputError(reason + self._output(name), "nucleus", name)
        return self._known[name]

    def projection(self, name: str) -> Projection:
        """Return a row by name, with its receptor if several have one; ValueError lists names."""
        rows = self.pathways(name)
        exact = [p for p in rows if p.name == " ".join(name.split())] or rows
        must = f"must be one of {', '.join(p.synapse for p in rows)}"
        require(len(exact) == 1, "synapse", must, "", owner=rows[0].pair)
        return exact[0]

    def pathways(self, name: str) -> tuple[Projection, ...]:
        """Return the rows of a pathway, ``"STN->SNr"``, or of its receptor, ``"STN->SNr NMDA"``."""
        written = isinstance(name, str) and "->" in name
        require(written, "pathway", 'must be written as in "GPe->STN"', name)
        pair, _, synapse = " ".join(name.split()).partition(" ")
        rows = tuple(p for p in self.projections if p.pair == pair)
        joining = tuple(p for p in rows if synapse in ("", p.synapse))
        if joining:
            return joining
        valid = ", ".join(p.name for p in rows or self.projections)
        reason = f"{self.name} has no pathway {pair} {synapse}".rstrip()
        place = "synapse" if rows else "pathway"
        raise InputError(f"{reason}: {valid}{self._output(pair)}", place)

    def _output(self, name: object) -> str:
        """Return which nucleus represents GPi, if that is asked for, or ""."""
        one = "GPi" in str(name) and "SNr" in self._known
        return " (SNr represents both output nuclei, SNr and GPi)" if one else ""

    def row(self, name: str) -> Population | Projection:
        """Return a row by its name: ``"STN"``, ``"STN->GPe"`` or ``"STN->GPe NMDA"``."""
        path = isinstance(name, str) and "->" in name
        return self.projection(name) if path else self.population(name)

    def __getitem__(self, name: str) -> Population | Projection:
        try:
            return self.row(name)
        except ValueError as error:
            raise KeyError(str(error)) from None

    def __iter__(self) -> Iterator[str]:
        yield from (row.name for row in self.populations)
        yield from (row.name for row in self.projections)

    def __len__(self) -> int:
        return len(self.populations) + len(self.projections)

    def channels_of(self, name: str) -> int:
        """Return the number of channels of a population."""
        return 1 if self.population(name).pooled else self.channels

    def intact_of(self, name: str) -> Array:
        """Return the surviving fraction of a population, (its channels,)."""
        row = self.population(name)
        left = row.intact_by_channel or (1.0,) * self.channels_of(name)
        return row.intact * np.array(left, dtype=np.float64)

    def axons_of(self, p: Projection) -> Array:
        """Return the surviving fraction of a pathway's axons, (target channels,)."""
        left = p.intact_by_channel or (1.0,) * self.channels_of(p.target)
        return p.intact * np.array(left, dtype=np.float64)

    def spiking(self, names: Iterable[str] | None = None) -> tuple[str, ...]:
        """Return populations whose cells spike: all, or the named, else ValueError."""
        if names is None:
            return tuple(row.name for row in self.populations if row.spiking)
        for name in (chosen := tuple(names)):
            if not self.population(name).spiking:
                raise InputError(f"{name} has no cells that spike", name)
        return chosen

    def joins_cells(self, p: Projection) -> bool:
        """Return whether a projection joins spiking cells to spiking cells."""
        return all(self.population(name).spiking for name in (p.source, p.target))

    def is_sparse(self, p: Projection) -> bool:
        """Return whether each target cell receives input from a different set of source cells.

        If either end transmits rates, all cells of a channel share one input.
        """
        return p.probability < 1 and self.joins_cells(p)

    def pattern(self, p: Projection) -> npt.NDArray[np.float64]:
        """Return the connectivity of channels, (target, source channels), including factors.

        Factors are applied only here: the pathway is linear, so they multiply its weight.
        """
        pattern = PATTERNS[p.pattern](self.channels_of(p.target), self.channels_of(p.source))
        return np.asarray(pattern * np.array(p.factors)[:, None]) if p.factors else pattern


def _check_counts(row: Population | Projection, channels: int, *names: str) -> None:
    for name in names:
        count = len(getattr(row, name))
        must = f"must hold one number for each of {channels} channels"
        require(count in (0, channels), name, must, count, owner=row.name)


def check_rows(owner: str, kind: type, rows: Iterable[object]) -> None:
    """Raise ValueError for a row of a table that is not of the table's kind."""
    for row in rows:
        if not isinstance(row, kind):
            raise InputError(f"{owner}: a row must be a {kind.__name__}, got {row!r}", "row", row)
