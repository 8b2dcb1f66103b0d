"""One trial of the spikes engine: the tick scheme of ``circuits.dynamics.ticks``, compiled.

Input within the next ticks, up to the shortest delay, is known in advance, so each block in turn is
advanced through such a window of ticks, and then the read-out. This does not change the results.

Sums over populations are double precision, in the order of the Brian2 engine; cells with a tick,
in ``lanes``, are single precision. Renewal cells that share their input cost nothing until they
fire (``trains``).
"""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

from circuits.arrays import Array
from circuits.declaration.transfer import EXP_MOST, MOST_NATS
from circuits.dynamics import noise
from circuits.engines.compiling import compiled, part
from circuits.engines.spikes import lanes, trains
from circuits.engines.spikes.records import Plan, Work

RATE, LIF, RENEWAL, GENERAL = range(4)
"""Kinds of loops over cells: none, those of ``Lif``, those of renewal cells (``trains``), or one
compiled from a type's tick."""
_NAMES = ("linear", "rectified", "saturating", "exp", "s_minus_log_s")
TRANSFERS = {name: code for code, name in enumerate(_NAMES)}
LINEAR, RECTIFIED, SATURATING, EXP, S_MINUS_LOG_S = TRANSFERS.values()
# Whether a block's cells are identical, differ in their constants, or also in their inputs.
IDENTICAL, OWN_CONSTANTS, OWN_INPUTS = range(3)
WORD = noise.TICKS_A_WORD
WINDOW = 20
"""Most ticks that a block is advanced at a time: whole words, or one tick if the shortest delay is
less than a word."""
LEAST_SCALE = 2.0**-10
"""Filters of cells are rescaled when their common scale falls below this."""
MOST_ROWS = 255
"""Number of rows of connections after which a one-byte count may overflow."""


@numba.njit(inline="always")
def _law(code, x):
    if code == LINEAR:
        return x
    if code == RECTIFIED:
        return max(x, 0.0)
    if code == SATURATING:
        return min(max(x, 0.0), MOST_NATS)
    if code == EXP:
        return math.exp(min(x, EXP_MOST))
    return x - math.log(x) if x > 0 else 0.0


@numba.njit(inline="always")
def _most(work):
    """Return the capacity of a list of spikes."""
    return len(work.spiked) // len(work.spiked_n)


@part
def _scale(first, window, factors, row):
    for t in range(window):
        row[t] *= factors[first + t]


@part
def _arrivals(first, window, units, sources, factors, ring, state, passed):
    """Filter the input of each unit in the ticks of a window (step 1 of the scheme)."""
    mask = ring.shape[1] - 1
    for q in range(len(units)):
        unit, row, u = units[q], passed[q], state[q]
        for t in range(window):
            row[t] = 0.0
        for e in range(unit.source, unit.sources):
            weight, rates = sources[e].weight, ring[sources[e].index]
            past = (first - unit.delay) & mask
            turn = min(len(rates) - past, window)
            for t in range(turn):
                row[t] += weight * rates[np.uint64(past + t)]
            for t in range(turn, window):
                row[t] += weight * rates[np.uint64(t - turn)]
        decay, gain, constant = unit.decay, 1 - unit.decay, unit.constant
        for t in range(window):
            u = decay * u + gain * row[t]
            row[t] = u + constant
        if unit.law != LINEAR:
            for t in range(window):
                row[t] = _law(unit.law, row[t])
        if unit.course:
            _scale(first, window, factors[unit.course], row)
        state[q] = u


@part
def _common(block, first, window, clock, inputs, passed, drive, nats, common):
    """Sum the input common to all cells of a block, nats, in the ticks of a window (step 2).

    The order is that of the Brian2 engine; another order would round differently.
    """
    # Also beyond the window, where renewal cells then expect no spikes.
    common[:] = 0.0
    for e in range(block.input, block.inputs):
        weight, row = inputs[e].weight, passed[inputs[e].index]
        for t in range(window):
            common[t] += weight * row[t]
    for t in range(window):
        common[t] += block.bias
    if block.drive >= 0:
        t = max(clock.settle - first, 0)
        while t < window:
            step = (first + t - clock.settle) // clock.step
            last = min((step + 1) * clock.step + clock.settle - first, window)
            reading = block.drive_gain * drive[step, block.drive]
            while t < last:
                common[t] += reading
                t += 1
    if block.course:
        for t in range(window):
            common[t] += nats[block.course, first + t]


