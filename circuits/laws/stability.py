"""Stability of a circuit's fixed point: delays in its loops cause oscillations above some S.

The scheme of ``circuits.dynamics.ticks`` in continuous time is linearised at the fixed point. A
delay line is a transport equation, collocated at Chebyshev nodes, so that the rightmost roots of
the delay equation are eigenvalues of one matrix (Breda, Maset & Vermiglio 2005).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array, Complex, Index
from circuits.declaration.table import CircuitTable
from circuits.dynamics.fixed_point import held_drive, parts, solve, wired
from circuits.dynamics.wiring import Wiring

NODES = 12
"""Intervals of a delay line: roots are exact to 1e-6 while their modulus times the delay is < 6."""
RINGING_HZ = np.geomspace(0.02, 1000, 400)
"""Frequencies, Hz, at which turns of the determinant are counted; amplification uses 1 to 100."""
PASSES, PEAK_POINTS = 3, 33
"""How often the frequencies next to the peak are divided further, and into how many."""
LOWEST_NATS, HIGHEST_NATS, FACTOR = 0.25, 40.0, 1.15
"""Range and step of the search for the limit."""


@dataclass(frozen=True)
class Onset:
    """Onset of oscillations."""

    # the ``S = ln sum exp y`` above which the fixed point is unstable; inf if it never is
    total_nats: float
    frequency_hz: float  # of the oscillation at onset; NaN without an onset


def growth(circuit: CircuitTable, drive: npt.ArrayLike | None = None) -> complex:
    """Return the rightmost root of the circuit linearised at its fixed point, 1/s.

    A perturbation grows as ``exp(real * t)`` and oscillates at ``imag / (2 pi)`` Hz; -inf for a
    circuit without loops, in which it decays with the filters. Delays and time constants are used
    exactly, not in ticks. The drive (channels,), nats, is by default rest.
    """
    wiring = wired(circuit)
    x = _held(wiring, drive)[0]
    loops = [_roots(wiring, x, blocks) for blocks, loop in parts(wiring) if loop]
    if not loops:
        return complex(-math.inf)
    eigenvalues = np.concatenate(loops)
    return complex(eigenvalues[eigenvalues.real.argmax()])


def onset(circuit: CircuitTable) -> Onset:
    """Return where the fixed point loses stability as the drive of all channels rises together.

    It must be stable at the lowest S.
    """
    from scipy.optimize import brentq

    circuit.check_nats("S, the sum at which it oscillates,")

    def at(total: float) -> complex:
        return growth(replace(circuit, reference_nats=total))

    low = LOWEST_NATS
    if at(low).real >= 0:
        raise ValueError(f"{circuit.name} is already unstable at S = {low} nats")
    while low < HIGHEST_NATS:
        high = low * FACTOR
        if at(high).real >= 0:
            limit = float(brentq(lambda s: at(s).real, low, high, xtol=1e-7))
            return Onset(limit, abs(at(limit).imag) / (2 * math.pi))
        low = high
    return Onset(math.inf, math.nan)


def ringing(circuit: CircuitTable, drive: npt.ArrayLike | None = None) -> tuple[float, float]:
    """Return the largest amplification of fluctuations by the loops, and its frequency, Hz.

    The largest ``1 / |det(1 - L)|`` from 1 to 100 Hz at the fixed point, L the loop gain (Nyquist's
    criterion): 1 without loops, infinite if the fixed point is unstable. The drive (channels,),
    nats, is by default rest.
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


def _roots(wiring: Wiring, x: Array, blocks: Index) -> Complex:
    """Return the roots, 1/s, of one loop at the state x of the circuit.

    Those far to the left are meaningless: the collocation of delays is too coarse for them.
    """
    flow, lag = _linear(wiring, x, blocks)
    slow = lag > 0
    if not slow.any():
        names = ", ".join(dict.fromkeys(wiring.rows[b].name for b in blocks))
        raise ValueError(f"the loop of {names} has neither delay nor time constant: no dynamics")
    at_once = np.linalg.solve(flow[~slow][:, ~slow], flow[~slow][:, slow])
    matrix = flow[slow][:, slow] - flow[slow][:, ~slow] @ at_once
    return 1000 * np.linalg.eigvals(matrix / lag[slow][:, None]).astype(np.complex128)


def _linear(wiring: Wiring, x: Array, blocks: Index) -> tuple[Array, Array]:
    """Return the matrix F and times T, ms, of ``T dz/dt = F z``; where T is 0, ``0 = F z``.

    z contains the blocks' inputs, the units' filtered activities and each unit's delay line.
    """
    within = (wiring.weight[blocks] != 0).any(axis=0) & (wiring.deliver[:, blocks] != 0).any(axis=1)
    units = np.flatnonzero(within)
    activity = wiring.rates(x) @ wiring.deliver.T + wiring.constant
    inward = wiring.weight[np.ix_(blocks, units)] * wiring.units_slope(activity)[units]
    outward = wiring.deliver[np.ix_(units, blocks)] * wiring.rates_slope(x)[blocks]
    paths = [wiring.projections[u] for u in units]
    delay, tau = np.array([p.delay_ms for p in paths]), np.array([p.tau_ms for p in paths])
    b, u = len(blocks), len(units)
    size = b + u + NODES * np.count_nonzero(delay)
    flow, lag = np.zeros((size, size)), np.zeros(size)
    flow[:b, :b] = -np.eye(b)
    flow[:b, b : b + u] = inward
    lag[:b] = wiring.tau_ms[blocks]
    flow[b : b + u, b : b + u] = -np.eye(u)
    lag[b : b + u] = tau
    line = b + u
    derivative = _chebyshev(NODES)
    for k in range(u):
        if delay[k] == 0:
            flow[b + k, :b] += outward[k]
            continue
        travels = slice(line, line + NODES)
        # The first node is the input of the delay line, the last its output.
        flow[travels, :b] = -np.outer(derivative[1:, 0], outward[k])
        flow[travels, travels] = -derivative[1:, 1:]
        lag[travels] = delay[k]
        flow[b + k, line + NODES - 1] = 1.0
        line += NODES
    return flow, lag


def _chebyshev(intervals: int) -> Array:
    """Return the derivative at Chebyshev nodes from 0 to 1 (Trefethen 2000, chapter 6)."""
    k = np.arange(intervals + 1)
    nodes = (1 - np.cos(np.pi * k / intervals)) / 2
    sign = np.where((k == 0) | (k == intervals), 2.0, 1.0) * (-1.0) ** k
    apart = nodes[:, None] - nodes + np.eye(intervals + 1)
    matrix = np.outer(sign, 1 / sign) / apart
    return np.asarray(matrix - np.diag(matrix.sum(axis=1)))
