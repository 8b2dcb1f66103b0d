"""The ticks of the population engine, compiled: neighbouring trials fill a register.

Each of the ``LANES`` trials of a group is a lane of every register. Lanes are independent: the
result of a trial is the same to the bit, whatever the others are. A trial that ends is replaced by
the next, whose clock starts then. Input within the next ticks, up to the shortest delay, is known
in advance, so each block in turn is advanced through a window of ticks with its state in registers.

Loops over a row of values are vectorised by the compiler if it sees that their number is a multiple
of ``LANES``, and that no index is negative.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

from __future__ import annotations

import math

import numba
import numpy as np

from circuits.declaration.transfer import MOST_NATS
from circuits.engines.compiling import compiled, part
from circuits.engines.ensemble.lanes import exp32, tick_key
from circuits.engines.registers import (
    TRIALS,
    byte_counts_of_trials,
    interpolated,
    later,
    least,
    look_up_rows,
    most,
    multiply_add,
    ones_in,
    root,
    store,
    store_past,
    take_number,
    transpose,
)
from circuits.engines.registers import load_trials as load
from circuits.engines.registers import load_words as words
from circuits.engines.registers import spread_trials as spread

LANES = TRIALS
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
OF_LANES = ("trial", "begun", "samples", "reading", "due", "places", "rows")
"""Whole numbers of each lane: its trial, that trial's first tick, numbers of samples and readings
so far, tick of the next reading, column of the next tick in the tables of courses, and row of
coefficients."""
EMPTY = -1
ZERO, ONE, HALF = np.float32(0), np.float32(1), np.float32(0.5)
MOST, ENDLESS = np.float32(MOST_NATS), np.float32(np.inf)
CENTRE = np.float32(-(8.0**0.5))
_PER_ONE = tuple(np.float32(0.5**0.5 * 256.0**-byte) for byte in range(WORD_TICKS))
"""Noise of zero mean and unit variance from the ones of a byte, as ``ones_in`` counts them."""


@numba.njit(inline="always")
def _at(row):
    """Return where a row begins in a flat array: unsigned, so that it is not wrapped."""
    return np.uint64(row * LANES)


@numba.njit(inline="always")
def _low_passed(gain, before, value, old, last):
    """Return the next state of a low-pass of values interpolated linearly between ticks."""
    return multiply_add(gain, value - old, multiply_add(before, last - value, old))


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
def _look_up(n, values, lowest, per, points):
    """Interpolate a law tabulated at even steps; it is linear beyond the ends."""
    bottom, step, none = spread(lowest), spread(per), spread(ZERO)
    last = spread(np.float32(len(points) - 2))
    for i in range(0, n & WHOLE, LANES):
        at = (load(values, np.uint64(i)) - bottom) * step
        store(values, np.uint64(i), interpolated(at, least(most(at, none), last), points))


@part
def _apply(n, law, values, lowest, per, points):
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
        _look_up(n, values, lowest, per, points)


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
        work.rows[lane] = np.int32(at if at < last else last) * COEFFICIENTS
    look_up_rows(table, work.rows, work.coefficients[b])


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
    for t in range(len(ticks)):
        x = spread(block.bias)
        for e in range(block.input, block.inputs):
            heard = load(work.passed[p.inputs[e].index], _at(t))
            x = multiply_add(spread(p.inputs[e].weight), heard, x)
        if block.drive >= 0:
            x = x + load(work.drive[b], _at(0))
        store(values, _at(t), x)


@part
def _filter(block, state, values, shifts, ticks):
    gain, before = spread(block.gain), spread(block.before)
    x, last = load(state, _at(X)), load(state, _at(LAST))
    for t in range(len(ticks)):
        value = load(values, _at(t))
        last = _shifted(last, shifts, t)
        x = _low_passed(gain, before, value, x, last)
        last = value
        store(values, _at(t), x)
    store(state, _at(X), x)
    store(state, _at(LAST), last)


@numba.njit(inline="always")
def _shifted(last, shifts, t):
    """Return a filter's last input as it would have been at this tick's factors and courses."""
    if shifts is None:
        return last
    return last + load(shifts, _at(t))


@part
def _drift(slowly, state, values, ticks):
    """Update the running mean of the input; it selects coefficients, without following noise."""
    mean, slow = load(state, _at(MEAN)), spread(slowly)
    for t in range(len(ticks)):
        mean = multiply_add(slow, load(values, _at(t)) - mean, mean)
    store(state, _at(MEAN), mean)


@part
def _follow(coeffs, state, values, shifts, ticks):
    """Filter the input by the cells' lags (``filters.propagated``), in place."""
    half, last = spread(HALF), load(state, _at(LAST))
    low, v = load(state, _at(LOW)), load(state, _at(SLOPE))
    for t in range(len(ticks)):
        u = load(values, _at(t))
        last = _shifted(last, shifts, t)
        middle = half * (u + last)
        old, last = low - middle, u
        low = multiply_add(load(coeffs, _at(0)), old, multiply_add(load(coeffs, _at(1)), v, middle))
        v = multiply_add(load(coeffs, _at(2)), old, load(coeffs, _at(3)) * v)
        heard = multiply_add(load(coeffs, _at(5)), v, u)
        store(values, _at(t), multiply_add(load(coeffs, _at(4)), low - u, heard))
    store(state, _at(LAST), last)
    store(state, _at(LOW), low)
    store(state, _at(SLOPE), v)