@numba.njit(inline="always")
def _receive(block, b, first, window, dt_s, work):
    """Turn a block's input into its rates, or into the input of its cells."""
    common, mean_step = work.common, work.mean_step
    if block.kind == LIF and block.variation == IDENTICAL:
        for t in range(window):
            mean_step[t] = lanes.fused(block.slope, np.float32(common[t]), block.rest)
        return
    if block.nats:
        for t in range(window):
            mean_step[t] = common[t]
        return
    if block.variation == OWN_INPUTS:
        return
    _rates(block, b, window, work.state, common)
    if block.kind == RATE:
        for t in range(window):
            work.ring[b, (first + t) & (work.ring.shape[1] - 1)] = common[t]
        return
    for t in range(window):
        common[t] *= dt_s


@part
def _rates(block, b, window, state, common):
    """Turn a block's input into rates, Hz, in place; separate loops so that they vectorise."""
    x = state[b]
    for t in range(window):
        x = block.decay * x + block.filter_gain * common[t]
        common[t] = x
    state[b] = x
    for t in range(window):
        common[t] = max(block.baseline + block.gain * _law(block.law, common[t]), block.floor)


@numba.njit(inline="always")
def _filter(p, work, s, k, cells):
    """Advance the filters of an own input (one that differs between cells) to tick k.

    They are stored divided by a common scale. Only the scale decays; spikes change the values.
    """
    own_input, mask = p.own_inputs[s], p.clock[0].ring - 1
    if k < own_input.delay:
        # Spikes in transit at the start keep the filter at rest.
        return
    work.scale[s] *= own_input.decay
    if work.scale[s] < LEAST_SCALE:
        lanes.scaled(work.own_input, own_input.start, cells, np.float32(work.scale[s]))
        work.scale[s] = 1.0
    jump, rows, most = np.float32(own_input.jump / work.scale[s]), 0, _most(work)
    for f in range(own_input.own_source, own_input.own_sources):
        place = ((k - own_input.delay) & mask) * len(p.blocks) + p.own_sources[f].source
        for i in range(work.spiked_n[place]):
            row = p.own_sources[f].connections + work.spiked[place * most + i] * (
                cells // lanes.LANES
            )
            lanes.add_row(work.sums, p.connections, row, cells)
            rows += 1
            if rows % MOST_ROWS == 0:
                lanes.arrive(work.own_input, own_input.start, work.sums, cells, jump)
    if rows % MOST_ROWS:
        lanes.arrive(work.own_input, own_input.start, work.sums, cells, jump)


@numba.njit(inline="always")
def _weight(p, work, s, k):
    """Return the weight at tick k of the values stored in the filters of an own input."""
    own_input = p.own_inputs[s]
    weight = own_input.weight * work.scale[s]
    if own_input.course:
        weight *= p.factors[own_input.course, k]
    return np.float32(weight)


@numba.njit(inline="always")
def _cell_inputs(p, work, block, common, k, x):
    """Fill x with the input common to all cells of a block plus each cell's own inputs."""
    first, last, u = block.own_input, block.own_inputs - 1, work.own_input
    for s in range(first, last + 1):
        _filter(p, work, s, k, block.filled)
    second = min(first + 1, last)
    weight = _weight(p, work, first, k)
    other = _weight(p, work, second, k) if second > first else lanes.ZERO
    one, two = p.own_inputs[first].start, p.own_inputs[second].start
    lanes.inputs(x, block.filled, common, u, one, weight, two, other)
    for s in range(second + 1, last + 1):
        lanes.more_inputs(x, block.filled, u, p.own_inputs[s].start, _weight(p, work, s, k))


@part
def _rates_varied(block, dt_s, x, state):
    """Turn each cell's input into its expected number of spikes per tick, in place in x."""
    first, code = block.start, block.law
    lanes.filtered(
        state, first, block.filled, np.float32(block.decay), np.float32(block.filter_gain), x
    )
    gain, baseline = np.float32(block.gain * dt_s), np.float32(block.baseline * dt_s)
    if code == EXP:
        for i in range(block.filled):
            j = np.uint64(first + i)
            x[np.uint64(i)] = max(baseline + gain * lanes.exp32(state[j]), lanes.ZERO)
        return
    for i in range(block.filled):
        j = np.uint64(first + i)
        activity = np.float32(_law(code, np.float64(state[j])))
        x[np.uint64(i)] = max(baseline + gain * activity, lanes.ZERO)


