"""Stability of a circuit's fixed point: delays in its loops cause oscillations above some S.

The scheme of ``circuits.dynamics.ticks`` in continuous time is linearised at the fixed point.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array, Complex
from circuits.declaration.table import CircuitTable
from circuits.dynamics.fixed_point import held_drive, solve, wired
from circuits.dynamics.wiring import Wiring

RINGING_HZ = np.geomspace(0.02, 1000, 400)
"""Frequencies, Hz, at which turns of the determinant are counted; amplification uses 1 to 100."""
PASSES, PEAK_POINTS = 3, 33
"""How often the frequencies next to the peak are divided further, and into how many."""


def ringing(circuit: CircuitTable, drive: npt.ArrayLike | None = None) -> tuple[float, float]:
    """Return the largest amplification of fluctuations by the loops, and its frequency, Hz.

    The largest ``1 / |det(1 - L)|`` from 1 to 100 Hz at the fixed point, L the loop gain (Nyquist's
    criterion): 1 without loops, infinite if the fixed point is unstable, which oscillates at about
    that frequency near the onset. Delays and time constants are used exactly, not in ticks. The
    drive (channels,), nats, is by default rest.
    """
    wiring = wired(circuit)
    x = _held(wiring, drive)
    hz, left = RINGING_HZ, _determinant(wiring, x, RINGING_HZ)
    for _ in range(PASSES):  # near an onset the peak is narrower than the spacing
        most = _least(hz, left)
        between = np.linspace(hz[most - 1], hz[most + 1], PEAK_POINTS)
        hz = np.union1d(hz, between)
        left = _determinant(wiring, x, hz)
    most = _least(hz, left)
    turned = np.unwrap(np.angle(left))
    # Each unstable root turns the determinant by half a turn, an integrator by a quarter.
    unstable = abs(turned[-1] - turned[0]) > 0.75 * np.pi
    return math.inf if unstable else float(1 / np.abs(left[most])), float(hz[most])


def _determinant(wiring: Wiring, x: Array, hz: Array) -> Complex:
    """Return ``det(1 - L)`` at frequencies, L the loop gain at the state x."""
    turn = 2j * np.pi * hz[:, None] / 1000
    bent = wiring.units_slope(wiring.rates(x) @ wiring.deliver.T + wiring.constant)[0]
    synapse = bent * wiring.synapse(hz)
    block = wiring.rates_slope(x)[0] / (1 + turn * wiring.tau_ms)
    loops = (block[:, :, None] * wiring.weight) @ (synapse[:, :, None] * wiring.deliver)
    return np.asarray(np.linalg.det(np.eye(wiring.blocks) - loops))


def _least(hz: Array, left: Complex) -> int:
    """Return the place of the least modulus from 1 to 100 Hz."""
    seen = (hz >= 1) & (hz <= 100)
    return int(np.argmin(np.where(seen, np.abs(left), np.inf)))


def _held(wiring: Wiring, drive: npt.ArrayLike | None) -> Array:
    """Return the state (1, blocks), nats, at a constant drive, or at rest."""
    wiring.circuit.check_steady("stability")
    return solve(wiring, held_drive(wiring, drive))
