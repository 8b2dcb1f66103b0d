"""The fixed point of the table: resting rates, the state under a constant drive, and OUT there."""

from __future__ import annotations

from functools import lru_cache
from graphlib import TopologicalSorter

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array, Index
from circuits.checks import check_range
from circuits.declaration.table import CircuitTable
from circuits.dynamics import loops
from circuits.dynamics.wiring import Wiring, wire
from circuits.errors import require

MOST_STEPS = 400
TOLERANCE = 1e-9
"""Error, nats, below which the next step is the last: convergence is quadratic."""
LARGEST_MOVE = 1.0
MOST_DAMPING = 4.0
PATIENCE, CAUTION = 100, 10.0
"""Steps after which damping increases by this factor; otherwise some cycle between kinks."""
OUT_VALUES = 21
"""Number of values of OUT, over the readable range, at which it is compared with -ln P."""
BEHIND_NATS = 30.0
"""Deficit of a competitor whose contribution is negligible, nats."""


def wired(circuit: CircuitTable) -> Wiring:
    """Return the circuit's wiring, with clamped nuclei at the intact circuit's resting rates."""
    if not any(row.clamped for row in circuit.populations):
        return wire(circuit)
    return wire(circuit, rest_rates(wire(circuit.unlesioned)))


def resting_hz(circuit: CircuitTable) -> dict[str, float]:
    """Return the mean rate of every population at rest, Hz, by name; 0 if it is silenced."""
    wiring = wired(circuit)
    rates = rest_rates(wiring)
    return {p.name: float(wiring.recorded(p.name, rates).mean()) for p in circuit.populations}


def rest_rates(wiring: Wiring) -> Array:
    """Return the rates (blocks,) at rest, Hz."""
    return wiring.rates(rest(wiring))


def rest(wiring: Wiring) -> Array:
    """Return the state (blocks,) at rest, nats."""
    return np.asarray(solve(wiring, np.zeros((1, wiring.circuit.channels)))[0])


@lru_cache(maxsize=64)
def resting_state(circuit: CircuitTable) -> tuple[Array, Array]:
    """Return the state, nats, and the rates, Hz, of a circuit at rest, (blocks,) each.

    The arrays are cached, because a run in batches asks for them once for each batch; they must not
    be written to.
    """
    wiring = wired(circuit)
    x = rest(wiring)
    return x, wiring.rates(x)


def held_drive(wiring: Wiring, drive: npt.ArrayLike | None) -> Array:
    """Return a constant drive (channels,) in nats, or rest for None, as one trial of ``solve``."""
    channels = wiring.circuit.channels
    held = np.zeros(channels) if drive is None else np.asarray(drive, dtype=np.float64)
    fits = held.shape == (channels,) and np.isfinite(held).all()
    require(fits, "drive", f"must be {channels} finite numbers", drive)
    return held[None]


def solve(wiring: Wiring, drive: Array) -> Array:
    """Return the state at the fixed point, (trials, blocks) nats, for a drive (trials, channels).

    Populations are solved in order, upstream first; only loops need Newton's method.
    """
    outside = wiring.drive(drive)
    x = outside + wiring.bias
    for blocks, loop in parts(wiring):
        if loop:
            _newton(wiring, drive, outside, x, blocks)
        else:
            units = wiring.rates(x) @ wiring.deliver.T + wiring.constant
            x[:, blocks] = (outside + wiring.inputs(units))[:, blocks]
    return x


def parts(wiring: Wiring) -> list[tuple[Index, bool]]:
    """Return groups of blocks to solve together, upstream first, and whether each is a loop."""
    direct = (wiring.weight != 0) @ (wiring.deliver != 0)
    target, source = (wiring.owner[blocks] for blocks in np.nonzero(direct))
    rows = len(wiring.circuit.populations)
    reach = np.eye(rows, dtype=np.bool_)
    reach[target, source] = True
    for _ in range(rows.bit_length()):  # paths twice as long each time
        reach = reach @ reach
    # Blocks that reach each other form one part, labelled by its first block.
    label = (reach & reach.T).argmax(axis=1)
    order: TopologicalSorter[int] = TopologicalSorter({int(i): set() for i in label})
    for t, s in zip(label[target], label[source], strict=True):
        if t != s:
            order.add(int(t), int(s))
    looped = set(target[target == source])
    result = []
    for part in order.static_order():
        members = np.flatnonzero(label == part)
        loop = len(members) > 1 or members[0] in looped
        result.append((np.flatnonzero(np.isin(wiring.owner, members)), loop))
    return result


