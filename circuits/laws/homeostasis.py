"""Homeostasis: biases restore each population's resting rate, in closed form.

The rule is slow and local. It uses only the mean resting rate of a population's own cells and its
rate before the edit, without evidence, labels or other populations. The bias moves until the two
rates are equal (Turrigiano 2011)::

    tau db/dt = W (r_reference - r) / gain

with W the total weight of the population's afferents, at least 1: the bias moves in proportion to
synaptic strength. With W = 1 everywhere the rule would be just as local, but a loop of three
populations oscillates under it once its gain exceeds 8 (Harnack et al. 2015 on the stability of
homeostasis): cortex, STN and the slow cells that inhibit cortex form such a loop.

The end point does not need the dynamics: at the reference rates all inputs are known, so each bias
is the input that the population needs less the input that it receives (``biases``). This restores
resting rates, not slopes: a change in how OUT follows the evidence remains. Losing a part of STN
causes no such change if STN->SNr and the loop with GPe lose the same fraction: OUT is restored.

A population that is missing from the reference keeps its bias; its resting rate follows from the
others at their rates.

A population that is silent, or at its highest rate, in the reference gives the rule no signal as
long as it stays so: its bias stays, or moves just far enough. Rates are those of the table's lines.
They are exact for cells that fire at the rate of their line; for Lif and AdEx cells they are as
accurate as the line's fit to the cell's f-I curve.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from circuits.arrays import Array, Truths
from circuits.checks import check_finite
from circuits.declaration import transfer
from circuits.declaration.table import CircuitTable
from circuits.dynamics.fixed_point import rest, rest_rates, wired
from circuits.dynamics.wiring import Wiring, wire
from circuits.errors import InputError, require

SAME_NATS = 1e-12
"""Differences from the reference below this, in nats, are rounding and ignored."""
ALIKE_NATS = 1e-9
"""Largest difference between the biases needed by a population's channels, nats."""


def biases(
    circuit: CircuitTable,
    reference: CircuitTable | None = None,
    rebound_nats: Mapping[str, float] | None = None,
) -> dict[str, float]:
    """Return the bias, nats, with which each population rests at its rate in the reference.

    A population that rests at r needs the input ``x = f^-1((r - baseline) / gain)``. With all rates
    at their targets, it receives ``W g(deliver r + constant)``. The bias is the difference.
    """
    goal = _goal(circuit, reference, rebound_nats)
    wiring = goal.wiring
    biases = {}
    now = wiring.inputs(wiring.deliver @ goal.rates_hz + wiring.constant)
    change = goal.needed(now) - now
    for row in circuit.populations:
        of_row = change[wiring.blocks_of(row.name)]
        if np.ptp(of_row) > ALIKE_NATS:
            problem = f"{row.name} has one bias but a different resting input in each channel"
            raise ValueError(f"{problem}: there is no closed form")
        biases[row.name] = row.bias_nats + float(of_row.mean())
    return biases


