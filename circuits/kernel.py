"""One trial of the ensemble engine: the tick scheme of ``circuits.ticks``, compiled.

Sums over populations are double precision; cells, in ``circuits.lanes``, are single precision.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from circuits import lanes, noise
from circuits.compiling import compiled
from circuits.transfer import EXP_MOST

RATE, INTEGRATOR, LIF, ESCAPE, PHASE = range(5)
KINDS = {"rate": RATE, "integrator": INTEGRATOR, "lif": LIF, "escape": ESCAPE, "phase": PHASE}
LINEAR, RECTIFIED, EXP, S_MINUS_LOG_S = range(4)
TRANSFERS = {"linear": LINEAR, "rectified": RECTIFIED, "exp": EXP, "s_minus_log_s": S_MINUS_LOG_S}
# Whether a block's cells are alike, differ in their constants, or in their inputs as well.
ALIKE, SPREAD, WIRED = range(3)
ROOT_HALF = np.float32(math.sqrt(0.5))

_GOLDEN = np.uint64(noise.GOLDEN)


@numba.njit(inline="always")
def _law(code, x):
    if code == LINEAR:
        return x
    if code == RECTIFIED:
        return max(x, 0.0)
    if code == EXP:
        return math.exp(min(x, EXP_MOST))
    return x - math.log(x) if x > 0 else 0.0


@numba.njit(inline="always")
def _tick_key(stream, tick):
    z = stream + np.uint64(tick + 1) * _GOLDEN
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@numba.njit(inline="always")
def _halves(key):
    return np.uint32(key >> np.uint64(32)), np.uint32(key & np.uint64(0xFFFFFFFF))


@numba.njit(inline="always")
def _arrivals(k, mask, units, sources, ring, u, g):
    """Filter what arrives at each unit (line 1 of the scheme)."""
    for q in range(len(units)):
        unit = units[q]
        past = (k - unit.delay) & mask
        arrived = 0.0
        for e in range(unit.source, unit.sources):
            arrived += sources[e].weight * ring[past, sources[e].index]
        u[q] = unit.decay * u[q] + (1 - unit.decay) * arrived
        g[q] = _law(unit.law, u[q] + unit.constant)


@numba.njit(inline="always")
def _common(block, inputs, g, step, drive):
    """Return what all cells of a block receive, nats (line 2 of the scheme)."""
    common = block.bias
    for e in range(block.input, block.inputs):
        common += inputs[e].weight * g[inputs[e].index]
    if step >= 0 and block.drive >= 0:
        common += block.drive_gain * drive[step, block.drive]
    return common


@numba.njit(inline="always")
def _receive(block, b, common, dt_s, work):
    """Turn a block's input into its rate, or into what its cells need; return the rate."""
    work.common[b] = common
    if block.kind == LIF:
        work.kick[b] = block.kick
        work.push[b] = block.push * (block.mv + block.mv_per_nat * common) - 4 * block.kick
        return 0.0
    if block.apart == WIRED:
        return 0.0
    work.state[b] = block.decay * work.state[b] + block.push * common
    rate = max(block.baseline + block.gain * _law(block.law, work.state[b]), block.floor)
    mean = rate * dt_s
    if block.apart == SPREAD:
        work.push[b] = mean
    elif block.kind == PHASE:
        each = block.cv * math.sqrt(0.5 * mean)
        work.kick[b] = each
        work.push[b] = mean - 4 * each
    elif block.kind == ESCAPE:
        work.limit[b] = np.uint32(min(-math.expm1(-mean) * 4294967296.0, 4294967295.0))
    return rate


@numba.njit(inline="always")
def _fire_alike(block, b, k, work, stream):
    """Advance by a tick the cells of a block that differ in noise alone; return how many fired."""
    v, counts, shift = work.v, work.counts, np.int32(8 * (k & 3))
    if block.kind == LIF:
        return lanes.lif_alike(
            v, counts, block.start, block.filled, shift, block.keep, work.push[b], work.kick[b],
            block.threshold, block.hold,
        )  # fmt: skip
    if block.kind == PHASE:
        push, kick = work.push[b], work.kick[b]
        return lanes.phase_alike(v, counts, block.start, block.filled, shift, push, kick)
    high, low = _halves(_tick_key(stream, k))
    return lanes.escape_alike(v, block.start, block.filled, high, low, work.limit[b], block.hold)