@numba.njit(inline="always")
def _four(values, t):
    """Return the values of four ticks, so that a loop holds them in registers."""
    return values[t], values[t + 1], values[t + 2], values[t + 3]


@numba.njit(inline="always")
def _inputs_varied(p, work, block, t, k, ticks):
    """Fill x with each cell's own inputs in some ticks, or its expected numbers of spikes."""
    for i in range(ticks):
        _cell_inputs(p, work, block, np.float32(work.common[t + i]), k + i, work.x[i])
        if not block.nats:
            _rates_varied(block, p.clock[0].dt_s, work.x[i], work.cell_x)


@numba.njit(inline="always")
def _cells(p, work, block, t, ticks, noise_of):
    """Advance cells with a tick."""
    lanes.refresh(work.counts, block.start, block.filled, noise_of)
    if block.kind == GENERAL:
        _general(p, work, block, t, ticks)
    elif block.variation == IDENTICAL:
        _identical(work, block, t, ticks)
    elif block.variation == OWN_CONSTANTS:
        _varied(p, work, block, t, ticks, None)
    else:
        _varied(p, work, block, t, ticks, work.x)


@numba.njit(inline="always")
def _identical(work, block, t, ticks):
    """Advance Lif cells that differ only in their noise."""
    v, marks, counts, first, cells = work.v, work.marks, work.counts, block.start, block.filled
    step = _four(work.mean_step, t)
    decay, noise_step, top = block.membrane_decay, block.noise_step, block.threshold
    lanes.lif_identical(
        v, marks, counts, first, cells, ticks, decay, step, noise_step, top, block.refractory
    )


@numba.njit(inline="always")
def _varied(p, work, block, t, ticks, x):
    """Advance Lif cells that differ in their constants and, with x, in their inputs."""
    v, marks, counts, first, cells = work.v, work.marks, work.counts, block.start, block.filled
    constants = p.constants
    common, top, held = _four(work.mean_step, t), block.threshold, block.refractory
    lanes.lif_varied(v, marks, counts, first, cells, ticks, common, x, constants, top, held)


@part
def _general(p, work, block, t, ticks):
    heard, marks = work.heard, work.marks
    for i in range(len(ticks)):
        for j in range(block.cells):
            if block.variation == OWN_INPUTS:
                heard[i, j] = np.float64(work.x[i, j])
            else:
                heard[i, j] = work.common[t + i]
    for j in range(block.filled):
        marks[j] = 0
    lanes.advance(
        block.advance, work.states, p.tick_constants, block.start, work.counts, heard, block.cells,
        len(ticks), marks,
    )  # fmt: skip


@numba.njit(inline="always")
def _write(p, work, first, last, written, spikes):
    """Record the requested spikes of some ticks; return their number so far."""
    if not p.clock[0].listing:
        return written
    most = _most(work)
    for k in range(first, last):
        for b in range(len(p.blocks)):
            if p.blocks[b].kept:
                place = (k & (p.clock[0].ring - 1)) * len(p.blocks) + b
                for i in range(work.spiked_n[place]):
                    if written < len(spikes):
                        spikes[written, 0] = b
                        spikes[written, 1] = work.spiked[place * most + i]
                        spikes[written, 2] = k - p.clock[0].settle
                    written += 1
    return written


