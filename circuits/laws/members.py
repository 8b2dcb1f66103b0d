"""Members of the family of OUT = -ln P: the free directions, and moves along them.

The constraints of ``circuits.laws.family`` leave free: Sigma at rest, the weights w, v and omega of
the loop of STN and GPe and of the indirect pathway, what cortex has in common, all baselines and
gains in Hz, all delays and all time constants.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple, TypeVar

import numpy as np

from circuits.arrays import Array
from circuits.checks import check_finite
from circuits.declaration import transfer
from circuits.declaration.rows import OF_TIME, Population, Projection
from circuits.declaration.table import CircuitTable
from circuits.declaration.verbs import EditableTable
from circuits.dynamics.fixed_point import rest, wired
from circuits.dynamics.wiring import Wiring
from circuits.errors import InputError, require
from circuits.laws.family import BENT, constraints, failures, reduced

SIGMA0 = "Sigma0"
"""The resting value of Sigma as a free direction, nats of STN's activity."""
OF_GAUGE = ("baseline_hz", "gain_hz_per_nat")
DIGITS = 12
"""Decimal places of what follows from other numbers: how a machine rounds changes no table."""
FREE = {"weight": "nats per nat", "baseline_hz": "Hz", "gain_hz_per_nat": "Hz per nat"}
FREE |= dict.fromkeys(OF_TIME, "ms")
"""Fields of rows that are free, with their units."""

Table = TypeVar("Table", bound=EditableTable)


class FreeDirection(NamedTuple):
    """A free direction: the name by which ``moved`` knows it, the circuit's value and the unit."""

    name: str
    value: float
    unit: str


def directions(circuit: CircuitTable) -> list[FreeDirection]:
    """Return the free directions of a member, with its coordinates.

    They are Sigma at rest, all weights but those that the constraints then set (``dependent``), and
    fields that do not change OUT at the fixed point: the gauge in Hz, delays and time constants.
    """
    wiring = wired(circuit.steady)
    stn = wiring.blocks_of(reduced(circuit).stn)
    directions = [FreeDirection(SIGMA0, float(np.exp(rest(wiring)[stn]).sum()), "nats of activity")]
    bound = {p for pair in dependent(circuit).values() for p in circuit.pathways("->".join(pair))}
    rows: tuple[Population | Projection, ...] = (*circuit.populations, *circuit.projections)
    for row in rows:
        names = [name for name in FREE if hasattr(row, name)]
        directions += [
            FreeDirection(f"{row.name}.{name}", float(getattr(row, name)), FREE[name])
            for name in names
            if name != "weight" or row not in bound
        ]
    return directions


def loop(circuit: CircuitTable) -> dict[str, float]:
    """Return the properties of the loop of STN and GPe that follow from a member's free weights.

    The loop gain is ``w v (Sigma0 - 1)`` at rest, the loop share is the part ``w v`` of the bent
    sum that returns to STN, and the indirect share is the part ``w omega`` of the evidence that
    STN receives through other nuclei.
    """
    parts = reduced(circuit)
    sigma0 = directions(circuit)[0].value
    slope, share, _ = parts.terms[0].mean(axis=0)
    pair = f"{circuit.input}->{parts.stn}"
    straight = sum(p.weight for p in circuit.projections if p.pair == pair)
    indirect = parts.direct[0] - straight
    return {
        SIGMA0: sigma0,
        "loop gain": float(-slope * sigma0 - share),
        "loop share": float(share),
        "indirect share": float(indirect),
    }


def dependent(circuit: CircuitTable) -> dict[str, tuple[str, str]]:
    """Return the pathway whose weight each constraint sets once the free directions are chosen."""
    stn, out, cortex = reduced(circuit).stn, circuit.readout, circuit.input
    pairs = {(p.source, p.target): p for p in circuit.projections}
    bent = [p.target for p in circuit.projections if p.source == stn and p.transfer == BENT]
    direct = [
        name
        for source, name in pairs
        if source == cortex and (name, out) in pairs and name not in (stn, *bent)
    ]
    if not bent or not direct:
        needs = f"a member needs a pathway from {stn} of transfer {BENT}, and a nucleus that"
        reason = f"{circuit.name}: {needs} {cortex} excites and that inhibits {out}"
        raise InputError(reason, "pathway")
    log = (bent[0], out) if (bent[0], out) in pairs else (stn, bent[0])
    return {"log": log, "exponent": (cortex, stn), "direct": (cortex, direct[0]), "sum": (stn, out)}