@compiled
def _inputs_apart(block, b, k, mask, common, strands, fibres, wires, x, u, sums, found, found_n):
    """Fill x with the input of each cell of a block: the common part, and its own connections."""
    for j in range(block.start, block.start + block.filled):
        x[np.uint64(j)] = common
    most = len(found) // len(found_n)
    blocks = len(found_n) // (mask + 1)
    for s in range(len(strands)):
        strand = strands[s]
        if strand.target != b:
            continue
        decay, jump, last = strand.decay, strand.jump, strand.fibres
        if k < strand.delay:
            # What is under way at the start keeps the filter at rest.
            decay, jump, last = lanes.ONE, lanes.ZERO, strand.fibre
        past = ((k - strand.delay) & mask) * blocks
        for f in range(strand.fibre, last):
            place = past + fibres[f].source
            for i in range(found_n[place]):
                row = fibres[f].wires + found[place * most + i] * block.filled
                lanes.add_row(sums, strand.start, wires, row, block.filled)
        lanes.synapse(
            u, sums, strand.start, block.filled, decay, jump, x, block.start, strand.weight
        )


@compiled
def _rates_apart(block, dt_s, x, state, factor):
    """Turn each cell's input into its expected number of spikes a tick, in place in x."""
    first, code = block.start, block.law
    lanes.filtered(state, first, block.filled, np.float32(block.decay), np.float32(block.push), x)
    gain, baseline = np.float32(block.gain * dt_s), np.float32(block.baseline * dt_s)
    if code == EXP:
        for i in range(block.filled):
            j = np.uint64(first + i)
            x[j] = max(baseline + gain * lanes.exp32(state[j]), lanes.ZERO) * factor[j]
        return
    for i in range(block.filled):
        j = np.uint64(first + i)
        activity = np.float32(_law(code, np.float64(state[j])))
        x[j] = max(baseline + gain * activity, lanes.ZERO) * factor[j]


@numba.njit(inline="always")
def _fire_apart(p, work, block, b, k, stream):
    """Advance by a tick the cells of a block that differ; return how many fired."""
    v, counts, x, shift = work.v, work.counts, work.x, np.int32(8 * (k & 3))
    if block.kind == LIF:
        if block.apart == SPREAD:
            return lanes.lif_spread(
                v, counts, block.start, block.filled, shift, np.float32(work.common[b]),
                p.cell_decay, p.cell_rest, p.cell_slope, p.cell_kick, block.threshold, block.hold,
            )  # fmt: skip
        return lanes.lif_apart(
            v, counts, block.start, block.filled, shift, x, p.cell_decay, p.cell_rest,
            p.cell_slope, p.cell_kick, block.threshold, block.hold,
        )  # fmt: skip
    if block.kind == PHASE:
        kick = np.float32(block.cv) * ROOT_HALF
        return lanes.phase_apart(v, counts, block.start, block.filled, shift, x, kick)
    high, low = _halves(_tick_key(stream, k))
    return lanes.escape_apart(v, block.start, block.filled, high, low, x, block.hold)


@compiled
def _list(block, b, k, place, fired, v, found, found_n, written, spikes):
    """List which cells of a block fired; write down those wanted. Return how many so far."""
    most = len(found) // len(found_n)
    found_n[place] = 0
    if fired:
        phase = block.kind == PHASE
        first = place * most
        found_n[place] = lanes.spikers(
            v, block.start, block.filled, block.hold, phase, found, first
        )
    if not block.kept or k < 0:
        return written
    for i in range(found_n[place]):
        if written + i < len(spikes):
            spikes[written + i, 0] = b
            spikes[written + i, 1] = found[place * most + i]
            spikes[written + i, 2] = k
    return written + found_n[place]


@compiled
def _sample(clock, i, total, low_pass, rates, out):
    """Record a sample; return the lowest OUT."""
    for b in range(rates.shape[1]):
        rates[i, b] = total[b] / clock.sample
    total[:] = 0.0
    least = np.inf
    for c in range(len(low_pass)):
        out[i, c] = (low_pass[c] - clock.readout_baseline) / clock.readout_gain
        least = min(least, out[i, c])
    return least


