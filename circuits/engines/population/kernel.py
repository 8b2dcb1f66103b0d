"""The ticks of the population engine, compiled: many trials run in parallel lanes of registers.

A group of ``LANES`` trials shares every loop, one trial per lane. Lanes are independent: the result
of a trial is the same to the bit, whatever the others are. A trial that ends is replaced by the
next, whose clock starts then. Input within the next ticks, up to the shortest delay, is known in
advance, so each block in turn is advanced through a window of ticks.

The compiler vectorises a loop over lanes if it sees that their number is a multiple of ``LANES``,
that no index is negative (``_at``), and that rows of one array are a fixed distance apart.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from llvmlite import ir
from numba import types

from circuits.declaration.transfer import MOST_NATS
from circuits.engines.compiling import compiled
from circuits.engines.ensemble.lanes import exp32, fused, tick_key, word32
from circuits.engines.ensemble.registers import instruction

LANES = 64
WHOLE = -LANES
WINDOW = 4
"""Most ticks that a block is advanced at a time: those of one key of noise."""
REFRESH = 16
"""Ticks between updates of a block's filter coefficients to its state."""
LOOKED_UP = 0
_NAMES = ("linear", "rectified", "saturating", "ramp", "exp", "s_minus_log_s")
TRANSFERS = {name: code for code, name in enumerate(_NAMES, 1)}
LINEAR, RECTIFIED, SATURATING, RAMP, EXP, S_MINUS_LOG_S = TRANSFERS.values()
"""Transfers with a dedicated loop; any other law is interpolated in a table."""
HEARD, ACTIVE, NOISE = range(3)
"""Rows of a block's working values: its input, its activity, and the noise of its cells."""
X, LAST, LOW, MEAN, SLOPE, FIRST, SECOND = 0, 1, 2, 3, 4, 5, 8
"""Rows of a block's state: its input filter and that filter's last input; the input filtered by the
cells' lags, its running mean and its slope; three rows for each section of the noise's filter."""
FOLLOWING, SECTION, COEFFICIENTS = 6, 5, 16
"""Numbers of coefficients: of the rate's filter, of a section of the noise's filter, and of all."""
VALUE_ROWS, UNIT_ROWS, STATE_ROWS = 3, 2, 11
EMPTY = -1
ZERO, ONE, HALF = np.float32(0), np.float32(1), np.float32(0.5)
MOST, ENDLESS = np.float32(MOST_NATS), np.float32(np.inf)
SIXTEEN, ROOT = np.float32(16), np.float32(8**-0.5)


@instruction(types.float32, types.uint32)
def ones32(builder, word):
    """Return the number of ones in a word, as float32."""
    return builder.uitofp(builder.ctpop(word), ir.FloatType())


@numba.njit(inline="always")
def _at(row, lane):
    """Return the index of a lane of a row in a flat array: unsigned, so that it is not wrapped."""
    return np.uint64(row * LANES + lane)


@numba.njit(inline="always")
def _within(at, last):
    """Return an index from 0 to the last; NaN maps to 0, so that no index is out of range."""
    at = at if at > ZERO else ZERO
    return at if at < last else last


@compiled
def _fill(n, values, row, value):
    for i in range(n & WHOLE):
        values[_at(row, i)] = value


@compiled
def _add(n, weight, values, row, source, place):
    """Add a weighted row of a source to a row of values."""
    for i in range(n & WHOLE):
        j = _at(row, i)
        values[j] = fused(weight, source[_at(place, i)], values[j])


@compiled
def _low_pass(n, gain, before, values, row, state, new, last):
    """Low-pass a row of values in place, interpolated linearly between ticks."""
    for i in range(n & WHOLE):
        value, old = values[_at(row, i)], state[_at(new, i)]
        moved = fused(gain, value - old, fused(before, state[_at(last, i)] - value, old))
        state[_at(last, i)] = value
        state[_at(new, i)] = moved
        values[_at(row, i)] = moved


@compiled
def _s_minus_log_s(n, values, row, into):
    for i in range(n & WHOLE):
        x = values[_at(row, i)]
        values[_at(into, i)] = np.float32(x - math.log(x)) if x > ZERO else ZERO


@compiled
def _exp(n, values, row, into):
    for i in range(n & WHOLE):
        values[_at(into, i)] = exp32(values[_at(row, i)])