def moved(circuit: Table, to: Mapping[str, float]) -> Table:
    """Return the member of the family with other values of free directions.

    The weights of ``dependent`` follow from the constraints, and biases keep the resting activity
    of every nucleus, in nats, so that OUT rests at ln N. ``to`` maps names of ``directions`` to
    values: ``{"Sigma0": 2.6, "GPe->STN.weight": -0.45, "SNr.gain_hz_per_nat": 40}``. InputError if
    the circuit is no member, a name is no free direction, or no weight of the right sign meets a
    constraint.
    """
    if fails := failures(circuit):
        problem = f"{circuit.name} is not in the family of OUT = -ln P: {fails[0]}"
        raise InputError(problem, "circuit")
    known = {one.name: one.value for one in directions(circuit)}
    for name, value in to.items():
        near = [one for one in known if one.split(".")[0] == name.split(".")[0]]
        must = f"must name free directions, such as {', '.join(near) or SIGMA0}"
        require(name in known, "to", must, name)
        check_finite(owner=name, to=value)
    member = circuit
    for name in to.keys() - {SIGMA0}:
        member = member.set(name, float(to[name]))
    if any(name == SIGMA0 or name.endswith(".weight") for name in to):
        for name, pair in dependent(circuit).items():
            member = _meeting(member, name, *pair)
        member = _resting(member, circuit, to.get(SIGMA0, known[SIGMA0]))
        if fails := failures(member):
            raise InputError(f"{circuit.name} can't move there: {fails[0]}", "to")
    gauge = all(name.rpartition(".")[2] in OF_GAUGE for name in to)
    lead = circuit.max_lead_nats if gauge else math.inf  # not measured there
    return replace(member, exact=circuit.exact, unedited=circuit.unedited, max_lead_nats=lead)


def _meeting(circuit: Table, name: str, source: str, target: str) -> Table:
    """Return the circuit with the weights of a pathway such that a constraint holds."""

    def fails_by(table: Table) -> float:
        return next(one.fails_by for one in constraints(table) if one.name == name)

    # It is a straight line in the factor.
    now, twice = fails_by(circuit), fails_by(circuit.scale(f"{source}->{target}", 2))
    if abs(now) < 1e-14:
        return circuit
    factor = 1 - now / (twice - now) if twice != now else -1.0
    if factor < 0:
        problem = f"no weight of {source}->{target} of its sign meets the constraint {name!r}"
        raise InputError(f"{circuit.name}: {problem}, which is off by {now:+.3g}", "weight")
    for p in circuit.pathways(f"{source}->{target}"):
        weight = round(p.weight * factor, DIGITS)
        circuit = circuit.with_projection(p.name, weight=weight)
    return circuit


def _resting(circuit: Table, reference: Table, sigma0: float) -> Table:
    """Return the circuit with biases that give each nucleus the reference's resting activity."""
    before, after = wired(reference.steady), wired(circuit.steady)
    x, stn = rest(before), after.blocks_of(reduced(circuit).stn)
    old = before.deliver @ before.rates(x) + before.constant
    x[stn] = math.log(sigma0 / circuit.channels)
    units = after.deliver @ after.rates(x) + after.constant
    missing = x - after.inputs(units)
    for row in circuit.populations:
        bias = row.bias_nats + float(missing[after.blocks_of(row.name)].mean())
        circuit = circuit.with_population(row.name, bias_nats=round(bias, DIGITS))
    for p in circuit.projections:
        # Where dopamine had no effect at rest, it still has none.
        if p.receptor and np.isclose(p.operating_point_nats, _at(before, p, old)):
            circuit = circuit.with_projection(p.name, operating_point_nats=_at(after, p, units))
    return circuit


def _at(wiring: Wiring, p: Projection, units: Array) -> float:
    """Return the input that a pathway adds to its target, before its weight."""
    here = [u for u, row in enumerate(wiring.projections) if row.name == p.name]
    return round(float(transfer.named(p.transfer)(units[here]).mean()), DIGITS)