@part
def _counts(keys, first, ticks):
    """Return the ones in the bytes of each lane's word, that of the window's first tick lowest."""
    index = (first // WORD_TICKS) % (KEY_TICKS // WORD_TICKS)
    counts = byte_counts_of_trials(index, words(keys, _at(0)), words(keys, _at(1)))
    return counts if len(ticks) == WORD_TICKS else later(counts, first % WORD_TICKS)


@part
def _noise(coeffs, state, values, counts, ticks):
    """Write near-Gaussian noise with the spectrum of the cells, by two sections of a filter.

    Except for the response to a constant, the output of a section (``filters.sampled``) is a
    difference between ticks, which sums to 0 in the long run even if the coefficients change.
    """
    _white(values, counts, ticks)
    _section(coeffs, FOLLOWING, state, FIRST, values, ticks)
    _section(coeffs, FOLLOWING + SECTION, state, SECOND, values, ticks)


@numba.njit(inline="always")
def _white(values, counts, ticks):
    centre = spread(CENTRE)
    for t in range(len(ticks)):
        store(values, _at(t), multiply_add(spread(_PER_ONE[t]), ones_in(counts, t), centre))


@numba.njit(inline="always")
def _section(coeffs, c, state, s, values, ticks):
    held, top, top1 = load(coeffs, _at(c)), load(coeffs, _at(c + 1)), load(coeffs, _at(c + 2))
    low1, low2 = load(coeffs, _at(c + 3)), load(coeffs, _at(c + 4))
    last, before, old = load(state, _at(s)), load(state, _at(s + 1)), load(state, _at(s + 2))
    for t in range(len(ticks)):
        e = load(values, _at(t))
        new = multiply_add(top, e, top1 * old) - multiply_add(low1, last, low2 * before)
        store(values, _at(t), multiply_add(held, e, new - last))
        last, before, old = new, last, e
    store(state, _at(s), last)
    store(state, _at(s + 1), before)
    store(state, _at(s + 2), old)


@part
def _send(block, state, values, noise, ring, total, kept, first, ticks):
    """Turn activity into a rate, with the noise of a finite number of cells; sum rates up.

    The amplitude of the noise is that of the rate at the first of the ticks that share a word.
    """
    gain, base, floor = spread(block.hz_per_nat), spread(block.baseline), spread(block.floor)
    each, none, amplitude = spread(block.noise), spread(ZERO), load(state, _at(AMPLITUDE))
    place = first & (len(ring) // LANES - 1)
    summed = load(total, _at(0))
    for t in range(len(ticks)):
        rate = most(multiply_add(gain, load(values, _at(t)), base), floor)
        if block.noise > ZERO:
            if t == 0 and first % WORD_TICKS == 0:
                amplitude = each * root(most(rate, none))
            rate = multiply_add(amplitude, load(noise, _at(t)), rate)
        store(ring, _at(place + t), rate)
        summed = summed + rate
    store(state, _at(AMPLITUDE), amplitude)
    if kept:
        store(total, _at(0), summed)


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
    state, gain, before = work.units[q], spread(unit.gain), spread(unit.before)
    constant = spread(unit.constant)
    low, last = load(state, _at(UNIT)), load(state, _at(UNIT + 1))
    for t in range(len(ticks)):
        value, place = spread(ZERO), _at((first + t - unit.delay) & mask)
        for e in range(unit.source, unit.sources):
            rates = load(work.ring[p.sources[e].index], place)
            value = multiply_add(spread(p.sources[e].weight), rates, value)
        low, last = _low_passed(gain, before, value, low, last), value
        store(passed, _at(t), low + constant)
    store(state, _at(UNIT), low)
    store(state, _at(UNIT + 1), last)
    if unit.law != LINEAR:
        _apply(len(ticks) * LANES, unit.law, passed, unit.lowest, unit.per, p.laws[unit.column])
    if unit.course:
        for t in range(len(ticks)):
            _scale(p.factors, unit.course, work.places, t, passed, work.jumps[q], state)


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
        _filter(block, state, values, work.shifts, ticks)
    if block.table >= 0:
        _drift(p.clock[0].follow_slowly, state, values, ticks)
    if block.lags:
        _follow(coeffs, state, values, work.shifts, ticks)
    n = len(ticks) * LANES
    _apply(n, block.law, values, block.lowest, block.per, p.laws[block.column])
    if block.noise > ZERO:
        _noise(coeffs, state, work.noise, _counts(work.keys[b], first, ticks), ticks)
    total, kept = work.totals[b], work.kept
    _send(block, state, values, work.noise, work.ring[b], total, kept, first, ticks)


@part
def _read(p, work, k):
    """Low-pass the read-out (step 4 of the scheme)."""
    mask = work.ring.shape[1] // LANES - 1
    gain, before = spread(p.clock[0].readout_gain), spread(p.clock[0].readout_before)
    for c in range(len(p.readout)):
        low, rates = work.low_pass[c], work.ring[p.readout[c]]
        now, past = load(rates, _at(k & mask)), load(rates, _at((k - 1) & mask))
        store(low, _at(0), _low_passed(gain, before, now, load(low, _at(0)), past))


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
    lowest, per = spread(ENDLESS), spread(p.clock[0].readout_nats_per_hz)
    for c in range(len(p.readout)):
        value = (load(work.low_pass[c], _at(0)) - spread(p.clock[0].readout_baseline)) * per
        store(work.out[c], _at(0), value)
        lowest = least(lowest, value)
    store(work.lowest, _at(0), lowest)


@part
def _keep(p, work, rates):
    """Record the mean rates of every lane since the last sample."""
    per, (_, samples, row) = spread(ONE / np.float32(p.clock[0].sample)), rates.shape
    for b in range(0, row, LANES):
        transpose(work.totals, b * LANES, work.square)
        for lane in range(LANES):
            trial, sample = work.trial[lane], work.samples[lane]
            if trial != EMPTY:
                place = np.uint64((trial * samples + sample) * row + b)
                store_past(rates, place, load(work.square, _at(lane)) * per)
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
    ``out`` (trials, samples, channels) and ``rates`` (trials, samples, row or 0), NaN after the
    end, and the final states ``saved``, unless it has no rows. A row of rates has a whole number of
    cache lines and begins at one (``memory.on_cache_lines``). ``next_trial`` (1,) is the first
    trial that no thread has begun, shared by all threads.
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
