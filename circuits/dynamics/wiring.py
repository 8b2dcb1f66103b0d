"""The table as arrays, which all engines integrate.

A *block* is one channel of one population. A *unit* is one postsynaptic sum of one projection:
channels with the same row in the projection's pattern share it, so a diffuse projection is a
single unit for any number of channels.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array, Complex, Index, Truths
from circuits.declaration import transfer
from circuits.declaration.rows import Population, Projection
from circuits.declaration.table import CircuitTable
from circuits.dynamics import noise

Placed = list[tuple[transfer.Transfer, Truths]]
"""Transfer functions, each with its indices along the last axis of an array."""


@dataclass(frozen=True)
class Wiring:
    """A circuit as arrays, built by ``wire``."""

    circuit: CircuitTable
    owner: Index  # (blocks,) index of each block's population
    channel: Index  # (blocks,) its channel
    path: Index  # (units,) index of each unit's projection
    deliver: Array  # (units, blocks) nats that a unit receives per Hz of a block, including lesions
    constant: Array  # (units,) nats that a unit receives: minus the baselines, plus clamped output
    weight: Array  # (blocks, units) nats of input to a block per unit of transformed activity
    # (blocks,) constant input, nats; for the input population it includes the resting drive
    bias: Array
    # (blocks,) rate of blocks of which no cell is left: 0, or that at rest if they are clamped; NaN
    # in all other blocks
    held_hz: Array

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return len(self.owner)

    @property
    def units(self) -> int:
        """Number of units."""
        return len(self.path)

    @cached_property
    def names(self) -> list[str]:
        """Names such as ``GPe/0``, the keys of the blocks' noise."""
        pairs = zip(self.rows, self.channel, strict=True)
        return [f"{row.name}/{channel}" for row, channel in pairs]

    @cached_property
    def rows(self) -> list[Population]:
        """The population of each block."""
        return [self.circuit.populations[int(i)] for i in self.owner]

    @cached_property
    def projections(self) -> list[Projection]:
        """The projection of each unit."""
        return [self.circuit.projections[int(i)] for i in self.path]

    def blocks_of(self, name: str) -> Index:
        """Return the blocks of a population, in the order of its channels."""
        self.circuit.population(name)
        return np.flatnonzero([row.name == name for row in self.rows])

    def span_of(self, name: str) -> slice:
        """Return the blocks of a population, which are neighbours, as a slice."""
        blocks = self.blocks_of(name)
        return slice(int(blocks[0]), int(blocks[-1]) + 1)

    def recorded(self, name: str, rates: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
        """Return the rates of a population (..., channels), Hz, from those of all blocks.

        Engines compute the rates of lost cells too, but nothing receives them: silenced and clamped
        channels have the rate of ``held_hz``. NaN stays.
        """
        span = self.span_of(name)
        simulated, held = rates[..., span], self.held_hz[span]
        if (free := np.isnan(held)).all():
            return simulated
        return np.where(free | np.isnan(simulated), simulated, held.astype(simulated.dtype))

    def column(self, name: str) -> Array:
        """Return a field of each block's population as an array."""
        return np.array([getattr(row, name) for row in self.rows], dtype=np.float64)

    @cached_property
    def baseline_hz(self) -> Array:
        """Baseline of each block, Hz."""
        return self.column("baseline_hz")

    @cached_property
    def gain_hz_per_nat(self) -> Array:
        """Gain of each block, Hz/nat."""
        return self.column("gain_hz_per_nat")

    @cached_property
    def tau_ms(self) -> Array:
        """Time constant with which each block's rate follows its input, ms: filter or membrane.

        Raises InputError for a cell type without a single time constant.
        """
        membrane = [row.cell.membrane_ms() for row in self.rows]
        return self.column("tau_ms") + np.array(membrane, dtype=np.float64)

    @cached_property
    def floor_hz(self) -> Array:
        """Lowest rate of each block, Hz: 0, or -inf if the rate is a difference."""
        return np.array([row.cell.lowest_hz for row in self.rows])

    @cached_property
    def columns(self) -> Index:
        """Column of the drive that each block receives, -1 for none, (blocks,)."""
        columns = np.full(self.blocks, -1, dtype=np.intp)
        columns[self.blocks_of(self.circuit.input)] = np.arange(self.circuit.channels)
        for k, (name, channel) in enumerate(self.circuit.input_places()):
            blocks = self.blocks_of(name)
            columns[blocks if channel is None else blocks[channel]] = self.circuit.channels + k
        return columns

    @cached_property
    def drive_gains(self) -> Array:
        """Factor on the drive of each block, (blocks,): 1 outside the input population."""
        is_input = self.columns < self.circuit.channels
        return np.where(is_input, self.circuit.drive_gain, 1.0)

    def drive(self, drive: Array) -> Array:
        """Return the input (..., blocks) due to a drive (..., columns), nats.

        The columns of ``circuit.more_inputs`` count as 0 where only the channels are given.
        """
        x = np.zeros((*drive.shape[:-1], self.blocks))
        reached = (self.columns >= 0) & (self.columns < drive.shape[-1])
        x[..., reached] = self.drive_gains[reached] * drive[..., self.columns[reached]]
        return x

    def inputs(self, units: Array, factors: Array | float = 1.0) -> Array:
        """Return the input (..., blocks), nats, from the filtered activity (..., units).

        Weights are multiplied by ``factors`` (units,).
        """
        passed = _applied(self._unit_transfers, units) * factors
        return np.asarray(passed @ self.weight.T + self.bias)

    def units_slope(self, units: Array) -> Array:
        """Return the slope (..., units) of the units' transfer."""
        return _applied(self._unit_transfers, units, "slope")

    def units_curvature(self, units: Array) -> Array:
        """Return the second derivative (..., units) of the units' transfer."""
        return _applied(self._unit_transfers, units, "curvature")

    def rates(self, x: Array) -> Array:
        """Return the rates (..., blocks), Hz, at inputs (..., blocks), nats."""
        activity = _applied(self._block_transfers, x)
        return np.maximum(self.baseline_hz + self.gain_hz_per_nat * activity, self.floor_hz)

    def block_rates(self, block: int, x: Array) -> Array:
        """Return the rates of one block, Hz, at inputs of any shape, nats."""
        activity = transfer.named(self.rows[block].transfer)(x)
        rates = self.baseline_hz[block] + self.gain_hz_per_nat[block] * activity
        return np.asarray(np.maximum(rates, self.floor_hz[block]), dtype=np.float64)

    def rates_slope(self, x: Array) -> Array:
        """Return the slope (..., blocks) of ``rates``, Hz/nat."""
        return self._bent(x, "slope")

    def rates_curvature(self, x: Array) -> Array:
        """Return the second derivative (..., blocks) of ``rates``, Hz/nat^2."""
        return self._bent(x, "curvature")

    def _bent(self, x: Array, what: str) -> Array:
        """Return a derivative of ``rates``; it is 0 at the floor."""
        rate = self.baseline_hz + self.gain_hz_per_nat * _applied(self._block_transfers, x)
        change = _applied(self._block_transfers, x, what)
        return self.gain_hz_per_nat * change * (rate > self.floor_hz)

    def synapse(self, frequency_hz: Array) -> Complex:
        """Return the frequency response (F, units) of each unit's delay and filter."""
        turn = 2j * np.pi * np.asarray(frequency_hz)[:, None] / 1000
        delay = np.array([p.delay_ms for p in self.projections])
        tau = np.array([p.tau_ms for p in self.projections])
        return np.asarray(np.exp(-turn * delay) / (1 + turn * tau), dtype=np.complex128)

    def activity(self, rates: Array, name: str) -> Array:
        """Return the activity (..., channels), nats, decoded from rates (..., channels)."""
        row = self.circuit.population(name)
        return (rates - row.baseline_hz) / row.gain_hz_per_nat

    @cached_property
    def _unit_transfers(self) -> Placed:
        return _places_of([p.transfer for p in self.projections])

    @cached_property
    def _block_transfers(self) -> Placed:
        return _places_of([row.transfer for row in self.rows])


def _places_of(names: list[str]) -> Placed:
    kinds = np.array(names, dtype=object)
    return [(transfer.named(name), kinds == name) for name in dict.fromkeys(names)]


def _applied(placed: Placed, values: Array, what: str = "function") -> Array:
    result = np.empty_like(values)
    for law, here in placed:
        result[..., here] = getattr(law, what)(values[..., here])
    return result


def wire(circuit: CircuitTable, rest_hz: Array | None = None) -> Wiring:
    """Turn a circuit into arrays.

    ``rest_hz`` (blocks,) are resting rates of the intact circuit: the output of a clamped nucleus.
    """
    owner: list[int] = []
    channel: list[int] = []
    for i, row in enumerate(circuit.populations):
        count = circuit.channels_of(row.name)
        owner += [i] * count
        channel += range(count)
    rows = [circuit.populations[i] for i in owner]
    start = {row.name: owner.index(i) for i, row in enumerate(circuit.populations)}
    bias = np.array([row.bias_nats for row in rows], dtype=np.float64)
    bias[[row.name == circuit.input for row in rows]] += circuit.drive_gain * circuit.rest_drive

    left = np.concatenate([circuit.intact_of(row.name) for row in circuit.populations])
    at_rest = np.array([row.clamped for row in rows]) * (0.0 if rest_hz is None else rest_hz)
    path, deliver, constant, weights = [], [], [], []
    for i, p in enumerate(circuit.projections):
        pattern, alive, place = units_of(circuit, p)
        source = circuit.population(p.source)
        first, intact = start[p.source], circuit.intact_of(p.source)
        kept = np.full(pattern.shape[1], -float(source.baseline_hz))
        clamped = np.zeros(pattern.shape[1])
        if source.clamped and rest_hz is not None:
            clamped += (1 - intact) * rest_hz[first : first + pattern.shape[1]]
        for k, row_ in enumerate(pattern):
            path.append(i)
            hz = np.zeros(len(owner))
            hz[first : first + len(row_)] = intact * alive[k] / source.gain_hz_per_nat
            deliver.append(hz)
            always = float(row_ @ (kept + clamped) + (alive[k] - row_) @ clamped)
            constant.append(always / source.gain_hz_per_nat)
            column = np.zeros(len(owner))
            targets = np.flatnonzero(place == k)
            column[start[p.target] + targets] = p.weight
            weights.append(column)
    shape = (len(path), len(owner))
    return Wiring(
        circuit=circuit,
        owner=np.array(owner, dtype=np.intp),
        channel=np.array(channel, dtype=np.intp),
        path=np.array(path, dtype=np.intp),
        deliver=np.array(deliver).reshape(shape),
        constant=np.array(constant),
        weight=np.array(weights).reshape(shape).T,
        bias=bias,
        held_hz=np.where(left > 0, np.nan, at_rest),
    )


def units_of(circuit: CircuitTable, p: Projection) -> tuple[Array, Array, Index]:
    """Return the source channels summed by the units of a projection, and each target's unit.

    The first two are (units, source channels): how much of each source channel arrives, in total
    and through surviving axons. The last is the index of each target channel's unit.
    """
    connected, left = circuit.pattern(p), circuit.axons_of(p)[:, None]
    both, place = np.unique(np.hstack([connected, left * connected]), axis=0, return_inverse=True)
    sources = connected.shape[1]
    return both[:, :sources], both[:, sources:], np.asarray(place.ravel(), dtype=np.intp)


def fan_in(circuit: CircuitTable, p: Projection, target: int, source: int) -> npt.NDArray[np.int64]:
    """Return the source cells that reach each target cell, (target cells, in-degree).

    The in-degree is ``probability`` times the number of source cells, the same for every target;
    with a binomial in-degree, rates would differ between cells. Connections depend on the circuit's
    ``wiring_seed``, not on the trial or the receptor. ``target`` and ``source`` are channels.
    """
    sources = circuit.population(p.source).neurons
    targets = circuit.population(p.target).neurons
    degree = max(1, round(p.probability * sources))
    key = noise.stream_key(circuit.wiring_seed, 0, f"{p.pair}/{target}/{source}")
    words = noise.words(key, noise.CONNECTIONS_TICK, sources * targets).reshape(targets, sources)
    # The sources with the lowest words; the first of equal ones. Sorting all words took longer.
    keys = words.astype(np.uint64) << np.uint64(32) | np.arange(sources, dtype=np.uint64)
    chosen = np.partition(keys, degree - 1, axis=1)[:, :degree] & np.uint64(2**32 - 1)
    return np.sort(chosen.astype(np.int64), axis=1)
