"""Circuits made from nothing: noise of OUT, OUT at rest and loops, each with its cure."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import bgmodel as bg
from bgmodel.integrators.criterion import doubts, rest_out
from circuits.anatomy import CIRCUITS, load_circuit
from circuits.cells import Phase, Rate
from circuits.circuit import Circuit
from circuits.declaration.rows import Population, Projection
from circuits.dynamics.fixed_point import resting_hz, resting_state, wired
from circuits.dynamics.loops import amplifying
from circuits.engines import run
from tests.helpers import refused

NOISY = ["population", "spikes"]
RATE_HZ, GAIN, CELLS = 60.0, 20.0, 100


def reads(tau_ms, cv=0.5, channels=2, bias_nats=None):
    """Return a circuit of cortex and a noisy read-out that rests at ``RATE_HZ`` and at chance."""
    chance = np.log(channels)
    # Cortex rests at its drive, 1 nat per channel.
    snr = Population("SNr", Phase(cv), RATE_HZ - GAIN * chance, GAIN, "GABA", CELLS,
                     bias_nats=chance + 1 if bias_nats is None else bias_nats)  # fmt: skip
    ctx = Population("ctx", Rate(signed=True), 0.0, 10.0, "GABA")
    path = Projection("ctx", "SNr", -1.0, delay_ms=5.0, tau_ms=5.0)
    return Circuit("own", (ctx, snr), (path,), channels, reference_nats=1 + chance,
                   readout_tau_ms=tau_ms, default_gain=0.5)  # fmt: skip


def shot_noise_nats(tau_ms, cv):
    """Return the sd of OUT: renewal spikes through an exponential filter (Cox 1962).

    The intervals are inverse Gaussian; ``passed`` is their Laplace transform at the decay rate.
    """
    decay_hz = 1000 / tau_ms
    passed = np.exp((1 - np.sqrt(1 + 2 * cv**2 * decay_hz / RATE_HZ)) / cv**2)
    variance = RATE_HZ * decay_hz / 2 * (1 + passed) / (1 - passed) - RATE_HZ**2
    return np.sqrt(variance / CELLS) / GAIN


@pytest.mark.parametrize("engine", NOISY)
@pytest.mark.parametrize(("tau_ms", "cv"), [(30.0, 1.0), (30.0, 0.5), (5.0, 0.5)])
def test_out_at_rest_varies_as_filtered_renewal_spikes_do_in_both_engines(engine, tau_ms, cv):
    model = bg.BasalGanglia(reads(tau_ms, cv), engine, seed=4)
    out = model.out_at_rest(trials=60)
    assert out.mean() == pytest.approx(np.log(2), abs=0.01)
    assert out.std() == pytest.approx(shot_noise_nats(tau_ms, cv), rel=0.06)


@pytest.mark.parametrize("engine", NOISY)
def test_noise_in_one_tick_decides_nothing(engine):
    """Without a filter the sd of OUT would be 1.2 or 2.7 nats, by the engine's tick."""
    evidence = bg.gaussian_evidence(4, d_prime=0.5, t_max=4, seed=1)
    bare = reads(0.0)
    for call in ("run", "decide"):
        with refused("readout_tau_ms set readout_tau_ms"):
            level = {"posterior": 0.7} if call == "decide" else {}
            getattr(bg.BasalGanglia(bare, engine), call)(evidence, **level)
    with refused("readout_tau_ms"):
        bg.BasalGanglia(bare, engine).session(posterior=0.7).begin()
    bg.BasalGanglia(reads(30.0), engine).run(evidence)


def cured(circuit, message):
    for field, value in re.findall(r"(SNr\.\w+) ([-\d.e+]+)", message):
        circuit = circuit.set(field, float(value))
    return circuit


@given(st.floats(-3, 3), st.integers(2, 6))
@settings(max_examples=30, deadline=None)
def test_the_cure_of_a_read_out_off_chance_keeps_its_rate(bias, channels):
    circuit = reads(30.0, channels=channels, bias_nats=bias)
    out = rest_out(circuit)
    assume(not 0 < out < 1.05 * np.log(channels))
    (doubt,) = doubts(circuit)
    better = cured(circuit, doubt)
    assert rest_out(better) == pytest.approx(np.log(channels), abs=1e-3)
    assert doubts(better) == []
    if "baseline_hz" in doubt and resting_hz(circuit)["SNr"] > 0:
        assert resting_hz(better)["SNr"] == pytest.approx(resting_hz(circuit)["SNr"], rel=1e-3)