@dataclass(frozen=True)
class _Goal:
    """Target resting rates, and the circuit that should reach them."""

    wiring: Wiring  # of the edited circuit
    rates_hz: Array  # (blocks,) targets, in the order of the edited circuit's blocks
    # (blocks,) resting inputs of the reference; NaN for a population with another line, or a
    # rebound
    before_nats: Array

    def needed(self, now: Array) -> Array:
        """Return the input (blocks,) at which each block has its target rate.

        It is the present input if that gives the rate, and on a flat part of the line the end next
        to the rest of the line.
        """
        wiring, inputs = self.wiring, now.copy()
        off = np.abs(wiring.rates(now) - self.rates_hz) / wiring.gain_hz_per_nat
        for b in np.flatnonzero(off > SAME_NATS):
            row = wiring.rows[b]
            activity = (self.rates_hz[b] - row.baseline_hz) / row.gain_hz_per_nat
            inverse = transfer.named(row.transfer).inverse
            inputs[b] = self.before_nats[b] if inverse is None else inverse(np.array([activity]))[0]
        off = np.abs(wiring.rates(inputs) - self.rates_hz) / wiring.gain_hz_per_nat
        if (wrong := np.flatnonzero(~(off < ALIKE_NATS))).size:
            row = wiring.rows[wrong[0]]
            problem = f"{row.name} cannot rest at {self.rates_hz[wrong[0]]:.3g} Hz"
            known = f"no input to its transfer {row.transfer!r} is known to give this rate"
            raise ValueError(f"{problem}: {known}")
        return inputs

    def with_held(self, held: Truths) -> Array:
        """Return the rates (blocks,), Hz, at which the others settle while some are fixed."""
        wiring = self.wiring
        needed = self.needed(wiring.bias)
        pinned = replace(
            wiring,
            weight=np.where(held[:, None], 0.0, wiring.weight),
            bias=np.where(held, needed, wiring.bias),
        )
        return np.where(held, self.rates_hz, rest_rates(pinned))


def _goal(
    circuit: CircuitTable, reference: CircuitTable | None, rebound_nats: Mapping[str, float] | None
) -> _Goal:
    original = _reference(circuit, reference)
    before, wiring = wired(original), wire(circuit)
    x = rest(before)
    hz, rates = before.rates(x), wiring.rates(wiring.bias)
    inputs = np.full(wiring.blocks, np.nan)
    line = ("transfer", "baseline_hz", "gain_hz_per_nat", "cell")
    known = {row.name for row in original.populations}
    for row in circuit.populations:
        if row.name not in known:
            continue
        old, blocks = original.population(row.name), wiring.blocks_of(row.name)
        rates[blocks] = hz[before.blocks_of(row.name)]
        if all(getattr(row, name) == getattr(old, name) for name in line):
            inputs[blocks] = x[before.blocks_of(row.name)]
    if not isinstance(rebound_nats, Mapping | None):
        raise InputError.of("rebound_nats", "must be a dict of nuclei and nats", rebound_nats)
    for name, nats in (rebound_nats or {}).items():
        blocks = wiring.blocks_of(name)
        if name not in known:
            message = f"{name} is new: without an old rate it can't rebound above it"
            raise InputError(message, "rebound_nats")
        check_finite(owner=name, rebound_nats=nats)
        rates[blocks] += nats * wiring.gain_hz_per_nat[blocks]
        inputs[blocks] = np.nan if nats else inputs[blocks]
    goal = _Goal(wiring, rates, inputs)
    held = np.array([row.name in known for row in wiring.rows])
    return goal if held.all() else replace(goal, rates_hz=goal.with_held(held))


def _reference(circuit: CircuitTable, reference: CircuitTable | None) -> CircuitTable:
    """Return the circuit before the edits; ValueError if it is unknown or does not fit."""
    for row in circuit.populations:
        if row.clamped:
            rest = "which keeps resting rates unchanged: there is nothing to compensate"
            raise InputError(f"{row.name} is clamped, {rest}", "clamp")
    if reference is None:
        if circuit == circuit.unlesioned:
            needs = "compensate needs a reference, the circuit before the edits"
            raise InputError(f"{circuit.name} has no lesion: {needs}", "reference")
        if circuit.chronic:
            again = "biases were compensated before and would be compensated twice: give compensate"
            raise InputError(f"{again} a reference, the circuit before all edits", "reference")
        return circuit.unlesioned
    if not isinstance(reference, CircuitTable):
        raise InputError.of("reference", "must be a Circuit", reference)
    must = f"must have {circuit.channels} channels"
    same = reference.channels == circuit.channels
    require(same, "reference", must, reference.channels)
    for row in circuit.populations:
        if row.pooled != getattr(reference.get(row.name, row), "pooled", row.pooled):
            message = f"{row.name} is pooled in only one of circuit and reference"
            raise InputError(message, "reference")
    return reference
