"""The ticks of the population engine, compiled: a group of trials advances together.

Each of the ``LANES`` trials of a group has one number, its lane, in every row of an array. Lanes
are independent: the result of a trial is the same to the bit, whatever the others are. A trial that
ends is replaced by the next, whose clock starts then. Input within the next ticks, up to the
shortest delay, is known in advance, so each block in turn is advanced through a window of ticks.

The compiler turns a loop over lanes into vector instructions if it sees that their number is a
multiple of a vector's, but not which, that no index is negative, and that no place in an array is
itself read from an array.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

from __future__ import annotations

import math

import numba
import numpy as np

from circuits.declaration.transfer import MOST_NATS
from circuits.engines.compiling import compiled, part
from circuits.engines.spikes.lanes import (
    exp32,
    fused,
    lowbias32,
    ones8,
    ones_at,
    take_number,
    tick_key,
)

LANES = 32
"""Trials of a group. A trial of 16 costs more; a few trials cost as much as a group."""
WHOLE = -LANES
WINDOWS = {1: (0,), 2: (0, 1), 4: (0, 1, 2, 3)}
"""Ticks through which a block is advanced at a time, by their number, which the compiler knows from
the length of the tuple. A byte of noise serves a tick, so that a word serves the longest window."""
WINDOW = max(WINDOWS)
WORD_TICKS, KEY_TICKS = 4, 16
"""Ticks that share a word of noise, and a key."""
LOOKED_UP = 0
_NAMES = ("linear", "rectified", "saturating", "ramp", "exp", "s_minus_log_s")
TRANSFERS = {name: code for code, name in enumerate(_NAMES, 1)}
LINEAR, RECTIFIED, SATURATING, RAMP, EXP, S_MINUS_LOG_S = TRANSFERS.values()
"""The included transfers, with a dedicated loop; any other law is interpolated in a table."""
X, LAST, LOW, MEAN, SLOPE, FIRST, SECOND, AMPLITUDE = 0, 1, 2, 3, 4, 5, 8, 11
"""Rows of a block's state: its input filter and that filter's last input; the input filtered by the
cells' lags, its running mean and its slope; three rows for each section of the noise's filter; and
the amplitude of the noise."""
FOLLOWING, SECTION, COEFFICIENTS = 6, 5, 16
"""Numbers of coefficients: of the rate's filter, of a section of the noise's filter, and of all."""
UNIT, PASSED = 0, 2
"""Rows of a unit's state: its filter, that filter's last input, and its activity before it is
multiplied by a factor."""
UNIT_ROWS, STATE_ROWS = 3, 12
OF_LANES = ("trial", "begun", "samples", "reading", "due", "places")
"""Whole numbers of each lane: its trial, that trial's first tick, numbers of samples and readings
so far, tick of the next reading, and column of the next tick in the tables of courses."""
EMPTY = -1
ZERO, ONE, HALF = np.float32(0), np.float32(1), np.float32(0.5)
MOST, ENDLESS = np.float32(MOST_NATS), np.float32(np.inf)
CENTRE = np.float32(-(8.0**0.5))
PER_ONE = np.float32(0.5**0.5)
"""Noise of zero mean and unit variance from the ones of a byte."""


@numba.njit(inline="always")
def _at(row, lane):
    """Return the place of a lane in a row of a flat array: unsigned, so that it is not wrapped."""
    return np.uint64(row * LANES + lane)


@numba.njit(inline="always")
def _lanes(values):
    """Return ``LANES``, from an array of ``WINDOW`` rows.

    The compiler must not know the number, or it unrolls a loop over lanes instead of vectorising.
    """
    return len(values) // WINDOW & WHOLE


@numba.njit(inline="always")
def _low_passed(gain, before, value, old, last):
    """Return the next state of a low-pass of values interpolated linearly between ticks."""
    return fused(gain, value - old, fused(before, last - value, old))


@part
def _s_minus_log_s(n, values):
    for i in range(n & WHOLE):
        x = values[np.uint64(i)]
        values[np.uint64(i)] = np.float32(x - math.log(x)) if x > ZERO else ZERO


@part
def _exp(n, values):
    for i in range(n & WHOLE):
        values[np.uint64(i)] = exp32(values[np.uint64(i)])


@part
def _clip(n, values, highest):
    for i in range(n & WHOLE):
        values[np.uint64(i)] = min(max(values[np.uint64(i)], ZERO), highest)


@part
def _look_up(n, values, lowest, per, points, found):
    """Interpolate a law tabulated at even steps; it is linear beyond the ends.

    Separate loops, since one that reads the table at computed places is not vectorised.
    """
    below, firsts, nexts = found
    last = np.float32(len(points) - 2)
    for i in range(n & WHOLE):
        j = np.uint64(i)
        at = (values[j] - lowest) * per
        # Not a number maps to 0, so that no index is out of range.
        within = at if at > ZERO else ZERO
        below[j] = np.int32(within if within < last else last)
        values[j] = at - np.float32(below[j])
    for i in range(n & WHOLE):
        j = np.uint64(i)
        k = np.uint64(below[j])
        firsts[j], nexts[j] = points[k], points[k + np.uint64(1)]
    for i in range(n & WHOLE):
        j = np.uint64(i)
        values[j] = fused(values[j], nexts[j] - firsts[j], firsts[j])


@part
def _apply(n, law, values, lowest, per, points, found):
    if law == RECTIFIED:
        _clip(n, values, ENDLESS)
    elif law == SATURATING:
        _clip(n, values, MOST)
    elif law == RAMP:
        _clip(n, values, ONE)
    elif law == EXP:
        _exp(n, values)
    elif law == S_MINUS_LOG_S:
        _s_minus_log_s(n, values)
    elif law == LOOKED_UP:
        _look_up(n, values, lowest, per, points, found)


@part
def _refresh(p, work, b):
    """Look up the coefficients nearest to each lane's state."""
    block, state = p.blocks[b], work.states[b]
    table = p.tables[block.table]
    last = np.float32(len(table) // COEFFICIENTS - 1)
    for lane in range(LANES):
        at = (state[MEAN * LANES + lane] - block.state_lowest) * block.state_per + HALF
        # Not a number maps to 0, so that no index is out of range.
        at = at if at > ZERO else ZERO
        row = np.int32(at if at < last else last) * COEFFICIENTS
        for k in range(COEFFICIENTS):
            work.coefficients[b, k * LANES + lane] = table[np.uint64(row + k)]


@part
def _derive(work, b, first):
    """Derive the keys of a block's noise for the next ticks."""
    for lane in range(LANES):
        key = tick_key(work.streams[b, lane], (first - work.begun[lane]) // KEY_TICKS)
        work.keys[b, lane] = np.uint32(key >> np.uint64(32))
        work.keys[b, LANES + lane] = np.uint32(key)


@part
def _hear(p, work, b, ticks):
    """Write the input of a block in each tick of the window, nats."""
    block, values = p.blocks[b], work.values
    lanes = _lanes(values)
    n = len(ticks) * lanes
    if block.input == block.inputs:
        values[:] = block.bias
    for e in range(block.input, block.inputs):
        one, heard = p.inputs[e], work.passed[p.inputs[e].index]
        if e == block.input:
            _begin(values, block.bias, one.weight, heard, n)
        else:
            _add(values, one.weight, heard, n)
    if block.drive >= 0:
        reading = work.drive[b]
        for t in range(len(ticks)):
            for i in range(lanes):
                values[_at(t, i)] += reading[np.uint64(i)]


@part
def _begin(values, bias, weight, others, n):
    for i in range(n & WHOLE):
        values[np.uint64(i)] = fused(weight, others[np.uint64(i)], bias)


@part
def _add(values, weight, others, n):
    for i in range(n & WHOLE):
        values[np.uint64(i)] = fused(weight, others[np.uint64(i)], values[np.uint64(i)])


@part
def _filter(gain, before, state, values, shifts, ticks):
    for i in range(_lanes(values)):
        x, last = state[_at(X, i)], state[_at(LAST, i)]
        for t in range(len(ticks)):
            value = values[_at(t, i)]
            x = _low_passed(gain, before, value, x, _shifted(last, shifts, t, i))
            last = value
            values[_at(t, i)] = x
        state[_at(X, i)], state[_at(LAST, i)] = x, last


@numba.njit(inline="always")
def _shifted(last, shifts, t, i):
    """Return a filter's last input as it would have been at this tick's factors and courses."""
    if shifts is None:
        return last
    return last + shifts[_at(t, i)]


@part
def _drift(slowly, state, values, ticks):
    """Update the running mean of the input; it selects coefficients, without following noise."""
    for i in range(_lanes(values)):
        mean = state[_at(MEAN, i)]
        for t in range(len(ticks)):
            mean = fused(slowly, values[_at(t, i)] - mean, mean)
        state[_at(MEAN, i)] = mean


@part
def _follow(coeffs, state, values, shifts, ticks):
    """Filter the input by the cells' lags (``filters.propagated``), in place."""
    for i in range(_lanes(values)):
        last, low, v = state[_at(LAST, i)], state[_at(LOW, i)], state[_at(SLOPE, i)]
        c0, c1, c2 = coeffs[_at(0, i)], coeffs[_at(1, i)], coeffs[_at(2, i)]
        c3, c4, c5 = coeffs[_at(3, i)], coeffs[_at(4, i)], coeffs[_at(5, i)]
        for t in range(len(ticks)):
            u = values[_at(t, i)]
            middle = HALF * (u + _shifted(last, shifts, t, i))
            old, last = low - middle, u
            low = fused(c0, old, fused(c1, v, middle))
            v = fused(c2, old, c3 * v)
            values[_at(t, i)] = fused(c4, low - u, fused(c5, v, u))
        state[_at(LAST, i)], state[_at(LOW, i)], state[_at(SLOPE, i)] = last, low, v


@part
def _count(counts, keys, first):
    """Write the ones in the bytes of each lane's word, that of the window's first tick lowest."""
    index = (first // WORD_TICKS) % (KEY_TICKS // WORD_TICKS)
    lanes, byte = len(counts) & WHOLE, first % WORD_TICKS
    for i in range(lanes):
        counts[np.uint64(i)] = lowbias32(index, keys[_at(0, i)], keys[_at(1, i)])
    octets = counts.view(np.uint8)
    for i in range(4 * lanes):
        octets[np.uint64(i)] = ones8(octets[np.uint64(i)])
    if byte:
        for i in range(lanes):
            counts[np.uint64(i)] >>= np.uint32(8 * byte)


@part
def _fluctuate(each, coeffs, state, counts, ring, place, fresh, ticks):
    """Add near-Gaussian noise with the spectrum of the cells to rates, by two sections of a filter.

    Except for the response to a constant, the output of a section (``filters.sampled``) is a
    difference between ticks, which sums to 0 in the long run even if the coefficients change. The
    amplitude is that of the rate at the first of the ticks that share a word.
    """
    lanes = len(counts) & WHOLE
    if fresh:
        for i in range(lanes):
            rate = ring[np.uint64(place + i)]
            state[_at(AMPLITUDE, i)] = each * math.sqrt(rate if rate > ZERO else ZERO)
    for i in range(lanes):
        word, amplitude = counts[np.uint64(i)], state[_at(AMPLITUDE, i)]
        first, second = _section(coeffs, FOLLOWING, i), _section(coeffs, FOLLOWING + SECTION, i)
        old, older = _kept(state, FIRST, i), _kept(state, SECOND, i)
        for t in range(len(ticks)):
            e, old = _sampled(first, old, fused(PER_ONE, ones_at(word, t), CENTRE))
            e, older = _sampled(second, older, e)
            j = np.uint64(place + t * LANES + i)
            ring[j] = fused(amplitude, e, ring[j])
        for k in range(3):
            state[_at(FIRST + k, i)], state[_at(SECOND + k, i)] = old[k], older[k]


@numba.njit(inline="always")
def _section(coeffs, c, i):
    """Return the coefficients of a section of the noise's filter."""
    top, top1 = coeffs[_at(c + 1, i)], coeffs[_at(c + 2, i)]
    return coeffs[_at(c, i)], top, top1, coeffs[_at(c + 3, i)], coeffs[_at(c + 4, i)]


@numba.njit(inline="always")
def _kept(state, s, i):
    return state[_at(s, i)], state[_at(s + 1, i)], state[_at(s + 2, i)]


@numba.njit(inline="always")
def _sampled(section, state, e):
    """Return the output of a section, and its next state."""
    held, top, top1, low1, low2 = section
    last, before, old = state
    new = fused(top, e, top1 * old) - fused(low1, last, low2 * before)
    return fused(held, e, new - last), (new, last, e)


@part
def _send(block, values, ring, place, ticks):
    """Turn activity into a rate."""
    gain, base, floor = block.hz_per_nat, block.baseline, block.floor
    for i in range(len(ticks) * _lanes(values)):
        rate = fused(gain, values[np.uint64(i)], base)
        ring[np.uint64(place + i)] = rate if rate > floor else floor


@part
def _sum_up(total, ring, place, lanes, ticks):
    for i in range(lanes):
        summed = total[np.uint64(i)]
        for t in range(len(ticks)):
            summed += ring[np.uint64(place + t * LANES + i)]
        total[np.uint64(i)] = summed


@numba.njit(inline="always")
def _place(places, i, t, table):
    """Return the column of a lane's tick in a table; ticks beyond the end have the last one."""
    return np.uint64(min(places[np.uint64(i)] + t, table.shape[1] - 1))


@part
def _scale(factors, row, places, t, passed, jumps, state):
    """Multiply the output of a unit by its factor; record the size of the jump.

    A factor is constant within a tick, so the filters must not interpolate across a jump.
    """
    if factors is None:
        return
    for i in range(LANES):
        k, j = _place(places, i, t, factors), t * LANES + i
        factor, active, before = factors[row, k], passed[j], state[PASSED * LANES + i]
        jumps[j] = (factor - factors[row, k - np.uint64(1)]) * before
        state[PASSED * LANES + i] = active
        passed[j] = factor * active


@part
def _shift(p, work, shifts, b, ticks):
    """Add a block's courses to its input; write the jumps that its filter must not interpolate."""
    if shifts is None:
        return
    block = p.blocks[b]
    shifts[:] = ZERO
    for e in range(block.input, block.inputs):
        q, weight = p.inputs[e].index, p.inputs[e].weight
        if p.units[q].course:
            for i in range(len(ticks) * LANES):
                shifts[i] += weight * work.jumps[q, i]
    if block.course:
        for t in range(len(ticks)):
            for i in range(LANES):
                k = _place(work.places, i, t, p.nats)
                nats = p.nats[block.course, k]
                work.values[t * LANES + i] += nats
                shifts[t * LANES + i] += nats - p.nats[block.course, k - np.uint64(1)]


@part
def _find_places(factors, places, begun, first):
    """Find the column of each lane's next tick in the tables of courses."""
    if factors is None:
        return
    for lane in range(LANES):
        places[lane] = first - begun[lane] + 1


@part
def _arrive(p, work, q, first, ticks):
    """Advance a unit through a window: filter and transform the output of its sources."""
    mask, unit, passed = work.ring.shape[1] // LANES - 1, p.units[q], work.passed[q]
    lanes = _lanes(passed)
    n = len(ticks) * lanes
    if unit.source == unit.sources:
        passed[:] = ZERO
    for e in range(unit.source, unit.sources):
        weight, rates = p.sources[e].weight, work.ring[p.sources[e].index]
        past = (first - unit.delay) & mask
        turn = min((mask + 1 - past) * lanes, n)
        if e == unit.source:
            _begin(passed, ZERO, weight, rates[past * LANES :], turn)
            _begin(passed[turn:], ZERO, weight, rates, n - turn)
        else:
            _add(passed, weight, rates[past * LANES :], turn)
            _add(passed[turn:], weight, rates, n - turn)
    _pass(unit.gain, unit.before, unit.constant, work.units[q], passed, ticks)
    if unit.law != LINEAR:
        _apply(n, unit.law, passed, unit.lowest, unit.per, p.laws[unit.column], work.found)
    if unit.course:
        for t in range(len(ticks)):
            _scale(p.factors, unit.course, work.places, t, passed, work.jumps[q], work.units[q])


@part
def _pass(gain, before, constant, state, passed, ticks):
    for i in range(_lanes(passed)):
        low, last = state[_at(UNIT, i)], state[_at(UNIT + 1, i)]
        for t in range(len(ticks)):
            value = passed[_at(t, i)]
            low, last = _low_passed(gain, before, value, low, last), value
            passed[_at(t, i)] = low + constant
        state[_at(UNIT, i)], state[_at(UNIT + 1, i)] = low, last


@part
def _advance(p, work, b, first, ticks):
    block, values, state, coeffs = p.blocks[b], work.values, work.states[b], work.coefficients[b]
    if block.table >= 0 and first % p.clock[0].refresh == 0:
        _refresh(p, work, b)
    if block.noise > ZERO and first % KEY_TICKS == 0:
        _derive(work, b, first)
    _hear(p, work, b, ticks)
    _shift(p, work, work.shifts, b, ticks)
    if block.gain < ONE:
        _filter(block.gain, block.before, state, values, work.shifts, ticks)
    if block.table >= 0:
        _drift(p.clock[0].follow_slowly, state, values, ticks)
    lanes = _lanes(values)
    if block.lags:
        _follow(coeffs, state, values, work.shifts, ticks)
    n = len(ticks) * lanes
    _apply(n, block.law, values, block.lowest, block.per, p.laws[block.column], work.found)
    ring = work.ring[b]
    place = (first & (len(ring) // LANES - 1)) * LANES
    _send(block, values, ring, place, ticks)
    if block.noise > ZERO:
        _count(work.counts, work.keys[b], first)
        fresh = first % WORD_TICKS == 0
        _fluctuate(block.noise, coeffs, state, work.counts, ring, place, fresh, ticks)
    if work.kept:
        _sum_up(work.totals[b], ring, place, _lanes(values), ticks)


@part
def _read(p, work, k):
    """Low-pass the read-out (step 4 of the scheme)."""
    mask = work.ring.shape[1] // LANES - 1
    gain, before, lanes = p.clock[0].readout_gain, p.clock[0].readout_before, _lanes(work.values)
    for c in range(len(p.readout)):
        low, rates = work.low_pass[c], work.ring[p.readout[c]]
        now, past = k & mask, (k - 1) & mask
        for i in range(lanes):
            value, last = rates[_at(now, i)], rates[_at(past, i)]
            low[np.uint64(i)] = _low_passed(gain, before, value, low[np.uint64(i)], last)


@part
def _load(p, work, state, lane, first, trial, entry):
    """Start a trial in a lane, in an entry of the initial states."""
    mask, depth = work.ring.shape[1] // LANES - 1, state.ring.shape[2]
    work.trial[lane], work.begun[lane] = trial, first
    work.samples[lane], work.reading[lane], work.due[lane] = 0, 0, first
    work.soonest[0] = first
    for b in range(len(p.blocks)):
        for k in range(depth):
            place = (first - 1 - k) & mask
            work.ring[b, place * LANES + lane] = state.ring[entry, b, k]
        for k in range(STATE_ROWS):
            work.states[b, k * LANES + lane] = state.blocks[entry, b, k]
        work.totals[b, lane] = ZERO
    for q in range(len(p.units)):
        for k in range(UNIT_ROWS):
            work.units[q, k * LANES + lane] = state.units[entry, q, k]
    for c in range(len(p.readout)):
        work.low_pass[c, lane] = state.low_pass[entry, c]
    for b in p.driven:
        work.drive[b, lane] = ZERO


@part
def _save(p, work, state, lane, after, ticks):
    """Save the state of a lane at the end of a window of some ticks, before tick ``after``."""
    mask, depth, entry = work.ring.shape[1] // LANES - 1, state.ring.shape[2], work.trial[lane]
    for b in range(len(p.blocks)):
        for k in range(depth):
            place = (after - 1 - k) & mask
            state.ring[entry, b, k] = work.ring[b, place * LANES + lane]
        for k in range(STATE_ROWS):
            state.blocks[entry, b, k] = work.states[b, k * LANES + lane]
    for q in range(len(p.units)):
        for k in range(UNIT_ROWS):
            state.units[entry, q, k] = work.units[q, k * LANES + lane]
        state.units[entry, q, PASSED] = work.passed[q, (ticks - 1) * LANES + lane]
    for c in range(len(p.readout)):
        state.low_pass[entry, c] = work.low_pass[c, lane]


@numba.njit(inline="always")
def _diverged(p, work, lane, k):
    """Return whether a rate of a lane is too high, or not a number."""
    place = (k & (work.ring.shape[1] // LANES - 1)) * LANES + lane
    diverged = False
    for b in range(len(p.blocks)):
        diverged |= not abs(work.ring[b, place]) < p.clock[0].runaway_hz
    return diverged


@part
def _decode(p, work):
    """Write OUT of every lane, and its lowest value over channels."""
    per, baseline = p.clock[0].readout_nats_per_hz, p.clock[0].readout_baseline
    work.lowest[:] = ENDLESS
    for c in range(len(p.readout)):
        for lane in range(LANES):
            value = (work.low_pass[c, lane] - baseline) * per
            work.out[c, lane] = value
            lowest = work.lowest[lane]
            work.lowest[lane] = lowest if lowest < value else value


@part
def _keep(p, work, rates):
    """Record the mean rates of every lane since the last sample."""
    per = ONE / np.float32(p.clock[0].sample)
    for lane in range(LANES):
        trial, sample = work.trial[lane], work.samples[lane]
        if trial != EMPTY:
            for b in range(len(p.blocks)):
                rates[trial, sample, b] = work.totals[b, lane] * per
    work.totals[:] = ZERO


@part
def _sample(p, work, k, level, out, rates, saved, ticks):
    """Record a sample of every lane.

    Returns the number of trials that ended, or ``-1 - sample`` if rates diverged at that sample.
    """
    over = 0
    _decode(p, work)
    if work.kept:
        _keep(p, work, rates)
    for lane in range(LANES):
        trial, sample = work.trial[lane], work.samples[lane]
        if trial == EMPTY:
            continue
        work.samples[lane] = sample + 1
        for c in range(len(p.readout)):
            out[trial, sample, c] = work.out[c, lane]
        ended = work.lowest[lane] < level or sample + 1 == out.shape[1]
        if (ended or (k + 1) % KEY_TICKS == 0) and _diverged(p, work, lane, k):
            return -1 - sample
        if ended:
            out[trial, sample + 1 :] = np.nan
            if work.kept:
                rates[trial, sample + 1 :] = np.nan
            if len(saved.ring):
                _save(p, work, saved, lane, k + 1, ticks)
            work.trial[lane] = EMPTY
            over += 1
    return over


@part
def _hold(p, work, first, drive):
    """Set each lane's reading for a window; filters must not interpolate across its jump."""
    _find_places(p.factors, work.places, work.begun, first)
    if first < work.soonest[0]:
        return
    soonest = np.int64(2**62)
    for lane in range(LANES):
        if work.due[lane] == first and work.trial[lane] != EMPTY:
            reading = drive[work.trial[lane], work.reading[lane]]
            work.reading[lane] += 1
            work.due[lane] += p.clock[0].step
            for b in p.driven:
                new = np.float32(reading[p.blocks[b].drive] * p.blocks[b].drive_gain)
                work.states[b, LAST * LANES + lane] += new - work.drive[b, lane]
                work.drive[b, lane] = new
        if work.trial[lane] != EMPTY:
            soonest = min(soonest, work.due[lane])
    work.soonest[0] = soonest


@part
def _window(p, work, first, drive, level, out, rates, saved, ticks):
    """Run a window of ticks; return the number of trials that ended, or ``-1 - sample``."""
    ended = 0
    _hold(p, work, first, drive)
    for q in range(len(p.units)):
        _arrive(p, work, q, first, ticks)
    for b in range(len(p.blocks)):
        _advance(p, work, b, first, ticks)
    for k in range(first, first + len(ticks)):
        _read(p, work, k)
        if (k + 1) % p.clock[0].sample == 0:
            over = _sample(p, work, k, level, out, rates, saved, len(ticks))
            if over < 0:
                return over
            ended += over
    return ended


@compiled
def trials(p, work, state, entries, drive, streams, level, out, rates, saved, ticks, next_trial):
    """Run trials until none is left, together with other threads.

    Return 0, or 1 plus the sample at which rates had diverged. ``entries`` are the initial states
    of trials in ``state``; the drive is (trials, steps, channels), nats; ``streams`` are (trials,
    blocks), or (0, 0) without noise; ``level`` is the OUT below which a trial ends. Written are
    ``out`` (trials, samples, channels) and ``rates`` (trials, samples, blocks or 0), NaN after the
    end, and the final states ``saved``, unless it has no rows. ``next_trial``
    (1,) is the first trial that no thread has begun, shared by all threads.
    """
    clock, running, first, left = p.clock[0], 0, 0, True
    work.trial[:] = EMPTY
    while running or left:
        if left and first % clock.start == 0:
            for lane in range(LANES):
                if work.trial[lane] == EMPTY and (left or first == 0):
                    trial = take_number(next_trial)
                    left = trial < len(drive)
                    # Lanes that never run a trial begin too: their numbers must be finite.
                    if left or first == 0:
                        entry = entries[trial if left else 0]
                        _load(p, work, state, lane, first, trial if left else EMPTY, entry)
                    if left and len(streams):
                        for b in range(len(p.blocks)):
                            work.streams[b, lane] = streams[trial, b]
                    running += left
        over = _window(p, work, first, drive, level, out, rates, saved, ticks)
        if over < 0:
            return -over
        running -= over
        first += len(ticks)
    return 0


@compiled
def begin(p, work, state, entry, streams):
    """Start one trial in the first lane."""
    for lane in range(LANES):
        _load(p, work, state, lane, 0, 0 if lane == 0 else EMPTY, entry)
    for b in range(len(p.blocks) if len(streams) else 0):
        work.streams[b, 0] = streams[0, b]


@compiled
def go_on(p, work, drive, out, rates, saved, start, end, ticks):
    """Run the ticks from ``start`` to ``end``, as ``trials`` runs those of a whole trial."""
    for first in range(start, end, len(ticks)):
        over = _window(p, work, first, drive, -np.inf, out, rates, saved, ticks)
        if over < 0:
            return -over
    return 0