def test_a_threshold_that_needs_no_evidence_comes_with_the_cure():
    evidence = bg.gaussian_evidence(4, d_prime=0.5, t_max=4, seed=1)
    with refused("thresholds set SNr.bias_nats 1.693, and SNr.baseline_hz"):
        bg.BasalGanglia(reads(30.0, bias_nats=1.0), "rate").decide(evidence, posterior=0.7)
    with pytest.raises(ValueError, match=r"without evidence$"):
        bg.BasalGanglia(load_circuit("macaque").lesion("STN"), "rate").decide(
            evidence, posterior=0.7
        )


def ring(*weights, bias_nats=0.0, baseline_hz=20.0, **fields):
    """Return a circuit in which some nuclei excite each other in a ring; cortex drives the first.

    Their rates have no ceiling.
    """
    names = [f"N{k}" for k in range(len(weights))]
    cells = [
        Population(name, Rate(), baseline_hz, 10.0, tau_ms=5.0, bias_nats=bias_nats)
        for name in names
    ]
    ctx, snr = (Population(name, Rate(signed=True)) for name in ("ctx", "SNr"))
    around = [Projection(*ends, w, delay_ms=1.0, **fields)
              for *ends, w in zip(names, names[1:] + names[:1], weights, strict=True)]  # fmt: skip
    paths = (Projection("ctx", names[0], 1.0), Projection(names[0], "SNr", 1.0), *around)
    table = Circuit("ring", (ctx, *cells, snr), paths, 2)
    return replace(table, reference_nats=np.log(2))


@given(st.lists(st.floats(0.3, 3), min_size=1, max_size=4))
@settings(max_examples=30, deadline=None)
def test_the_gain_of_a_loop_is_the_product_of_its_weights(weights):
    gain = float(np.prod(weights))
    assume(abs(gain - 1) > 0.05)
    for fields in ({}, {"pattern": "diffuse"}):
        circuit = ring(*weights, **fields)
        share = 2 if fields else 1
        wiring = wired(circuit)
        names, amplification = amplifying(wiring, wiring.bias)
        assert names == [f"N{k}" for k in range(len(weights))]
        assert amplification == pytest.approx(gain * share ** len(weights))


@given(st.lists(st.floats(0.5, 3), min_size=1, max_size=4))
@settings(max_examples=8, deadline=None)
def test_a_loop_that_has_no_rest_is_named_and_cured_by_weakening_it(weights):
    gain = float(np.prod(weights))
    assume(gain > 1.05)
    # Without a baseline to lose, the loop can't rest in silence.
    circuit = ring(*weights, bias_nats=0.1, baseline_hz=0.0)
    loop = " -> ".join([f"N{k}" for k in range(len(weights))] + ["N0"])
    with pytest.raises(ValueError, match=rf"loop {loop} has a gain of {gain:.3g}, more"):
        resting_state(circuit)
    weaker = circuit.scale(f"N0->N{1 % len(weights)}", 0.9 / gain)
    assert np.isfinite(resting_state(weaker)[1]).all()
    assert not any("loop" in doubt for doubt in doubts(weaker))


@pytest.mark.parametrize("engine", ["rate", "population"])
def test_rates_that_run_away_in_a_run_name_the_loop(engine):
    # Silent at rest, below threshold: only evidence starts the loop.
    circuit = ring(1.5, 2.0, bias_nats=-2.5)
    drive = np.array([[[8.0, 0.0]] * 4])
    with pytest.raises(ValueError, match=r"run away.*N0 -> N1 -> N0 has a gain of 3"):
        run(circuit, drive, engine=engine, step_ms=500, seed=1)


@pytest.mark.parametrize("name", [name for name in CIRCUITS if name != "linear_gpe"])
def test_the_included_circuits_give_no_doubts(name):
    for channels in (2, 4):
        assert doubts(load_circuit(name, channels)) == []
