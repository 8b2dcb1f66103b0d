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
    "variation kept advance place course table bucket buckets",
    f8="buckets_per_spike spike_hz baseline gain floor decay filter_gain bias drive_gain rest_x "
    "rest_hz",
    f4="membrane_decay rest slope noise_step threshold refractory",
)
OF_TYPE = (
    "membrane_decay", "rest", "slope", "noise_step", "threshold", "refractory", "advance", "place",
)  # fmt: skip
"""Fields of a block that its cell type sets; see ``cells.CompiledCell``."""
UNIT = record(i8="law delay source sources course", f8="decay constant rest")
EDGE = record(i8="index", f8="weight")
OWN_INPUT = record(
    i8="target start delay own_source own_sources course", f4="decay jump weight rest"
)
OWN_SOURCE = record(i8="source connections")
TRAIN = record(f8="due", f4="slow", i4="fired link")
"""A renewal cell: the expected spikes at which it fires next, the factor on its intervals, its
spikes so far, and the next cell of its bucket."""


Plan = namedtuple(
    "Plan",
    "clock blocks units sources inputs own_inputs own_sources connections readout ticks constants "
    "tick_constants factors nats slow intervals first_spikes",
)
"""A circuit and a clock in the kernel's format; made by ``plan.plan``, which describes each."""
Work = namedtuple(
    "Work",
    "v counts x cell_x ring state total common mean_step states heard marks unit passed own_input "
    "scale sums spiked spiked_n low_pass trains expected own_expected buckets fired after",
)
"""Working memory of a trial; made by ``plan.workspace``, which describes each."""
