"""Drives, tables and states that several modules of `circuits` are tried on."""

from functools import partial

import numba
import numpy as np

from circuits import anatomy
from circuits.cells import Phase, Rate
from circuits.circuit import Circuit
from circuits.declaration.rows import Population, Projection
from circuits.dynamics import fixed_point
from circuits.engines import run
from circuits.laws.mean_field import settled
from circuits.laws.stability import ringing

CLOSE = 1e-9
REFERENCE = 3.0
MEMBERS = {
    "bogacz_gurney": anatomy.bogacz_gurney,
    "appendix_b": anatomy.appendix_b,
    "appendix_b, strong D2": lambda n: anatomy.appendix_b(n, w_gpe_stn=0.9, w_d2_gpe=2),
    "appendix_b, weak GPe": lambda n: anatomy.appendix_b(n, w_gpe_stn=0.1, w_d2_gpe=1),
}


def call(part, *arguments):
    """Call a part of compiled code, which only compiled code can."""
    return numba.njit(lambda arguments: part(*arguments))(arguments)


def evidence(channels, trials=40, seed=0):
    """Drives whose sum over channels is 0, so that S >= REFERENCE."""
    drive = np.random.default_rng(seed).normal(0, 2, (trials, channels))
    return drive - drive.mean(axis=1, keepdims=True)


def state(circuit):
    """Return the wiring and the state at rest with the cells' own laws."""
    wiring = fixed_point.wired(circuit)
    silence = np.zeros((1, circuit.channels))
    return wiring, settled(wiring, silence, fixed_point.solve(wiring, silence))[0]


def run_algebra(circuit, drive, step_ms=1.0, **options):
    """Solve the table for each reading."""
    return run(circuit, drive, engine="algebra", step_ms=step_ms, **options)


run_rate, run_spikes, run_brian2, run_plain = (
    partial(run, engine=name) for name in ("rate", "spikes", "brian2", "plain")
)


def onset(circuit_at, stable, unstable):
    """Return the value at which a circuit becomes unstable, to 1e-9, and its frequency, Hz."""
    while unstable - stable > 1e-9 * unstable:
        middle = (stable + unstable) / 2
        grows = np.isinf(ringing(circuit_at(middle))[0])
        stable, unstable = (stable, middle) if grows else (middle, unstable)
    return stable, ringing(circuit_at(stable))[1]


def creeping(growth_hz):
    """Return a circuit whose common mode grows at a rate, 1/s, and does not oscillate."""
    rows = (
        Population("source", Phase(1.0), 50.0, 10.0, neurons=100),
        Population("target", Rate(signed=True), 50.0, 10.0, tau_ms=5.0),
    )
    itself = Projection("target", "target", (1 + growth_hz * 0.005) / 2, "diffuse")
    paths = (Projection("source", "target", 0.1), itself)
    ends = {"input": "source", "readout": "target"}
    return Circuit("creeping", rows, paths, 2, **ends, reference_nats=np.log(2))