@compiled
def _clip(n, values, row, into, most):
    for i in range(n & WHOLE):
        values[_at(into, i)] = min(max(values[_at(row, i)], ZERO), most)


@compiled
def _apply(n, law, values, row, into, lowest, per, points):
    """Apply a law to a row of values, and write the result to a row."""
    if law == LINEAR:
        for i in range(n & WHOLE):
            values[_at(into, i)] = values[_at(row, i)]
    elif law == RECTIFIED:
        _clip(n, values, row, into, ENDLESS)
    elif law == SATURATING:
        _clip(n, values, row, into, MOST)
    elif law == RAMP:
        _clip(n, values, row, into, ONE)
    elif law == EXP:
        _exp(n, values, row, into)
    elif law == S_MINUS_LOG_S:
        _s_minus_log_s(n, values, row, into)
    else:
        _look_up(n, values, row, into, lowest, per, points)


@compiled
def _look_up(n, values, row, into, lowest, per, points):
    """Interpolate a law tabulated at even steps, into a row; it is linear beyond the ends."""
    last = np.float32(len(points) - 2)
    for i in range(n & WHOLE):
        at = (values[_at(row, i)] - lowest) * per
        k = np.int32(_within(at, last))
        low, high = points[np.uint32(k)], points[np.uint32(k) + np.uint32(1)]
        values[_at(into, i)] = fused(at - np.float32(k), high - low, low)