def _newton(wiring: Wiring, drive: Array, outside: Array, x: Array, blocks: Index) -> None:
    """Solve for the blocks of a loop in place.

    Far from the solution, steps follow the damped dynamics (pseudo-transient continuation,
    Kelley & Keyes 1998), which also work where rectified blocks are silent and Newton steps are
    undefined. No exponent moves by more than one nat per step, so that the solution stays on the
    branch that starts from silence.
    """
    within = (wiring.weight[blocks] != 0).any(axis=0) & (wiring.deliver[:, blocks] != 0).any(axis=1)
    weight, deliver = wiring.weight[blocks][:, within], wiring.deliver[within][:, blocks]
    slow = np.array([wiring.rows[b].transfer == "exp" for b in blocks])
    eye = np.eye(len(blocks))
    for step in range(MOST_STEPS):
        here = x[:, blocks]
        units = wiring.rates(x) @ wiring.deliver.T + wiring.constant
        error = (outside + wiring.inputs(units))[:, blocks] - here
        size = np.abs(error).max(axis=1)
        gain = weight * wiring.units_slope(units)[:, None, within]
        jacobian = gain @ (deliver * wiring.rates_slope(x)[:, None, blocks]) - eye
        damping = (1.0 if step < PATIENCE else CAUTION) * np.minimum(size, MOST_DAMPING)
        jacobian -= damping[:, None, None] * eye
        try:
            move = np.linalg.solve(jacobian, -error[..., None])[..., 0]
        except np.linalg.LinAlgError:
            break
        most = np.abs(move[:, slow]).max(axis=1, initial=0.0)
        move *= np.minimum(1.0, LARGEST_MOVE / np.maximum(most, 1e-300))[:, None]
        x[:, blocks] = here + move
        if size.max() < TOLERANCE:
            return
    worst = int(np.nanargmax(np.where(np.isfinite(size), size, np.inf)))
    nats = np.array2string(drive[worst], precision=3, max_line_width=1000, threshold=8)
    what = f"{wiring.circuit.name} has no fixed point at drive {nats}"
    raise loops.runaway(wiring, drive[worst], what)


def off_nats(circuit: CircuitTable, competitors: int | None = None) -> tuple[float, float]:
    """Return the lowest and highest OUT - (-ln P), nats, of the leader at the fixed point.

    The drive is centred and limited as the table says. ``competitors`` have equal drive, the others
    are far behind; by default all compete.
    """
    circuit.check_nats("OUT as -ln P")
    count = circuit.channels - 1 if competitors is None else competitors
    check_range(1, circuit.channels - 1, competitors=count)
    low, high = circuit.readable_nats
    want = np.linspace(low, min(high, np.log(count + 1)), OUT_VALUES + 1)[1:]
    drive = np.full((OUT_VALUES, circuit.channels), -BEHIND_NATS)
    drive[:, 0] = 0.0
    drive[:, 1 : count + 1] = (np.log(np.expm1(want)) - np.log(count))[:, None]
    if circuit.centred:
        drive = np.maximum(drive, drive.max(axis=1, keepdims=True) - circuit.max_deficit_nats)
        drive = drive - drive.mean(axis=1, keepdims=True)
    wiring, name = wired(circuit), circuit.readout
    rates = wiring.rates(solve(wiring, drive))[:, wiring.blocks_of(name)]
    off = wiring.activity(rates, name)[:, 0] - want
    return float(off.min()), float(off.max())