@part
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
def _fire(p, work, block, b, t, k, stream):
    """Advance the cells of a block by the ticks of one word of noise, or by one tick."""
    clock, most = p.clock[0], _most(work)
    if block.kind == RENEWAL:
        trains.fire(p, work, block, b, t, block.variation == OWN_INPUTS, stream)
    else:
        _cells(p, work, block, t, p.ticks, (lanes.tick_key(stream, k // WORD), k % WORD))
        for i in range(len(p.ticks)):
            work.fired[i] = lanes.how_many(work.marks, block.filled, i)
    for i in range(len(p.ticks)):
        now = (k + i) & (clock.ring - 1)
        work.ring[b, now] = work.fired[i] * block.spike_hz
        if clock.listing:
            place = now * len(p.blocks) + b
            work.spiked_n[place] = lanes.listed(
                work.marks, block.filled, i, work.spiked[place * most :]
            )


@numba.njit(inline="always")
def _advance(p, work, b, first, window, drive, stream):
    """Advance a block through the ticks of a window (step 3 of the scheme)."""
    clock, block = p.clock[0], p.blocks[b]
    _common(block, first, window, clock, p.inputs, work.passed, drive, p.nats, work.common)
    _receive(block, b, first, window, clock.dt_s, work)
    if block.kind == RATE:
        return
    for t in range(0, window, WORD):
        k = first + t
        if block.variation == OWN_INPUTS:
            _inputs_varied(p, work, block, t, k, min(WORD, window - t))
        # Ticks beyond the end of the run are computed but not used.
        _fire(p, work, block, b, t, k, stream)


@part
def _read(clock, readout, ring, k, last, low_pass):
    """Low-pass the read-out in the ticks from k to the last (step 4 of the scheme)."""
    kept, mask = clock.readout_decay, ring.shape[1] - 1
    for c in range(len(readout)):
        b, x = readout[c], low_pass[c]
        for t in range(k, last):
            x = kept * x + (1 - kept) * ring[b, t & mask]
        low_pass[c] = x


@part
def _sum_up(ring, k, last, total):
    mask = ring.shape[1] - 1
    for b in range(len(total)):
        x = total[b]
        for t in range(k, last):
            x += ring[b, t & mask]
        total[b] = x


@compiled
def begin(p, work, streams):
    """Start everything at rest, and each cell at a random place between two spikes."""
    for b in range(len(p.blocks)):
        block = p.blocks[b]
        key = lanes.tick_key(streams[b], noise.START_TICK)
        work.state[b] = block.rest_x
        work.ring[b] = block.rest_hz
        work.cell_x[block.start : block.start + block.filled] = block.rest_x
        if block.kind == LIF:
            lanes.begin(work.v, block.start, block.cells, block.filled, key, block.threshold)
            if block.variation != IDENTICAL:
                lanes.in_own_units(work.v, block.start, block.filled, p.constants)
        if block.kind == RENEWAL:
            trains.begin(p, work, block, b, streams[b])
        if block.kind == GENERAL:
            lanes.place(block.place, work.states, p.tick_constants, block.start, key, block.cells)
    for c in range(len(p.readout)):
        work.low_pass[c] = p.blocks[p.readout[c]].rest_hz
    for q in range(len(p.units)):
        work.unit[q] = p.units[q].rest
    for s in range(len(p.own_inputs)):
        first, cells = p.own_inputs[s].start, p.blocks[p.own_inputs[s].target].filled
        work.own_input[first : first + cells] = p.own_inputs[s].rest
    work.sums[:] = 0
    work.scale[:] = 1.0
    work.total[:] = 0.0


@compiled
def trial(
    p: Plan,
    work: Work,
    drive: Array,
    streams: npt.NDArray[np.uint64],
    drop_below: float,
    out: Array,
    rates: npt.NDArray[np.float32],
    spikes: npt.NDArray[np.int32],
) -> int:
    """Run one trial and return its number of spikes, which may exceed the capacity of ``spikes``.

    The drive is (steps, channels), nats; the trial ends when OUT falls below ``drop_below``, -inf
    for never. Written are ``out`` (samples, channels), NaN after the end; ``rates`` (samples,
    blocks), Hz, or (samples, 0); and ``spikes`` (capacity, 3): block, cell and tick of each.
    """
    begin(p, work, streams)
    # Not 0 itself: for a number in the text, ``go_on`` is compiled a second time.
    start = np.int64(0)
    return go_on(p, work, drive, streams, drop_below, out, rates, spikes, start, p.clock[0].ticks)


@compiled
def go_on(p, work, drive, streams, drop_below, out, rates, spikes, start, end):
    """Run the ticks from ``start`` to ``end``, as ``trial`` runs those of a whole trial."""
    clock, ring, written = p.clock[0], work.ring, 0
    for first in range(start, end, clock.window):
        window = min(clock.window, end - first)
        _arrivals(first, window, p.units, p.sources, p.factors, ring, work.unit, work.passed)
        for b in range(len(p.blocks)):
            _advance(p, work, b, first, window, drive, streams[b])
        k = first
        while k < first + window:
            # Up to the end of the window, of settling, or of a sample, whichever is first.
            late = k - clock.settle
            left = -late if late < 0 else clock.sample - late % clock.sample
            last = min(k + left, first + window)
            _read(clock, p.readout, ring, k, last, work.low_pass)
            if late >= 0:
                _sum_up(ring, k, last, work.total)
                written = _write(p, work, k, last, written, spikes)
                if late % clock.sample + last - k == clock.sample:
                    i = late // clock.sample
                    if _sample(clock, i, work.total, work.low_pass, rates, out) < drop_below:
                        out[i + 1 :] = np.nan
                        rates[i + 1 :] = np.nan
                        return written
            k = last
    return written
