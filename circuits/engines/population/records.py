"""Data structures of the population engine: each row of the table is a record."""

from __future__ import annotations

from collections import namedtuple
from typing import Any, NamedTuple

from circuits.engines.compiling import record

CLOCK = record(
    i8="step sample refresh start",
    f4="follow_slowly readout_gain readout_before readout_baseline readout_nats_per_hz runaway_hz",
)
UNIT = record(
    i8="law column delay source sources course",
    f4="gain before constant lowest per",
)
BLOCK = record(
    i8="law column drive input inputs table lags course",
    f4="bias drive_gain gain before baseline hz_per_nat floor noise lowest per state_lowest "
    "state_per",
)
EDGE = record(i8="index", f4="weight")


Plan = namedtuple(
    "Plan", "clock units blocks sources inputs driven readout laws tables factors nats"
)
"""A circuit and a clock in the kernel's format; made by ``plan.plan``, which describes each."""


class State(NamedTuple):
    """States of trials between two windows, float32; a trial begins in one of the entries."""

    ring: Any  # (entries, blocks, ticks) rates of the last ticks, Hz, the latest first
    blocks: Any  # (entries, blocks, rows) filters, as in ``Work``
    units: Any  # (entries, units, rows) the same
    low_pass: Any  # (entries, channels) low-passed rates of the read-out, Hz


Work = namedtuple(
    "Work",
    "ring units states coefficients passed jumps shifts totals counts values found drive low_pass "
    "out lowest streams keys trial begun samples reading due places soonest kept",
)
"""Working memory of a group of trials; made by ``plan.workspace``, which describes each."""
