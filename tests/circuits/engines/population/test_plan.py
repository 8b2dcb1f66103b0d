"""What is laid out before a run: the tick."""

import pytest

from circuits import anatomy
from circuits.engines.population.plan import tick_ms
from circuits.wiring import wire


@pytest.mark.parametrize(
    ("delay_ms", "times_ms", "tick"),
    [
        (12.0, (50.0,), 0.5),
        (12.25, (50.0,), 0.25),
        (12.4, (50.0,), 0.2),
        (12.0, (0.8,), 0.2),
        (12.3, (50.0,), 0.1),
        (12.33, (50.0,), 0.1),
    ],
)
def test_the_tick_is_the_longest_that_all_delays_and_times_are_multiples_of(
    delay_ms, times_ms, tick
):
    """One of 1/2, 1/4, 1/5 and 1/10 ms; the other delays of the table are whole milliseconds."""
    circuit = anatomy.circuit("macaque", 2).with_projection("STN", "GPe", delay_ms=delay_ms)
    assert tick_ms(wire(circuit), *times_ms) == tick