@numba.njit(inline="always")
def _spikes(p, work, block, b, k, stream):
    """Advance the cells of a block by a tick; return how many fired (line 3 of the scheme)."""
    counts, x = work.counts, work.x
    if block.kind != ESCAPE and k & 3 == 0:
        high, low = _halves(_tick_key(stream, k >> 2))
        lanes.refresh(counts, block.start, block.filled, high, low)
    if block.apart == ALIKE:
        return _fire_alike(block, b, k, work, stream)
    if block.apart == WIRED:
        common, mask = np.float32(work.common[b]), p.clock[0].ring - 1
        _inputs_apart(
            block, b, k, mask, common, p.strands, p.fibres, p.wires, x, work.strand,
            work.strand_sums, work.found, work.found_n,
        )  # fmt: skip
        if block.kind != LIF:
            _rates_apart(block, p.clock[0].dt_s, x, work.own, p.cell_factor)
    elif block.kind != LIF:
        mean = np.float32(work.push[b])
        for i in range(block.filled):
            j = np.uint64(block.start + i)
            x[j] = mean * p.cell_factor[j]
    return _fire_apart(p, work, block, b, k, stream)


@numba.njit(inline="always")
def _read(clock, readout, rates, low_pass):
    """Low-pass the read-out (line 4 of the scheme)."""
    kept = clock.readout_decay
    for c in range(len(readout)):
        low_pass[c] = kept * low_pass[c] + (1 - kept) * rates[readout[c]]


@compiled
def _at_rest(p, work, streams):
    """Start everything at rest, each cell at a random place between reset and threshold."""
    for b in range(len(p.blocks)):
        block = p.blocks[b]
        high, low = _halves(_tick_key(streams[b], noise.START_TICK))
        lanes.begin(
            work.v, block.start, block.cells, block.filled, high, low, block.begin, block.begin_span
        )
        work.state[b] = block.rest_x
        work.ring[:, b] = block.rest_hz
        for j in range(block.start, block.start + block.filled):
            work.own[j] = block.rest_x
            if block.kind == LIF and block.apart != ALIKE:
                # Into the units in which all cells have one threshold.
                work.v[j] *= p.cell_factor[j] if work.v[j] >= 0 else lanes.ONE
    for c in range(len(p.readout)):
        work.low_pass[c] = p.blocks[p.readout[c]].rest_hz
    for q in range(len(p.units)):
        work.unit[q] = p.units[q].rest
    for s in range(len(p.strands)):
        first = p.strands[s].start
        for j in range(first, first + p.blocks[p.strands[s].target].filled):
            work.strand[j] = p.strands[s].rest
    work.strand_sums[:] = 0
    work.total[:] = 0.0


@compiled
def trial(p, work, drive, streams, drop_below, out, rates, spikes):
    """Run one trial.

    Parameters
    ----------
    p : Plan
    work : Work
        Memory; all of it is written over.
    drive : array (steps, channels), nats
    streams : array (blocks,) uint64
    drop_below : float
        OUT below which the trial ends; -inf for none.
    out : array (samples, channels)
        OUT, written here; NaN after the trial ended.
    rates : array (samples, blocks), or (samples, 0)
        Rates in Hz, written here.
    spikes : array (capacity, 3) int32
        Block, cell and tick of each spike, as far as there is room.

    Returns
    -------
    int
        Spikes that there were to write down.
    """
    clock, blocks, ring = p.clock[0], p.blocks, work.ring
    written, step, left, mask = 0, -1, clock.settle, clock.ring - 1
    _at_rest(p, work, streams)
    for k in range(clock.ticks):
        if left == 0:
            step, left = step + 1, clock.step
        left -= 1
        now = k & mask
        _arrivals(k, mask, p.units, p.sources, ring, work.unit, work.passed)
        for b in range(len(blocks)):
            common = _common(blocks[b], p.inputs, work.passed, step, drive)
            ring[now, b] = _receive(blocks[b], b, common, clock.dt_s, work)
        for b in range(len(blocks)):
            block = blocks[b]
            if block.kind >= LIF:
                fired = _spikes(p, work, block, b, k, streams[b])
                ring[now, b] = fired * block.spike_hz
                if block.listed:
                    written = _list(
                        block, b, k - clock.settle, now * len(blocks) + b, fired, work.v,
                        work.found, work.found_n, written, spikes,
                    )  # fmt: skip
            work.total[b] += ring[now, b]
        _read(clock, p.readout, ring[now], work.low_pass)
        if step < 0:
            work.total[:] = 0.0
        elif left % clock.sample == 0:
            i = (k + 1 - clock.settle) // clock.sample - 1
            if _sample(clock, i, work.total, work.low_pass, rates, out) < drop_below:
                out[i + 1 :] = np.nan
                rates[i + 1 :] = np.nan
                break
    return written
