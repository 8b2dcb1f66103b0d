"""The two tables of a circuit, populations and the projections that join them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array
from circuits.checks import check_channels, check_types
from circuits.declaration.rows import PATTERNS, SIGNS, Population, Projection
from circuits.errors import InputError, require, shown


@dataclass(frozen=True, repr=False)
class Network(Mapping[str, "Population | Projection"]):
    """Populations in a number of channels, and the projections between them.

    It is a mapping of its rows by name: ``circuit["STN"]`` is a population, ``circuit["STN->GPe"]``
    a projection.
    """

    name: str
    """What it is called."""
    populations: tuple[Population, ...]
    """The table of populations."""
    projections: tuple[Projection, ...]
    """The table of projections."""
    channels: int = 2
    """Number of alternatives."""
    _known: dict[str, Population] = field(init=False, repr=False, compare=False, hash=False)

    def __post_init__(self) -> None:
        check_types(self, str(self.name))
        check_rows(self.name, Population, self.populations)
        check_rows(self.name, Projection, self.projections)
        object.__setattr__(self, "_known", {p.name: p for p in self.populations})
        if len(self._known) != len(self.populations):
            raise InputError(f"{self.name}: two populations have one name", "populations")
        if len({p.name for p in self.projections}) != len(self.projections):
            said = f"{self.name}: two projections join the same populations"
            raise InputError(said, "projections")
        check_channels(self.channels)
        object.__setattr__(self, "channels", int(self.channels))
        for row in self.populations:
            _check_counts(row, self.channels_of(row.name), "intact_by_channel")
        for p in self.projections:
            self._check_projection(p)

    def _check_projection(self, p: Projection) -> None:
        """Refuse a weight of the wrong sign, and numbers for other channels than the target's."""
        channels = self.channels_of(p.target)
        what = self.population(p.source).transmitter
        if p.weight * SIGNS[what] < 0:
            must = f"the weight must be {'>=' if SIGNS[what] > 0 else '<='} 0, got {p.weight}"
            raise InputError(f"{p.name}: {p.source} releases {what}, so {must}", "weight")
        _check_counts(p, channels, "factors", "intact_by_channel")

    def population(self, name: str) -> Population:
        """Return a row by name.

        Raises
        ------
        ValueError
            If there is none, with the names that there are.
        """
        if not isinstance(name, str) or name not in self._known:
            said = f"{self.name} has no nucleus {shown(name)}: {', '.join(self._known)}"
            raise InputError(said, "nucleus", name)
        return self._known[name]

    def projection(self, source: str, target: str) -> Projection:
        """Return a row by its two ends; raises ValueError with the valid names."""
        if isinstance(source, str) and "->" in source:
            ends = ", ".join(f'"{end.strip()}"' for end in source.split("->"))
            given = f"must be one nucleus, got {shown(source)}"
            said = f"source {given}: give the two ends one by one, as in cut({ends}, 0.5)"
            raise InputError(said, "source", source)
        name = " ".join(f"{source}->{target}".split())
        for p in self.projections:
            if p.name == name:
                return p
        valid = ", ".join(p.name for p in self.projections)
        raise InputError(f"{self.name} has no pathway {name}: {valid}", "pathway")

    def row(self, name: str) -> Population | Projection:
        """Return a population, ``"STN"``, or a projection, ``"STN->GPe"``, by its name."""
        if not isinstance(name, str) or "->" not in name:
            return self.population(name)
        source, _, target = name.partition("->")
        return self.projection(source, target)

    def __getitem__(self, name: str) -> Population | Projection:
        """Return a row by its name; KeyError with the names that there are."""
        try:
            return self.row(name)
        except ValueError as error:
            raise KeyError(str(error)) from None

    def __iter__(self) -> Iterator[str]:
        """Go through the names of populations, then of projections."""
        yield from (row.name for row in self.populations)
        yield from (row.name for row in self.projections)

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.populations) + len(self.projections)

    def channels_of(self, name: str) -> int:
        """Return how many channels a population has."""
        return 1 if self.population(name).pooled else self.channels

    def intact_of(self, name: str) -> Array:
        """Return the surviving fraction of a population, (its channels,)."""
        row = self.population(name)
        left = row.intact_by_channel or (1.0,) * self.channels_of(name)
        return row.intact * np.array(left, dtype=np.float64)

    def axons_of(self, p: Projection) -> Array:
        """Return the fraction of a pathway's axons that survives, (target channels,)."""
        left = p.intact_by_channel or (1.0,) * self.channels_of(p.target)
        return p.intact * np.array(left, dtype=np.float64)

    def spiking(self, names: Iterable[str]) -> tuple[str, ...]:
        """Return names of populations; ValueError for one whose cells do not spike."""
        for name in (chosen := tuple(names)):
            if not self.population(name).spiking:
                raise InputError(f"{name} has no cells that spike", name)
        return chosen

    def joins_cells(self, p: Projection) -> bool:
        """Return whether a projection joins cells that spike to cells that spike."""
        return all(self.population(name).spiking for name in (p.source, p.target))

    def is_sparse(self, p: Projection) -> bool:
        """Return whether each cell of the target hears other cells of the source.

        Where either end passes rates on, there is one input for all cells of a channel.
        """
        return p.probability < 1 and self.joins_cells(p)

    def pattern(self, p: Projection) -> npt.NDArray[np.float64]:
        """Return which channels reach which, (target channels, source channels), factors included.

        Factors go in here and nowhere else: the pathway is linear, so they are factors on its
        weight.
        """
        pattern = PATTERNS[p.pattern](self.channels_of(p.target), self.channels_of(p.source))
        return np.asarray(pattern * np.array(p.factors)[:, None]) if p.factors else pattern


def _check_counts(row: Population | Projection, channels: int, *names: str) -> None:
    """Refuse fields that hold numbers for channels, and not one for each."""
    for name in names:
        count = len(getattr(row, name))
        must = f"must hold one number for each of {channels} channels"
        require(count in (0, channels), name, must, count, owner=row.name)


def check_rows(owner: str, kind: type, rows: Iterable[object]) -> None:
    """Raise ValueError for a row of a table that is not of the table's kind."""
    for row in rows:
        if not isinstance(row, kind):
            raise InputError(f"{owner}: a row must be a {kind.__name__}, got {row!r}", "row", row)
