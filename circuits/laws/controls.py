"""Control circuits: edits that a circuit should, or should not, tolerate."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np

from circuits.cells import Phase, Rate
from circuits.declaration.rows import Population, Projection
from circuits.declaration.verbs import EditableTable
from circuits.dynamics.fixed_point import rest_rates, wired

Table = TypeVar("Table", bound=EditableTable)

OF_POPULATIONS = ("baseline_hz", "gain_hz_per_nat", "bias_nats", "tau_ms")
OF_PROJECTIONS = ("weight", "delay_ms", "tau_ms")
SPARE_NATS = 0.6


def perturbed(circuit: Table, fraction: float = 0.2) -> dict[str, Table]:
    """Return variants of the circuit, each with one number of its tables changed by +-fraction.

    Delays are rounded to multiples of 0.1 ms. Numbers that are 0 are skipped, as are fields that
    are not tunable quantities: transmitters, names, numbers of cells.
    """
    changed: dict[str, Table] = {}

    def put(row: Any, edit: Callable[..., Table], names: Iterable[str], name: str) -> None:
        for field in names:
            value = getattr(row, field)
            if not value or isinstance(value, bool):
                continue
            for sign in (1, -1):
                new = value * (1 + sign * fraction)
                new = round(new, 1) if field == "delay_ms" else new
                key = f"{name} {field} {sign * fraction:+.0%}"
                changed[key] = edit(name, **{field: new})

    for row in circuit.populations:
        put(row, circuit.with_population, OF_POPULATIONS, row.name)
        put(row.cell, circuit.with_cell, [f.name for f in fields(row.cell)], row.name)
    for p in circuit.projections:
        put(p, circuit.with_projection, OF_PROJECTIONS, p.name)
    for sign in (1, -1):
        tau_ms = circuit.readout_tau_ms * (1 + sign * fraction)
        key = f"read-out tau_ms {sign * fraction:+.0%}"
        changed[key] = replace(circuit, readout_tau_ms=tau_ms)
    return changed


def correlated(circuit: Table, noise_nats: float) -> Table:
    """Return the circuit with noise shared by all cortical cells of a channel.

    ``noise_nats`` is its standard deviation. It comes from 20 irregular cells (Phase, CV 1, 20 Hz),
    filtered with 20 ms; their mean input is subtracted.
    """
    circuit.check_nats("noise in nats")
    cells, rate_hz, tau_ms = 20, 20.0, 20.0
    decay_hz = 1000 / tau_ms
    # Shot noise of a renewal process through an exponential filter (Cox 1962): ``passed`` is the
    # transform of its inverse Gaussian intervals at the filter's decay.
    passed = np.exp(1 - np.sqrt(1 + 2 * decay_hz / rate_hz))
    variance = rate_hz * decay_hz / 2 * (1 + passed) / (1 - passed) - rate_hz**2
    gain = np.sqrt(variance / cells) / noise_nats
    shared = Population("shared", Phase(1.0), rate_hz, gain, neurons=cells, cite="assumed")
    path = Projection("shared", circuit.input, 1, delay_ms=1, tau_ms=tau_ms, cite="assumed")
    return circuit.with_rows(shared, path)


def linear_stn(circuit: Table) -> Table:
    """Return the circuit with a linear STN: the tangent of its exponential at rest.

    At rest a channel's activity is a, ``e^u``; there ``e^u`` is about ``a (u + 1 - ln a)``. The
    slope a multiplies the weights onto STN, because a pathway from STN may be nonlinear. The line
    has no floor, because a line cut off at 0 is still convex, and no noise, which favours it. OUT
    is then the mean over channels less the winner, as long as cortex is not silent. It falls
    further than -ln P, so SNr gets ``SPARE_NATS`` more tonic drive; otherwise it would fall silent
    before a decision at 0.95.
    """
    circuit.check_nats("the tangent of an exponential STN")
    wiring = wired(circuit)
    rates = rest_rates(wiring)[wiring.blocks_of("STN")]
    rest = float(wiring.activity(rates, "STN").mean())
    bias = rest * (circuit.population("STN").bias_nats + 1 - float(np.log(rest)))
    spare = circuit.population("SNr").bias_nats + SPARE_NATS
    line = {"cell": Rate(signed=True), "transfer": "linear", "bias_nats": bias}
    edited = circuit.with_population("STN", **line)
    for source in {p.source: None for p in circuit.projections if p.target == "STN"}:
        edited = edited.scale(f"{source}->STN", rest)
    return edited.with_population("SNr", bias_nats=spare)


def shuffled_stn(circuit: Table) -> Table:
    """Return the circuit in which SNr receives N times the next channel's STN, not STN's sum."""
    for p in circuit.pathways("STN->SNr"):
        weight = circuit.channels * p.weight
        circuit = circuit.with_projection(p.name, pattern="neighbour", weight=weight)
    return circuit
