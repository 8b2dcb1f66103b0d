"""What is laid out before a run: the tick."""

import numpy as np
import pytest

from circuits import anatomy
from circuits.dynamics.ticks import Clock, Scheme, tick_ms
from circuits.dynamics.wiring import wire
from circuits.engines import Population
from circuits.engines.population import kernel
from circuits.engines.population.plan import plan, rest


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
    circuit = anatomy.load_circuit("macaque", 2).with_projection("STN->GPe", delay_ms=delay_ms)
    assert tick_ms(wire(circuit), Population.ticks_ms, *times_ms) == tick


def test_filters_follow_the_state_with_a_time_constant_of_fifty_milliseconds():
    """After 50 ms their coefficients lack 1/e of a step of the state."""
    scheme = Scheme(wire(anatomy.spiking_msprt(2)), 0.5)
    clock = plan(scheme, Clock(1, 50, 0.5), Population(noise=True)).clock[0]
    assert (1 - clock["follow_slowly"]) ** (50 / 0.5) == pytest.approx(np.exp(-1), rel=1e-4)


def test_noise_falls_with_the_number_of_cells_and_the_length_of_a_tick():
    """Of 1 Hz: the count of n Poisson cells in a tick has the mean and the variance n dt."""
    table = anatomy.spiking_msprt(2).with_neurons(70)
    scheme = Scheme(wire(table), 0.5)
    made = {
        noise: plan(scheme, Clock(1, 50, 0.5), Population(laws="lines", noise=noise)).blocks
        for noise in (True, False)
    }
    spiking = [wire(table).rows[b].spiking for b in range(len(made[True]))]
    count = 70 * 0.5e-3
    expected = np.where(spiking, count / count**2, 0)
    np.testing.assert_allclose(made[True]["noise"] ** 2, expected, rtol=1e-6)
    assert not made[False]["noise"].any()


@pytest.mark.parametrize("name", ["macaque", "spiking_msprt"])
def test_what_units_pass_on_at_rest_keeps_blocks_at_rest(name):
    """Tone and pathways that bend included."""
    wiring = wire(anatomy.load_circuit(name, 3))
    scheme = Scheme(wiring, 0.5)
    state = rest(scheme)
    arrives = wiring.weight @ state.units[0, :, kernel.PASSED] + wiring.bias
    np.testing.assert_allclose(arrives, state.blocks[0, :, kernel.X], rtol=1e-5, atol=1e-5)
    assert (wiring.constant != 0).any()
