"""Tables of what cells answer: their ranges, their errors, and when a warning says so."""

import numpy as np
import pytest
from scipy import signal

from circuits import anatomy
from circuits.cells import Phase
from circuits.declaration import transfer
from circuits.dynamics.ticks import Clock, Scheme, tick_ms
from circuits.dynamics.wiring import wire
from circuits.engines import Populations
from circuits.engines.population import answers as module
from circuits.engines.population import filters, kernel
from circuits.engines.population.answers import Mixture, answers, looked_up
from circuits.engines.population.filters import PER_RAD_S
from circuits.engines.population.plan import plan, rest
from circuits.store import Entry

GPE = anatomy.spiking_msprt().population("GPe")
LIF = Mixture(GPE.cell, "linear", GPE.baseline_hz, GPE.gain_hz_per_nat)


@pytest.mark.parametrize(
    ("mixture", "top_hz"),
    [(Mixture(Phase(0.3), "linear", 40.0, 10.0), 1000.0), (LIF, 0.95 * 500)],
)
def test_filters_follow_rates_of_1_mhz_to_400_hz_and_the_law_up_to_its_limit(mixture, top_hz):
    """A cell with a refractory period of 2 ms stays below 500 Hz; its law is tabulated to 95 %."""
    table = answers(mixture, 0.1)
    ends = mixture.rate_hz(np.array([table.lowest, table.highest, table.top]))
    np.testing.assert_allclose(ends, [1e-3, 400, top_hz], rtol=0.02)
    np.testing.assert_allclose(table.hz[[0, -1]], ends[[0, 2]], rtol=1e-9)


def test_a_law_that_ends_is_followed_to_a_thousandth_of_its_ends():
    """A ramp of 34 Hz between 0 and 1 nat."""
    table = answers(Mixture(Phase(0.3), "ramp", 0.0, 34.0), 0.1)
    np.testing.assert_allclose(table.lowest * 34, 1e-3, rtol=0.05)
    np.testing.assert_allclose([table.highest, table.top], [0.999, 0.95], rtol=1e-5)


@pytest.mark.parametrize("share", [0.95, 1.05])
def test_a_law_is_looked_up_if_it_bends_by_less_than_a_five_hundredth_between_points(
    share, monkeypatch
):
    """A sine of height 1 rises above a chord by 1 - cos(half a step); 8191 steps span 128 nats."""
    turn = 2 * np.arccos(1 - share * 2e-3) / (128 / 8191)
    wave = transfer.Transfer(lambda x: np.sin(turn * x), np.cos, np.sin, "sin({x})", "a wave")
    name = f"wave {share}"
    monkeypatch.setitem(transfer.TRANSFERS, name, wave)
    if share > 1:
        with pytest.raises(ValueError, match="too curved for that"):
            looked_up(name)
    else:
        low, high, values = looked_up(name)
        np.testing.assert_array_equal(values, np.sin(turn * np.linspace(low, high, len(values))))


def test_fits_are_kept_only_if_all_code_is_included(monkeypatch):
    """The cache is keyed by the sources of the package, which have no transfer of a user."""
    kept = []
    nowhere = Entry(None, "", "", dict, dict)
    monkeypatch.setattr(module, "cached", lambda *_: kept.append(1) or nowhere)
    monkeypatch.setattr(module, "_fit", lambda _: None)
    monkeypatch.setitem(transfer.TRANSFERS, "mine", transfer.TRANSFERS["linear"])
    for name, count in (("linear", 1), ("mine", 1), ("exp", 2)):
        module._fitted(Mixture(Phase(0.3), name, 10.0, 5.0))
        assert len(kept) == count


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
    assert tick_ms(wire(circuit), Populations.ticks_ms, *times_ms) == tick


def test_filters_follow_the_state_with_a_time_constant_of_fifty_milliseconds():
    """After 50 ms their coefficients lack 1/e of a step of the state."""
    scheme = Scheme(wire(anatomy.spiking_msprt(2)), 0.5)
    clock = plan(scheme, Clock(1, 50, 0.5), Populations(noise=True)).clock[0]
    assert (1 - clock["follow_slowly"]) ** (50 / 0.5) == pytest.approx(np.exp(-1), rel=1e-4)


@pytest.mark.parametrize("name", ["macaque", "spiking_msprt"])
def test_what_units_pass_on_at_rest_keeps_blocks_at_rest(name):
    wiring = wire(anatomy.load_circuit(name, 3))
    scheme = Scheme(wiring, 0.5)
    state = rest(scheme)
    arrives = wiring.weight @ state.units[0, :, kernel.PASSED] + wiring.bias
    np.testing.assert_allclose(arrives, state.blocks[0, :, kernel.X], rtol=1e-5, atol=1e-5)
    assert (wiring.constant != 0).any()


def test_how_a_rational_answer_follows_is_found_again():
    n1, n2, d1, d2 = 0.4, 0.02, 0.7, 0.06
    s = PER_RAD_S
    gain = 80 * (1 + n1 * s + n2 * s**2) / (1 + d1 * s + d2 * s**2)
    fitted = filters.following(np.stack([gain] * 3))
    assert fitted.misfit.max() < 0.01
    np.testing.assert_allclose(fitted.coefficients[-1], [n1, n2, d1, d2], rtol=0.2)


@pytest.mark.parametrize("dt_ms", [0.1, 0.5])
def test_a_tick_follows_as_the_filter_does_in_continuous_time(dt_ms):
    n1, n2, d1, d2 = coefficients = np.array([0.4, 0.02, 0.7, 0.06])
    p11, p12, p21, p22, c1, c2 = filters.propagated(coefficients[None], dt_ms)[:, 0]
    time = np.arange(0, 200, dt_ms) / 10  # in 10 ms, the unit of the coefficients
    wave = np.sin(2 * np.pi * time / 5)  # 20 Hz
    low = v = last = 0.0
    answers = []
    for u in wave:
        middle = (u + last) / 2
        old = low - middle
        low, v, last = middle + p11 * old + p12 * v, p21 * old + p22 * v, u
        answers.append(u + c1 * (low - u) + c2 * v)
    _, wanted, _ = signal.lsim(([n2, n1, 1], [d2, d1, 1]), wave, time)
    assert np.abs(np.array(answers) - wanted).max() < 0.02 * dt_ms**2 + 1e-6
