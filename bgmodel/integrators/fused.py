"""The MSPRT on Gaussian evidence that is drawn where it is decided: many millions of trials.

No array of trials is made, and one pass serves every threshold. 128 trials go side by side in
single precision; OUT falls below a threshold for the first time when its running minimum does, so
for each threshold the readings are counted at which that has not happened yet.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from bgmodel.checks import is_number, reals, whole
from bgmodel.compiling import compiled, inlined
from bgmodel.decision import Tally

LANES = 128
LOWEST = np.float32(-1e30)
AT_ONCE = 4
"""Readings between two counts."""
AT_A_TIME = 3
"""Thresholds that are counted together."""
MOST_STEPS = 32_767
f32, i32, u32, u64 = np.float32, np.int32, np.uint32, np.uint64
# Products and sums may be one operation; there is no NaN.
FAST = {"contract", "nsz", "nnan"}


def gaussian_tally(
    trials: int,
    steps: int,
    separation: float,
    thresholds: npt.ArrayLike,
    *,
    seed: int,
    hypotheses: int = 2,
) -> Tally:
    """Count what the MSPRT decides on Gaussian evidence, at every threshold in one pass.

    The same in distribution as ``tally(Msprt().run(gaussian_evidence(...)), ...)``; for two
    hypotheses the SPRT.

    Parameters
    ----------
    trials, steps : int
        Trials, and readings after which a response is forced.
    separation : float
        As of ``gaussian_evidence``: mean of the true channel in standard deviations.
    thresholds : array (K,), nats
        On OUT = -ln P, between 0 and ln N, as from ``criterion_from_posterior``.
    seed : int
        Of the noise. Trial n has the same noise whatever the number of trials and thresholds.
    hypotheses : int
        Number of hypotheses, N.

    Raises
    ------
    ValueError
        If a number makes no sense.
    """
    levels = np.atleast_1d(np.asarray(reals("thresholds", thresholds), dtype=np.float64))
    trials, steps = whole("trials", trials, 1), whole("steps", steps, 1)
    hypotheses, seed = whole("hypotheses", hypotheses, 2), whole("seed", seed, 0)
    if steps > MOST_STEPS:
        raise ValueError(f"steps must lie in 1..{MOST_STEPS}, got {steps}")
    if seed >= 2**64:
        raise ValueError(f"seed must be a whole number from 0, below 2^64, got {seed}")
    if not (is_number(separation) and 0 < separation < np.inf):
        raise ValueError(f"separation must be > 0 and finite, got {separation!r}")
    if (
        levels.ndim != 1
        or not levels.size
        or not ((levels > 0) & (levels < np.log(hypotheses))).all()
    ):
        raise ValueError(
            f"thresholds must be (K,), between 0 and ln {hypotheses} nats, got {levels.tolist()}"
        )
    bars = -np.log(np.expm1(levels)) if hypotheses == 2 else -np.exp(levels)
    order = np.argsort(bars)
    rising = np.append(bars[order], np.full(AT_A_TIME - 1, np.inf)).astype(f32)
    counted = _count(trials, steps, f32(separation), rising, u64(seed), hypotheses)
    taken, correct, forced = (values[np.argsort(order)] for values in counted)
    return Tally(trials, correct, taken.astype(np.float64), forced)


@inlined
def _mixed(z: Any) -> Any:
    """Return the SplitMix64 finaliser (Steele, Lea & Flood 2014)."""
    z = (z ^ (z >> u64(30))) * u64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> u64(27))) * u64(0x94D049BB133111EB)
    return z ^ (z >> u64(31))


@inlined
def _word(index: Any, high: Any, low: Any) -> Any:
    """Return a random word of a counter under a key of two halves (Wellons 2018, lowbias32)."""
    x = u32(u32(index * u32(0x9E3779B1)) + high)
    x = u32(u32(u32(x ^ u32(x >> u32(16))) * u32(0x21F0AAAD)) + low)
    x = u32(u32(x ^ u32(x >> u32(15))) * u32(0x735A2D97))
    return u32(x ^ u32(x >> u32(15)))


@inlined
def _log(u: Any) -> Any:
    """Return ln u of a positive number, to 1e-7 (polynomial of Cephes' logf, Moshier)."""
    bits = f32(u).view(i32)
    power = i32(i32(bits - i32(0x3F3504F3)) >> i32(23))
    m = i32(bits - i32(power << i32(23))).view(f32) - f32(1)
    p = f32(7.0376836292e-2) * m - f32(1.1514610310e-1)
    p = p * m + f32(1.1676998740e-1)
    p = p * m - f32(1.2420140846e-1)
    p = p * m + f32(1.4249322787e-1)
    p = p * m - f32(1.6668057665e-1)
    p = p * m + f32(2.0000714765e-1)
    p = p * m - f32(2.4999993993e-1)
    p = p * m + f32(3.3333331174e-1)
    return m + (p * m * m * m - f32(0.5) * m * m) + f32(power) * f32(0.69314718)


@inlined
def _exp(x: Any) -> Any:
    """Return e^x for x <= 0, to 1e-7 (polynomial of Cephes' expf); 0 below -80."""
    x = max(x, f32(-80.0))
    power = np.floor(x * f32(1.44269504) + f32(0.5))
    r = x - power * f32(0.693359375) + power * f32(2.12194440e-4)
    p = f32(1.9875691500e-4) * r + f32(1.3981999507e-3)
    p = p * r + f32(8.3334519073e-3)
    p = p * r + f32(4.1665795894e-2)
    p = p * r + f32(1.6666665459e-1)
    p = p * r + f32(5.0000001201e-1)
    return (p * r * r + r + f32(1)) * i32(i32(i32(power) + i32(127)) << i32(23)).view(f32)


@inlined
def _two_normals(first: Any, second: Any) -> Any:
    """Return two independent normal numbers from two random words (Box & Muller 1958)."""
    u = (f32(i32(first >> u32(8))) + f32(0.5)) * f32(2.0**-24)
    radius = np.sqrt(f32(-2) * _log(u))
    # Sine and cosine of a turn: of the rest of the nearest quarter (Cephes' sinf and cosf).
    quarters = f32(i32(i32(second) >> i32(8))) * f32(2.0**-22)
    q = i32(np.floor(quarters + f32(0.5)))
    x = (quarters - f32(q)) * f32(np.pi / 2)
    y = x * x
    s = f32(8.3321608736e-3) - y * f32(1.9515295891e-4)
    s = x + x * y * (f32(-1.6666654611e-1) + y * s)
    c = f32(-1.388731625493765e-3) + y * f32(2.443315711809948e-5)
    c = f32(1) - f32(0.5) * y + y * y * (f32(4.166664568298827e-2) + y * c)
    across, up = (s, c) if (q & i32(1)) != 0 else (c, s)
    across = -across if ((q + i32(1)) & i32(2)) != 0 else across
    up = -up if (q & i32(2)) != 0 else up
    return radius * across, radius * up


@inlined
def fill_normals(out: Any, key: Any) -> None:
    """Fill (2, LANES) with normal numbers that belong to a key."""
    z = _mixed(key)
    high, low = u32(z >> u64(32)), u32(z & u64(0xFFFFFFFF))
    for lane in range(LANES):
        first, second = _word(u32(2 * lane), high, low), _word(u32(2 * lane + 1), high, low)
        out[0, lane], out[1, lane] = _two_normals(first, second)


@inlined
def _read_two(
    sums: Any, noise: Any, mean: Any, sd: Any, before: Any, after: Any, marks: Any, led: Any
) -> None:
    """Add a reading to Z of two hypotheses; the score is |Z|, and the truth leads above 0."""
    for lane in range(LANES):
        old = sums[0, lane]
        z = old + mean + sd * noise[0, lane]
        sums[0, lane] = z
        after[lane] = max(before[lane], abs(z))
        marks[lane] = i32(1 + (i32(i32(z > f32(0)) - i32(old > f32(0))) << 16))


@inlined
def _read_many(
    sums: Any, noise: Any, mean: Any, sd: Any, before: Any, after: Any, marks: Any, led: Any
) -> None:
    """Add a reading to the sums y of N hypotheses; the score is ``-sum_j exp(y_j - max y)``."""
    for lane in range(LANES):
        sums[0, lane] += mean
        after[lane] = LOWEST
    for channel in range(sums.shape[0]):
        for lane in range(LANES):
            y = sums[channel, lane] + sd * noise[channel, lane]
            sums[channel, lane] = y
            after[lane] = max(after[lane], y)
    for lane in range(LANES):
        leads = i32(sums[0, lane] == after[lane])
        marks[lane] = i32(1 + (i32(leads - led[lane]) << 16))
        led[lane] = leads
        noise[0, lane] = f32(0)
    for channel in range(sums.shape[0]):
        for lane in range(LANES):
            noise[0, lane] -= _exp(sums[channel, lane] - after[lane])
    for lane in range(LANES):
        after[lane] = max(before[lane], noise[0, lane])


@inlined
def _marked(bar: Any, best: Any, marks: Any) -> Any:
    """Return the sum of the marks of those readings of a lane that were below a threshold."""
    a = marks[0] if best[0] < bar else i32(0)
    b = marks[1] if best[1] < bar else i32(0)
    c = marks[2] if best[2] < bar else i32(0)
    d = marks[3] if best[3] < bar else i32(0)
    return i32(i32(a + b) + i32(c + d))


@inlined
def _note(counts: Any, above: Any, bars: Any, best: Any, marks: Any) -> None:
    """Add the marks of the readings before which a threshold, of rising ones, was not reached.

    Those that all lanes have reached take nothing, and those that none has take one sum: it goes
    into ``above`` at the first of them. The others go three at a time, which share what they read;
    the last two bars are out of reach, so that there are always three.
    """
    reached, nobody = 0, bars.shape[0] - AT_A_TIME + 1
    least, most = best[0, 0], best[AT_ONCE, 0]
    for lane in range(LANES):
        least, most = min(least, best[0, lane]), max(most, best[AT_ONCE, lane])
    while reached < nobody and bars[reached] <= least:
        reached += 1
    while nobody > reached and bars[nobody - 1] > most:
        nobody -= 1
    nobody += (reached - nobody) % AT_A_TIME
    for k in range(reached, nobody, AT_A_TIME):
        bar, next_bar, last_bar = bars[k], bars[k + 1], bars[k + 2]
        for lane in range(LANES):
            # All is read before anything is written: it stays in registers.
            score = (best[0, lane], best[1, lane], best[2, lane], best[3, lane])
            mark = (marks[0, lane], marks[1, lane], marks[2, lane], marks[3, lane])
            first = _marked(bar, score, mark)
            second = _marked(next_bar, score, mark)
            third = _marked(last_bar, score, mark)
            counts[k, lane] += first
            counts[k + 1, lane] += second
            counts[k + 2, lane] += third
    for lane in range(LANES):
        both = i32(marks[0, lane] + marks[1, lane])
        above[nobody, lane] += i32(both + i32(marks[2, lane] + marks[3, lane]))


@inlined
def _emptied(counts: Any, above: Any, lanes: int, taken: Any, correct: Any) -> None:
    """Move counts to their sums: below 2^16 readings, above it correct choices."""
    for lane in range(LANES):
        whole = i32(0)
        for k in range(taken.shape[0]):
            whole += above[k, lane]
            if lane < lanes:
                found = i32(counts[k, lane] + whole)
                readings = found & i32(0xFFFF)
                taken[k] += readings
                correct[k] += i32(found - readings) >> 16
    counts[:] = 0
    above[:] = 0


@inlined
def _decide(
    key: Any, steps: int, mean: Any, sd: Any, bars: Any, sums: Any, noise: Any, best: Any,
    marks: Any, led: Any, counts: Any, above: Any,
) -> None:  # fmt: skip
    """Let one set of lanes go through its readings, from a score that ``best`` starts with.

    A choice is right at the first crossing if the changes of "the truth leads" up to there sum to
    1: they are counted as the readings are, in the upper half of the same number.
    """
    channels = sums.shape[0]
    sums[:] = 0
    led[:] = 0
    for step in range(steps):
        at = step % AT_ONCE
        if at == 0:
            for pair in range(AT_ONCE * channels // 2):
                key += u64(1)
                fill_normals(noise[2 * pair : 2 * pair + 2], key)
        now = noise[at * channels : (at + 1) * channels]
        if channels == 1:
            _read_two(sums, now, mean, sd, best[at], best[at + 1], marks[at], led)
        else:
            _read_many(sums, now, mean, sd, best[at], best[at + 1], marks[at], led)
        if at == AT_ONCE - 1 or step == steps - 1:
            for idle in range(at + 1, AT_ONCE):
                marks[idle] = 0
                best[idle + 1] = best[at + 1]
            _note(counts, above, bars, best, marks)
            best[0] = best[AT_ONCE]


@partial(compiled, fastmath=FAST)
def _count(trials: int, steps: int, separation: Any, bars: Any, seed: Any, hypotheses: int) -> Any:
    """Return readings taken, correct choices and forced ones (K,), summed over trials."""
    count = bars.shape[0] - AT_A_TIME + 1
    taken, correct = np.zeros(count, np.int64), np.zeros(count, np.int64)
    forced = np.zeros(count, np.int64)
    channels = 1 if hypotheses == 2 else hypotheses
    sd = f32(separation * np.sqrt(f32(2))) if channels == 1 else separation
    mean, start = f32(separation * separation), f32(0 if channels == 1 else -hypotheses)
    counts = np.zeros((bars.shape[0], LANES), np.int32)
    above = np.zeros((bars.shape[0] + 1, LANES), np.int32)
    sums = np.empty((channels, LANES), np.float32)
    best = np.empty((AT_ONCE + 1, LANES), np.float32)
    marks = np.empty((AT_ONCE, LANES), np.int32)
    noise = np.empty((AT_ONCE * channels, LANES), np.float32)
    led = np.empty(LANES, np.int32)
    blocks = (trials + LANES - 1) // LANES
    full = min(MOST_STEPS, 65_535 // steps)
    for block in range(blocks):
        lanes = min(LANES, trials - block * LANES)
        if lanes < LANES or block % full == 0:
            _emptied(counts, above, LANES, taken, correct)
        best[0] = start
        key = _mixed(seed + u64(0x9E3779B97F4A7C15) * u64(block + 1))
        _decide(key, steps, mean, sd, bars, sums, noise, best, marks, led, counts, above)
        for k in range(count):
            for lane in range(lanes):
                forced[k] += best[0, lane] < bars[k]
    _emptied(counts, above, lanes, taken, correct)
    return taken, correct, forced
