"""The rows of a circuit's third table: changes within a trial and their times."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from circuits.arrays import Array
from circuits.checks import check_finite, check_range, check_types
from circuits.errors import EditWarning, InputError, require

DOPAMINE = "dopamine"
"""Name used in place of a population's for a course of the dopamine level."""
POINTS, TAILS = 400, 20.0
"""Number of times at which sums of courses are evaluated, and their range in time constants."""
SHORTEST_MS = 1.0
"""Duration below which a warning is issued, because times may have been given in seconds."""
NEAR = 1e-9
"""Distance, ticks, within which an edge counts as being on a tick."""


@dataclass(frozen=True)
class Course:
    """A time course of the dopamine level or of a population's input, the same in every trial.

    Time 0 is the onset of the drive; courses do not act before it, while the circuit settles. A
    course rises towards its amount from ``from_ms`` on, and decays from the value it has reached at
    ``to_ms``. Courses of the same quantity add up.
    """

    what: str  #: "dopamine", the name of a population, or one channel of it, "D2[0]".
    #: Added to the dopamine level, which is normally 1; or nats added to the input of that channel,
    #: or of every channel of the population, before its filter.
    amount: float
    from_ms: float = 0.0
    to_ms: float = math.inf  #: Without an end it lasts until the trial is over.
    rise_ms: float = 0.0  #: Time constant of the rise; 0 is a step.
    decay_ms: float = 0.0  #: Time constant of the decay; 0 is a step.
    #: Rate of a train of rectangular pulses, the first at ``from_ms``; 0 is one lasting change.
    rate_hz: float = 0.0
    pulse_ms: float = 0.0  #: Width of each pulse.
    cite: str = ""

    def __post_init__(self) -> None:
        check_types(self, f"the course of {self.what}")
        name, begin = self.name, self.from_ms
        check_finite(owner=name, amount=self.amount, from_ms=begin)
        require(begin >= 0, "from_ms", "must be >= 0, when the drive begins", begin, owner=name)
        after = f"must come after from_ms, {begin:g}"
        require(begin < self.to_ms, "to_ms", after, self.to_ms, owner=name)
        if self.to_ms - begin < SHORTEST_MS:
            EditWarning.warn(f"{name} lasts less than {SHORTEST_MS:g} ms: times are in ms")
        check_range(0, math.inf, owner=name, rise_ms=self.rise_ms, decay_ms=self.decay_ms)
        if self.decay_ms and math.isinf(self.to_ms):
            raise InputError(f"{name}: without an end, to_ms, there is no decay_ms", "decay_ms")
        self._check_train()

    def _check_train(self) -> None:
        rate, width = self.rate_hz, self.pulse_ms
        check_range(0, math.inf, owner=self.name, rate_hz=rate, pulse_ms=width)
        if bool(rate) != bool(width):
            reason = "a train of pulses needs both rate_hz and pulse_ms"
            raise InputError(f"{self.name}: {reason}", "pulse_ms" if rate else "rate_hz")
        if rate:
            must = f"must be shorter than the period, {1000 / rate:g} ms"
            require(width * rate < 1000, "pulse_ms", must, width, owner=self.name)
            must = "must be 0 in a train of pulses"
            require(not self.rise_ms, "rise_ms", must, self.rise_ms, owner=self.name)
            require(not self.decay_ms, "decay_ms", must, self.decay_ms, owner=self.name)

    @property
    def name(self) -> str:
        """``course of STN from 0 to 300 ms``."""
        return f"course of {self.what} from {self.from_ms:g} to {self.to_ms:g} ms"

    @property
    def reached(self) -> float:
        """The value reached at its end."""
        if not self.rise_ms:
            return self.amount
        return -self.amount * math.expm1(-(self.to_ms - self.from_ms) / self.rise_ms)

    def at(self, time_ms: Array) -> Array:
        """Return its values at times, ms from the onset of the drive."""
        on = np.full(len(time_ms), float(self.amount))
        if self.rise_ms:
            since = np.clip(time_ms - self.from_ms, 0, None)
            on = -self.amount * np.expm1(-since / self.rise_ms)
        off = np.zeros(len(time_ms))
        if self.decay_ms:
            since = np.clip(time_ms - self.to_ms, 0, None)
            off = self.reached * np.exp(-since / self.decay_ms)
        if self.rate_hz:
            on = np.where((time_ms - self.from_ms) % (1000 / self.rate_hz) < self.pulse_ms, on, 0.0)
        begun, over = time_ms >= self.from_ms, time_ms >= self.to_ms
        return np.where(over, off, np.where(begun, on, 0.0))

    def in_ticks(self, ticks: int, dt_ms: float) -> Array:
        """Return the mean of the course in each of the first ticks of the drive, (ticks,).

        A pulse shorter than a tick thus keeps its area, and smooth courses have no lag.
        """
        first, last = (_in_ticks(edge, dt_ms) for edge in (self.from_ms, self.to_ms))
        begins = np.arange(ticks, dtype=np.float64)
        ends = begins + 1
        low, high = np.clip(begins, first, last), np.clip(ends, first, last)
        mean = self.amount * (high - low)
        if self.rate_hz:
            since, until = (self._pulsed(end - first, dt_ms) for end in (low, high))
            return self.amount * (until - since)
        if self.rise_ms:
            tau = self.rise_ms / dt_ms
            mean -= self.amount * _area(low - first, high - first, tau)
        if self.decay_ms:
            low, high = np.maximum(begins, last), np.maximum(ends, last)
            mean += self.reached * _area(low - last, high - last, self.decay_ms / dt_ms)
        return mean

    def _pulsed(self, since: Array, dt_ms: float) -> Array:
        """Return the time within pulses up to times since the first one, all in ticks."""
        period, width = 1000 / self.rate_hz / dt_ms, self.pulse_ms / dt_ms
        # A time that is a pulse's edge except for rounding counts as the edge.
        periods = np.floor(since / period + NEAR)
        return np.asarray(periods * width + np.clip(since - periods * period, 0, width))


