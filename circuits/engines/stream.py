"""Runs whose readings arrive one by one, with the engine's state carried between readings."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from circuits.activity import checked_drive
from circuits.arrays import Array
from circuits.declaration.table import CircuitTable
from circuits.dynamics.ticks import Clock
from circuits.errors import InputError

Onward = Callable[[int, int], None]
"""Runs ticks from first to last with the drive so far, and writes OUT."""


class Stream:
    """One trial of a circuit that receives its readings as they arrive.

    The result is identical to that of ``Engine.run`` with all readings, because a reading does not
    affect earlier samples. ``clock.steps`` is the maximum number of readings. ``begin`` takes the
    drive (steps, channels), nats, which is filled as readings arrive, and OUT (samples, channels),
    which is written; it starts at rest and returns a function that continues.
    """

    def __init__(
        self, circuit: CircuitTable, clock: Clock, begin: Callable[[Array, Array], Onward]
    ) -> None:
        self.circuit, self.clock = circuit, clock
        self.drive = np.full((clock.steps, circuit.columns), np.nan)
        self.out = np.full((clock.samples, circuit.channels), np.nan)
        self.steps, self.samples = 0, 0
        self._onward = begin(self.drive, self.out)

    def add(self, reading: npt.ArrayLike) -> Array:
        """Hold a drive (channels,), nats, for one step; return OUT (samples, channels) in it."""
        if self.steps == self.clock.steps:
            raise InputError(f"this trial has had all its {self.steps} readings", "reading")
        drive = checked_drive(self.circuit, np.asarray(reading)[None, None])[0, 0]
        self.drive[self.steps] = drive
        ends = [self.clock.settle_ticks + k * self.clock.step_ticks for k in (0, 1)]
        first, last = (end + self.steps * self.clock.step_ticks for end in ends)
        self._onward(first if self.steps else 0, last)
        before = self.samples
        self.steps += 1
        self.samples += self.clock.step_ticks // self.clock.sample_ticks
        return self.out[before : self.samples]

    @property
    def time_ms(self) -> Array:
        """Time of each sample so far, ms from the first reading."""
        return self.clock.time_ms[: self.samples]