@compiled
def _look_up_coefficients(n, table, state, lowest, per, indices, found):
    """Look up the coefficients nearest to each lane's state in a table."""
    last = np.float32(len(table) // COEFFICIENTS - 1)
    for i in range(n & WHOLE):
        at = (state[_at(MEAN, i)] - lowest) * per + HALF
        indices[np.uint64(i)] = np.int32(_within(at, last)) * np.int32(COEFFICIENTS)
    for c in range(COEFFICIENTS):
        for i in range(n & WHOLE):
            found[_at(c, i)] = table[np.uint32(indices[np.uint64(i)]) + np.uint32(c)]


@compiled
def _drift(n, slowly, values, state):
    """Update the running mean of the input; it selects coefficients, without following noise."""
    for i in range(n & WHOLE):
        old = state[_at(MEAN, i)]
        state[_at(MEAN, i)] = fused(slowly, values[_at(HEARD, i)] - old, old)


@compiled
def _follow(n, found, values, state):
    """Filter the input by the cells' lags (``filters.propagated``), in place."""
    for i in range(n & WHOLE):
        u, v = values[_at(HEARD, i)], state[_at(SLOPE, i)]
        middle = HALF * (u + state[_at(LAST, i)])
        old = state[_at(LOW, i)] - middle
        low = fused(found[_at(0, i)], old, fused(found[_at(1, i)], v, middle))
        v = fused(found[_at(2, i)], old, found[_at(3, i)] * v)
        state[_at(LAST, i)] = u
        state[_at(LOW, i)] = low
        state[_at(SLOPE, i)] = v
        values[_at(HEARD, i)] = fused(found[_at(4, i)], low - u, fused(found[_at(5, i)], v, u))


@compiled
def _draw(n, keys, index, values):
    """Draw near-Gaussian noise of unit variance: ``noise.bits32``."""
    for i in range(n & WHOLE):
        word = word32(index, keys[np.uint64(i)])
        values[_at(NOISE, i)] = (ones32(word) - SIXTEEN) * ROOT


@compiled
def _section(n, found, c, values, state, s):
    """Filter the noise in place by a second-order section (``filters.sampled``).

    Except for the response to a constant, the output is a difference between ticks, which sums to
    zero in the long run even if the coefficients change with the state.
    """
    for i in range(n & WHOLE):
        e, last, before = values[_at(NOISE, i)], state[_at(s, i)], state[_at(s + 1, i)]
        new = fused(found[_at(c + 1, i)], e, found[_at(c + 2, i)] * state[_at(s + 2, i)])
        new = fused(-found[_at(c + 3, i)], last, fused(-found[_at(c + 4, i)], before, new))
        state[_at(s, i)] = new
        state[_at(s + 1, i)] = last
        state[_at(s + 2, i)] = e
        values[_at(NOISE, i)] = fused(found[_at(c, i)], e, new - last)


@compiled
def _send(n, baseline, hz_per_nat, floor, noise, values, ring, place):
    """Turn activity into a rate, with the noise of a finite number of cells."""
    for i in range(n & WHOLE):
        ring[_at(place, i)] = max(fused(hz_per_nat, values[_at(ACTIVE, i)], baseline), floor)
    if noise > ZERO:
        for i in range(n & WHOLE):
            rate = ring[_at(place, i)]
            each = noise * np.float32(math.sqrt(max(rate, ZERO)))
            ring[_at(place, i)] = fused(each, values[_at(NOISE, i)], rate)


@numba.njit(inline="always")
def _place(places, i, t, table):
    """Return the column of a lane's tick in a table; ticks beyond the end have the last one."""
    return np.uint64(min(places[np.uint64(i)] + t, table.shape[1] - 1))


@compiled
def _scale(n, factors, row, places, t, passed, jumps):
    """Multiply the output of a unit by its factor; record the size of the jump.

    A factor is constant within a tick, so the filters must not interpolate across a jump.
    """
    if factors is None:
        return
    if row == 0:
        return
    for i in range(n & WHOLE):
        k = _place(places, i, t, factors)
        factor, active, before = factors[row, k], passed[_at(t, i)], jumps[_at(WINDOW, i)]
        jumps[_at(t, i)] = (factor - factors[row, k - np.uint64(1)]) * before
        jumps[_at(WINDOW, i)] = active
        passed[_at(t, i)] = factor * active


@compiled
def _jump(n, factors, p, jumps, b, t, state):
    """Start a block's filter from the input that it would have had at this tick's factors."""
    if factors is None:
        return
    for e in range(p.blocks[b].input, p.blocks[b].inputs):
        if p.units[p.inputs[e].index].course:
            _add(n, p.inputs[e].weight, state, LAST, jumps[p.inputs[e].index], t)


@compiled
def _push(n, nats, row, places, t, values, state):
    """Add the nats of a course to a block in a tick, constant within the tick."""
    if nats is None:
        return
    if row == 0:
        return
    for i in range(n & WHOLE):
        k = _place(places, i, t, nats)
        values[_at(HEARD, i)] += nats[row, k]
        state[_at(LAST, i)] += nats[row, k] - nats[row, k - np.uint64(1)]


@compiled
def _find_places(factors, places, begun, first):
    """Find the column of each lane's next tick in the tables of courses."""
    if factors is None:
        return
    for lane in range(LANES):
        places[lane] = first - begun[lane] + 1


@numba.njit(inline="always")
def _arrive(p, work, q, first):
    """Advance a unit through a window: filter and transform the output of its sources."""
    n, mask = len(work.keys), work.ring.shape[1] // LANES - 1
    unit, passed = p.units[q], work.passed[q]
    for t in range(p.clock[0].window):
        _fill(n, passed, t, ZERO)
        place = (first + t - unit.delay) & mask
        for e in range(unit.source, unit.sources):
            _add(n, p.sources[e].weight, passed, t, work.ring[p.sources[e].index], place)
        _low_pass(n, unit.gain, unit.before, passed, t, work.units[q], 0, 1)
        constant = unit.constant
        for i in range(n & WHOLE):
            passed[_at(t, i)] += constant
        if unit.law != LINEAR:
            _apply(n, unit.law, passed, t, t, unit.lowest, unit.per, p.laws[unit.column])
        _scale(n, p.factors, unit.course, work.places, t, passed, work.jumps[q])


@numba.njit(inline="always")
def _hear(p, work, b, t):
    """Write the input of a block in a tick of the window to its row, nats."""
    n, block, values = len(work.keys), p.blocks[b], work.values
    _fill(n, values, HEARD, block.bias)
    for e in range(block.input, block.inputs):
        _add(n, p.inputs[e].weight, values, HEARD, work.passed[p.inputs[e].index], t)
    if block.drive >= 0:
        _add(n, ONE, values, HEARD, work.drive[b], 0)
    _jump(n, p.factors, p, work.jumps, b, t, work.states[b])
    _push(n, p.nats, block.course, work.places, t, values, work.states[b])
    if block.gain < ONE:
        _low_pass(n, block.gain, block.before, values, HEARD, work.states[b], X, LAST)


@numba.njit(inline="always")
def _noise(work, b, k):
    """Filter the noise of a tick."""
    n, values, state, found = len(work.keys), work.values, work.states[b], work.coefficients[b]
    _draw(n, work.keys, k & 3, values)
    _section(n, found, FOLLOWING, values, state, FIRST)
    _section(n, found, FOLLOWING + SECTION, values, state, SECOND)


@compiled
def _advance(p, work, b, first):
    """Advance a block through the ticks of a window."""
    n, mask, block = len(work.keys), work.ring.shape[1] // LANES - 1, p.blocks[b]
    values, state, keys = work.values, work.states[b], work.keys
    if block.noise > ZERO:
        streams, begun = work.streams[b], work.begun
        for i in range(n & WHOLE):
            j = np.uint64(i)
            keys[j] = tick_key(streams[j], (first - begun[j]) >> 2)
    if block.table >= 0 and first % p.clock[0].refresh == 0:
        _look_up_coefficients(n, p.tables[block.table], state, block.state_lowest, block.state_per,
                              work.indices, work.coefficients[b])  # fmt: skip
    for k in range(first, first + p.clock[0].window):
        _hear(p, work, b, k - first)
        if block.table >= 0:
            _drift(n, p.clock[0].follow_slowly, values, state)
        if block.lags:
            _follow(n, work.coefficients[b], values, state)
        _apply(n, block.law, values, HEARD, ACTIVE, block.lowest, block.per, p.laws[block.column])
        if block.noise > ZERO:
            _noise(work, b, k)
        _send(n, block.baseline, block.hz_per_nat, block.floor, block.noise, values, work.ring[b],
              k & mask)  # fmt: skip


@numba.njit(inline="always")
def _read(p, work, place):
    """Low-pass the read-out (step 4 of the scheme), and sum up rates."""
    n, gain, before = len(work.keys), p.clock[0].readout_gain, p.clock[0].readout_before
    past = (place - 1) & (work.ring.shape[1] // LANES - 1)
    for c in range(len(p.readout)):
        low, rates = work.low_pass[c], work.ring[p.readout[c]]
        for i in range(n & WHOLE):
            j, now = _at(0, i), rates[_at(place, i)]
            moved = fused(before, rates[_at(past, i)] - now, low[j])
            low[j] = fused(gain, now - low[j], moved)
    if work.kept:
        for b in range(len(p.blocks)):
            _add(n, ONE, work.totals[b], 0, work.ring[b], place)


@compiled
def _load(p, work, lane, trial, first, streams):
    """Start a trial in a lane, at rest."""
    work.trial[lane], work.begun[lane] = trial, first
    clock = p.clock[0]
    work.samples[lane] = -((clock.settle + clock.sample - 1) // clock.sample)
    for b in range(len(p.blocks)):
        block = p.blocks[b]
        for k in range(work.ring.shape[1] // LANES):
            work.ring[b, k * LANES + lane] = block.rest_hz
        for k in range(STATE_ROWS):
            work.states[b, k * LANES + lane] = block.rest_x if k < SLOPE else ZERO
        work.totals[b, lane] = ZERO
        if trial != EMPTY and len(streams):
            work.streams[b, lane] = streams[trial, b]
    for q in range(len(p.units)):
        for k in range(UNIT_ROWS):
            work.units[q, k * LANES + lane] = p.units[q].rest
        work.jumps[q, WINDOW * LANES + lane] = p.units[q].passed
    for c in range(len(p.readout)):
        work.low_pass[c, lane] = p.blocks[p.readout[c]].rest_hz
    for b in p.driven:
        work.drive[b, lane] = ZERO


@numba.njit(inline="always")
def _record(p, work, lane, sample, place, out, rates):
    """Record a sample of a lane; return its lowest OUT, or NaN if rates diverge."""
    clock, trial, least = p.clock[0], work.trial[lane], np.inf
    for b in range(len(p.blocks)):
        if not abs(work.ring[b, place * LANES + lane]) < clock.runaway_hz:
            return np.nan
    for c in range(len(p.readout)):
        value = work.low_pass[c, lane]
        out[trial, sample, c] = (value - clock.readout_baseline) / clock.readout_hz_per_nat
        least = min(least, out[trial, sample, c])
    if work.kept:
        for b in range(len(p.blocks)):
            rates[trial, sample, b] = work.totals[b, lane] / np.float32(clock.sample)
    return least


@numba.njit(inline="always")
def _sample(p, work, place, level, out, rates):
    """Record a sample of every lane whose evidence has begun.

    Returns the number of trials that ended, or ``-1 - sample`` if rates diverged at that sample.
    """
    over = 0
    for lane in range(LANES):
        if work.trial[lane] == EMPTY:
            continue
        sample = work.samples[lane]
        work.samples[lane] = sample + 1
        if sample >= 0:
            least = _record(p, work, lane, sample, place, out, rates)
            if math.isnan(least):
                return -1 - sample
            if least < level or sample + 1 == out.shape[1]:
                out[work.trial[lane], sample + 1 :] = np.nan
                if work.kept:
                    rates[work.trial[lane], sample + 1 :] = np.nan
                work.trial[lane] = EMPTY
                over += 1
        if work.kept:
            for b in range(len(p.blocks)):
                work.totals[b, lane] = ZERO
    return over


@numba.njit(inline="always")
def _hold(p, work, first, drive):
    """Set each lane's reading for a window; filters must not interpolate across its jump."""
    clock = p.clock[0]
    _find_places(p.factors, work.places, work.begun, first)
    for lane in range(LANES):
        late = first - work.begun[lane] - clock.settle
        if work.trial[lane] != EMPTY and late >= 0 and late % clock.step == 0:
            reading = drive[work.trial[lane], late // clock.step]
            for b in p.driven:
                new = np.float32(reading[p.blocks[b].drive] * p.blocks[b].drive_gain)
                work.states[b, LAST * LANES + lane] += new - work.drive[b, lane]
                work.drive[b, lane] = new


@compiled
def _window(p, work, first, drive, level, out, rates):
    """Run a window of ticks; return the number of trials that ended, or ``-1 - sample``."""
    clock, mask, ended = p.clock[0], work.ring.shape[1] // LANES - 1, 0
    _hold(p, work, first, drive)
    for q in range(len(p.units)):
        _arrive(p, work, q, first)
    for b in range(len(p.blocks)):
        _advance(p, work, b, first)
    for k in range(first, first + clock.window):
        _read(p, work, k & mask)
        if (k + 1 - clock.settle) % clock.sample == 0:
            over = _sample(p, work, k & mask, level, out, rates)
            if over < 0:
                return over
            ended += over
    return ended


@compiled
def trials(p, work, drive, streams, level, out, rates):
    """Run trials.

    Parameters
    ----------
    p, work : Plan, Work
    drive : array (trials, steps, channels), nats
    streams : array (trials, blocks) uint64, or (0, 0) without noise
    level : float
        OUT below which a trial ends.
    out, rates : arrays (trials, samples, channels), (trials, samples, blocks or 0)
        Written here; NaN after the end of a trial.

    Returns
    -------
    int
        0, or 1 plus the first sample at which rates diverged.
    """
    clock, waiting, running, first = p.clock[0], 0, 0, 0
    work.trial[:] = EMPTY
    while running or waiting < len(drive):
        if first % clock.start == 0 and (waiting < len(drive) or first == 0):
            for lane in range(LANES):
                if work.trial[lane] == EMPTY and (waiting < len(drive) or first == 0):
                    trial = waiting if waiting < len(drive) else EMPTY
                    _load(p, work, lane, trial, first, streams)
                    waiting, running = waiting + (trial != EMPTY), running + (trial != EMPTY)
        over = _window(p, work, first, drive, level, out, rates)
        if over < 0:
            return -over
        running -= over
        first += clock.window
    return 0


@compiled
def begin(p, work, streams):
    """Start one trial, at rest, in the first lane."""
    work.trial[:] = EMPTY
    for lane in range(LANES):
        _load(p, work, lane, 0 if lane == 0 else EMPTY, 0, streams)


@compiled
def go_on(p, work, drive, out, rates, start, end):
    """Run the ticks from ``start`` to ``end``, as ``trials`` runs those of a whole trial."""
    for first in range(start, end, p.clock[0].window):
        over = _window(p, work, first, drive, -np.inf, out, rates)
        if over < 0:
            return -over
    return 0