def extremes(courses: Sequence[Course]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the least and the largest sum of courses, each with its time, ms.

    Sums are evaluated from each edge of a row on, because a sum of several exponentials may have
    its extremes anywhere.
    """
    edges = sorted({edge for row in courses for edge in (row.from_ms, row.to_ms)} - {math.inf})
    tau = [tau for row in courses for tau in (row.rise_ms, row.decay_ms) if tau] or [1.0]
    since = np.geomspace(min(tau) / POINTS, TAILS * max(tau), POINTS)
    # At its end a step has already changed, so its value is taken just before.
    before = np.nextafter(edges, -math.inf)
    after = (np.array(edges)[:, None] + since).ravel()
    even = np.linspace(edges[0], edges[-1], POINTS)
    times = np.concatenate([[-1.0], edges, even, after, before])
    sums = np.sum([row.at(times) for row in courses], axis=0)
    low, high = int(np.argmin(sums)), int(np.argmax(sums))
    return (float(sums[low]), float(times[low])), (float(sums[high]), float(times[high]))


def warn_of_late(courses: Sequence[Course], end_ms: float) -> None:
    """Warn of courses that begin after the longest trial, which ends ``end_ms`` after the onset."""
    late = [row.name for row in courses if row.from_ms >= end_ms]
    if late:
        EditWarning.warn(
            f"{', '.join(late)}: no effect, since the longest trial ends {end_ms:g} ms after the "
            "onset of the drive"
        )


def _in_ticks(time_ms: float, dt_ms: float) -> float:
    """Return a time in ticks, rounded if it is whole except for rounding errors."""
    count = time_ms / dt_ms
    if math.isinf(count):
        return count
    return float(round(count)) if abs(count - round(count)) <= NEAR * max(1.0, count) else count


def _area(low: Array, high: Array, tau: float) -> Array:
    """Return the area under ``exp(-t / tau)`` between times, all in ticks."""
    return np.asarray(-tau * np.exp(-low / tau) * np.expm1(-(high - low) / tau))
