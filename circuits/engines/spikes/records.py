"""Data structures of the compiled engine: each row of the table is a record."""

from __future__ import annotations

from collections import namedtuple

from circuits.engines.compiling import record

CLOCK = record(
    i8="ticks settle step sample ring window listing",
    f8="dt_s readout_decay readout_baseline readout_gain",
)
BLOCK = record(
    i8="kind variables nats law drive input inputs own_input own_inputs start cells filled "
    "variation kept advance place course",
    f8="spike_hz baseline gain floor decay filter_gain bias drive_gain rest_x rest_hz",
    f4="membrane_decay rest slope noise_step threshold jitter refractory begin begin_span",
)
OF_TYPE = (
    "membrane_decay", "rest", "slope", "noise_step", "threshold", "jitter", "refractory",
    "begin", "begin_span", "advance", "place",
)  # fmt: skip
"""Fields of a block that its cell type sets; see ``cells.Entry``."""
UNIT = record(i8="law delay source sources course", f8="decay constant rest")
EDGE = record(i8="index", f8="weight")
OWN_INPUT = record(
    i8="target start delay own_source own_sources course", f4="decay jump weight rest"
)
OWN_SOURCE = record(i8="source connections")


Plan = namedtuple(
    "Plan",
    "clock blocks units sources inputs own_inputs own_sources connections readout ticks constants "
    "tick_constants factors nats",
)
"""A circuit and a clock in the kernel's format; made by ``plan.plan``, which describes each."""
Work = namedtuple(
    "Work",
    "v counts x cell_x ring state total common mean_step noise_step states heard marks unit "
    "passed own_input scale sums spiked spiked_n low_pass",
)
"""Working memory of a trial; made by ``plan.workspace``, which describes each."""
