"""The rows of a circuit's two tables: populations and projections, one by one or in columns."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from circuits.cells import Cell
from circuits.cells.cell import check_cell
from circuits.checks import check_finite, check_positive, check_range, check_types
from circuits.declaration import transfer
from circuits.errors import EditWarning, InputError, require

GLUTAMATE, GABA = "glutamate", "GABA"
SIGNS = {GLUTAMATE: 1, GABA: -1}
MOST_DELAY_MS = 10_000.0
"""Longest delay; engines store every rate for this long."""
MOST_NEURONS = 10**9
"""Most neurons per channel: no nucleus of the basal ganglia has more in any species."""
LEAST_MS, LONGEST_MS = 0.2, 10_000.0
"""Range of time constants and delays, other than 0, outside which a warning is issued. The fastest
synaptic currents take a few tenths of a ms, and no trial lasts 10 s."""
MOST_HZ, USUAL_HZ = 1000.0, 200.0
"""Highest ``baseline_hz``, which is one spike per refractory period (1 ms), and the rate above
which a warning is issued: pallidal and nigral cells, the fastest, rest at 50 to 100 Hz."""
RECEPTORS = {"": 0, "D1": 1, "D2": -1}
SYNAPSES = dict.fromkeys(("AMPA", "NMDA", "mGluR"), GLUTAMATE)
SYNAPSES |= dict.fromkeys(("GABA-A", "GABA-B"), GABA)
"""Receptors through which pathways act, with the transmitter that each binds."""
OF_CELLS = ("neurons", "probability", "heterogeneity")
"""Fields of rows that act through cell numbers, connectivity and heterogeneity."""
OF_TIME = ("delay_ms", "tau_ms")
"""Fields of rows that do not affect the fixed point."""
WHOLE: dict[str, Any] = {"intact": 1.0, "intact_by_channel": (), "clamped": False}
"""The lesion fields of an intact population."""


def _one_to_one(targets: int, sources: int) -> npt.NDArray[np.float64]:
    if 1 in (targets, sources):
        return np.ones((targets, sources))
    return np.eye(targets, sources)


PATTERNS: dict[str, Callable[[int, int], npt.NDArray[np.float64]]] = {
    "channel": _one_to_one,
    "diffuse": lambda targets, sources: np.ones((targets, sources)),
    "neighbour": lambda targets, sources: np.roll(_one_to_one(targets, sources), 1, axis=0),
}
"""Connectivity of channels: one to one, sum of all to all, or to the next (wrong) channel."""


@dataclass(frozen=True)
class Population:
    """A nucleus, or a functionally distinct part of one.

    Its rate is ``baseline_hz + gain_hz_per_nat * a`` if the activity is a, in nats.
    """

    name: str  #: Standard abbreviation.
    cell: Cell
    baseline_hz: float = 0.0  #: From 0 to ``MOST_HZ``; negative only if the cell's rate may be.
    gain_hz_per_nat: float = 1.0
    transmitter: str = GLUTAMATE  #: "glutamate" or "GABA": the sign of all outgoing projections.
    neurons: int = 1  #: Cells per channel.
    pooled: bool = False  #: Whether one channel serves all alternatives.
    #: Name of the function that gives the activity for an input, both in nats.
    transfer: str = "linear"
    bias_nats: float = 0.0  #: Constant input.
    #: Time constant of the input filter; cells with ``hears = "nats"`` filter in the membrane.
    tau_ms: float = 0.0
    #: "D1" or "D2" if dopamine acting on the cells raises or lowers the cortical gain.
    receptor: str = ""
    #: Cortical input at which dopamine has no effect: it scales deviations from this input.
    operating_point_nats: float = 0.0
    #: Standard deviation of the constants across cells, as a fraction of each; the mean over a
    #: channel equals the row's value.
    heterogeneity: float = 0.0
    intact: float = 1.0  #: Fraction that survives a lesion.
    #: Whether the targets receive a constant, the resting rate, in place of the lost output.
    clamped: bool = False
    #: Factors on ``intact`` in each channel; empty means 1 in all.
    intact_by_channel: tuple[float, ...] = ()
    cite: str = ""  #: Source of the numbers.
    #: Lowest and highest published resting rate; empty if unknown. For display only: it affects
    #: neither the simulation nor the circuit's hash.
    published_hz: tuple[float, ...] = ()
    cite_more: str = ""  #: Source of numbers that ``cite`` does not name; for display only.

    def __post_init__(self) -> None:
        _check_name(self.name)
        check_types(self, self.name)
        check_cell(self.name, self.cell)
        transfer.named(self.transfer)
        _one_of("transmitter", self.transmitter, SIGNS)
        _one_of("receptor", self.receptor, RECEPTORS)
        self._check_ranges()
        if self.cell.hears == "nats" and self.tau_ms:
            reason = f"{self.name}: tau_ms is that of the {self.cell.kind} cell, cell.tau_ms"
            raise InputError(f"{reason}: leave it 0 here", "tau_ms")

    def _check_ranges(self) -> None:
        name, published = self.name, self.published_hz
        check_range(1, MOST_NEURONS, owner=name, neurons=self.neurons)
        check_positive(owner=name, gain_hz_per_nat=self.gain_hz_per_nat)
        check_range(0, math.inf, owner=name, tau_ms=self.tau_ms)
        # Beyond it, many cells would have constants of the wrong sign.
        check_range(0, 1, owner=name, heterogeneity=self.heterogeneity)
        check_finite(owner=name, bias_nats=self.bias_nats)
        check_finite(owner=name, operating_point_nats=self.operating_point_nats)
        rates = len(published) == 2 and 0 <= published[0] <= published[1] < math.inf
        must = "must be the lowest and the highest rate, Hz"
        require(rates or not published, "published_hz", must, published, owner=name)
        lowest_hz = min(0.0, self.cell.lowest_hz)
        check_range(lowest_hz, MOST_HZ, owner=name, baseline_hz=self.baseline_hz)
        if self.baseline_hz > USUAL_HZ:
            EditWarning.warn(
                f"{self.name}: baseline_hz = {self.baseline_hz:g} is above {USUAL_HZ:g} Hz, more "
                "than any nucleus of the basal ganglia fires at rest: check its unit"
            )
        _warn_of_times(self.name, tau_ms=self.tau_ms, cell_tau_ms=getattr(self.cell, "tau_ms", 0.0))
        _check_intact(self)

    @property
    def spiking(self) -> bool:
        """Whether its cells spike."""
        return self.cell.spikes


@dataclass(frozen=True)
class Projection:
    """A pathway, which adds the source's activity to the target's input."""

    source: str
    target: str
    #: Input to the target, nats, per unit of (transformed) source activity; negative from GABA.
    weight: float
    pattern: str = "channel"  #: Connectivity of channels: a name in ``PATTERNS``.
    delay_ms: float = 0.0  #: Conduction delay.
    tau_ms: float = 0.0  #: Synaptic time constant.
    #: Fraction of the source's cells that project to a target cell, with fixed in-degree.
    probability: float = 1.0
    #: Factors on the weight in each target channel; empty means 1 in all.
    factors: tuple[float, ...] = ()
    #: Name of the dendritic transfer function of the summed, filtered activity.
    transfer: str = "linear"
    #: Postsynaptic receptor, a name in ``SYNAPSES``; empty if not specified. Rows of two nuclei
    #: that differ in it alone are the same axons: their sparse connections are the same.
    synapse: str = ""
    receptor: str = ""  #: "D1" or "D2" if dopamine at the terminals raises or lowers the weight.
    #: Input at rest, before the weight, at which dopamine has no effect.
    operating_point_nats: float = 0.0
    #: Fraction of axons that survives a cut. The others no longer transmit anything, including the
    #: tone due to the source's ``baseline_hz``.
    intact: float = 1.0
    #: Factors on ``intact`` in each target channel; empty means 1 in all.
    intact_by_channel: tuple[float, ...] = ()
    cite: str = ""  #: Source of the numbers.
    cite_more: str = ""  #: Source of numbers that ``cite`` does not name; for display only.

    def __post_init__(self) -> None:
        _check_name(self.source)
        _check_name(self.target)
        check_types(self, self.name)
        transfer.named(self.transfer)
        _one_of("pattern", self.pattern, PATTERNS)
        _one_of("synapse", self.synapse, ("", *SYNAPSES))
        _one_of("receptor", self.receptor, RECEPTORS)
        name = self.name
        check_finite(owner=name, weight=self.weight)
        check_finite(owner=name, operating_point_nats=self.operating_point_nats)
        check_range(0, math.inf, owner=name, tau_ms=self.tau_ms)
        check_range(0, MOST_DELAY_MS, owner=name, delay_ms=self.delay_ms)
        _warn_of_times(name, tau_ms=self.tau_ms, delay_ms=self.delay_ms)
        check_positive(owner=name, probability=self.probability)
        check_range(0, 1, owner=name, probability=self.probability)
        _check_intact(self)
        for factor in self.factors:
            check_range(0, math.inf, owner=name, factors=factor)
        if self.transfer != "linear":
            if self.probability < 1:
                reason = f"{name}: connections of probability < 1 must be linear"
                raise InputError(reason, "transfer")
            if self.factors:
                reason = f"{name}: a pathway that is scaled in one channel must be linear"
                raise InputError(f"{reason}, got {self.transfer!r}", "transfer")

    @property
    def pair(self) -> str:
        """``source->target``, the same for all receptors."""
        return f"{self.source}->{self.target}"

    @property
    def name(self) -> str:
        """``source->target``, followed by the receptor if it is specified: ``STN->SNr NMDA``."""
        return f"{self.pair} {self.synapse}".rstrip()


def _warn_of_times(owner: str, **times_ms: float) -> None:
    for name, time_ms in times_ms.items():
        if time_ms and not LEAST_MS <= time_ms <= LONGEST_MS:
            EditWarning.warn(
                f"{owner}: {name} = {time_ms:g} lies outside {LEAST_MS:g}..{LONGEST_MS:g} ms, what "
                "cells and synapses take: times are in ms, not in s"
            )


def _check_intact(row: Population | Projection) -> None:
    check_range(0, 1, owner=row.name, intact=row.intact)
    for part in row.intact_by_channel:
        check_range(0, 1, owner=row.name, intact_by_channel=part)


def _check_name(name: str) -> None:
    """Reject a name that is ambiguous in an edit: "a->b", "a=1", "a[0]", "a.b", or empty."""
    if not isinstance(name, str) or not re.fullmatch(r"[^\s\[\].=/>]+", name):
        must = "is text without blanks, brackets, '.', '=', '/' and '>'"
        raise InputError(f"a population's name {must}, got {name!r}", "name")


def _one_of(what: str, value: str, allowed: Iterable[str]) -> None:
    names = ", ".join(repr(name) for name in allowed)
    require(value in allowed, what, f"must be one of {names}", value)


Row = TypeVar("Row", Population, Projection)
IDENTIFIERS: dict[type, tuple[str, ...]] = {Population: ("name",), Projection: ("source", "target")}
"""The columns that identify a row; every part of a table in columns begins with them."""


def rows(kind: type[Row], *parts: tuple[str | tuple[Any, ...], ...]) -> tuple[Row, ...]:
    """Return the rows of a table in columns; each part has a header of field names, then its rows.

    The first part contains all rows. Later parts contain only rows that differ from the defaults of
    their columns, and begin with the columns that identify a row.
    """
    names = IDENTIFIERS[kind]
    by_key: dict[tuple[Any, ...], dict[str, Any]] = {}
    for number, (header, *lines) in enumerate(parts):
        columns = tuple(str(header).split())
        if columns[: len(names)] != names:
            raise ValueError(f"a part must begin with {' '.join(names)}, got {header!r}")
        for line in lines:
            if len(line) != len(columns):
                raise ValueError(f"{line[0]}: {len(columns)} columns, got {len(line)} values")
            key = tuple(line[: len(names)])
            if number and key not in by_key:
                raise ValueError(f"{header!r} has a row {'->'.join(key)}, the first part does not")
            by_key.setdefault(key, {}).update(zip(columns, line, strict=True))
    return tuple(kind(**row) for row in by_key.values())
