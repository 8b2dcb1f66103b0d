"""Circuits made from nothing: noise of OUT, OUT at rest and loops, each with its cure."""

import re

import numpy as np
import pandas as pd
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import bgmodel as bg
from bgmodel import stream
from bgmodel.cli import main
from bgmodel.integrators.at_thresholds import decoded_input
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import doubts, rest_out
from bgmodel.integrators.steady import out_shift
from bgmodel.learning import dopamine
from bgmodel.simulated_evidence import separated_evidence
from circuits.activity import total_nats
from circuits.anatomy import CIRCUITS, load_circuit
from circuits.cells import Phase, Rate
from circuits.circuit import Circuit
from circuits.declaration.rows import Population, Projection
from circuits.dynamics.fixed_point import resting_hz, resting_state, wired
from circuits.dynamics.loops import amplifying
from circuits.engines import run
from circuits.errors import RangeWarning
from circuits.laws.controls import correlated, linear_stn
from circuits.laws.stability import ringing
from tests.helpers import refused, unwarned

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
    assume(abs(out / np.log(channels) - 1) > 0.05)
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
    lesioned = bg.BasalGanglia(load_circuit("macaque").lesion("STN"), "rate")
    with pytest.raises(ValueError, match=r"without evidence$"):
        lesioned.decide(evidence, posterior=0.7)


@pytest.mark.parametrize(("bias", "later"), [(1.6, False), (1.9, True)])
def test_a_posterior_is_doubted_where_out_rests_off_chance(bias, later):
    """-ln P rests at chance: elsewhere a threshold of -ln P stops at another posterior than P."""
    evidence = bg.gaussian_evidence(200, d_prime=0.7, t_max=60, seed=1)
    off, right = (bg.BasalGanglia(reads(30.0, bias_nats=b), "rate") for b in (bias, None))
    with pytest.warns(RangeWarning, match="stops at other posteriors than asked for: set SNr.bias"):
        steps = off.decide(evidence, posterior=0.65).steps.mean()
    edited = bg.BasalGanglia(load_circuit("macaque").set("SNr.bias_nats", -1.2), "rate")
    assert rest_out(edited.circuit) > 0.8
    with unwarned():
        assert later == (steps > right.decide(evidence, posterior=0.65).steps.mean())
        off.threshold(0.4, None)
        edited.threshold(None, 0.65)


def ring(*weights, bias_nats=0.0, baseline_hz=20.0, **fields):
    """Return a circuit in which some nuclei excite each other in a ring; cortex drives the first.

    Their rates have no ceiling.
    """
    names = [f"N{k}" for k in range(len(weights))]
    own = {"tau_ms": 5.0, "bias_nats": bias_nats}
    cells = [Population(name, Rate(), baseline_hz, 10.0, **own) for name in names]
    ctx, snr = (Population(name, Rate(signed=True)) for name in ("ctx", "SNr"))
    around = [Projection(*ends, w, delay_ms=1.0, **fields)
              for *ends, w in zip(names, names[1:] + names[:1], weights, strict=True)]  # fmt: skip
    paths = (Projection("ctx", names[0], 1.0), Projection(names[0], "SNr", 1.0), *around)
    return Circuit("ring", (ctx, *cells, snr), paths, 2, reference_nats=np.log(2))


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


LIMITED = [name for name in CIRCUITS if load_circuit(name).most_channels < 100]


def test_every_circuit_of_cells_states_its_limit():
    assert {"macaque", "spiking_msprt", "humphries"} <= set(LIMITED)


@pytest.mark.parametrize("name", LIMITED)
def test_at_its_most_alternatives_a_circuit_rests_where_it_reads(name):
    table = load_circuit(name, load_circuit(name).most_channels)
    low, high = table.readable_nats
    # A row's line may end a hundredth of a nat before the rest of many channels.
    assert low < rest_out(table) < high + 0.01
    assert np.isfinite(ringing(table)[0])


@pytest.mark.parametrize("name", LIMITED)
def test_one_more_is_refused_with_the_number(name, tmp_path, monkeypatch, capsys):
    most = load_circuit(name).most_channels
    sentence = f"{name} takes at most {most} alternatives, got {most + 1}"
    with pytest.raises(ValueError, match=sentence):
        load_circuit(name, most + 1)
    monkeypatch.chdir(tmp_path)
    for command in (["circuit", "run"], ["compare"]):
        assert main([*command, "--circuit", name, "--task", f"channels={most + 1}"]) == 2
        assert capsys.readouterr().err.strip() == f"bgmodel: {sentence}"


def test_what_needs_nats_is_refused_without_them():
    circuit = load_circuit("gpr")
    model = BasalGanglia(circuit, "rate", 0.1)
    evidence = separated_evidence(2, 3, 0.5, rng=stream(1, "saliences"), step_ms=50.0)
    activity = model.activity(evidence)
    for call in (
        lambda: total_nats(circuit, np.zeros((1, 2))),
        lambda: out_shift(circuit, circuit, [0.1]),
        lambda: linear_stn(circuit),
        lambda: correlated(circuit, 0.1),
        lambda: dopamine.decided_out(circuit, 1.0, 1.0),
        lambda: dopamine.working_range(circuit, 0.1),
        lambda: dopamine.stopping_posterior(circuit, 1.0, 0.1, 1.0),
        lambda: dopamine.usable_range(BasalGanglia(circuit, "algebra", 1.0), 0.1),
        lambda: decoded_input(activity, model.trace(activity, evidence)),
    ):
        with pytest.raises(ValueError, match=r"gpr works in salience, not nats: .* has no meaning"):
            call()


def test_a_circuit_without_nats_decides_at_a_threshold_in_its_unit(tmp_path, capsys):
    path = tmp_path / "gpr.csv"
    task = ["--circuit", "gpr", "--engine", "rate", "--task", "trials=40", "t_max=60"]
    done = ["circuit", "run", "--save", str(path), *task, "--gain", "0.2", "--threshold", "0.05"]
    assert main(done) == 0
    table = pd.read_csv(path)
    assert table["forced"].mean() < 0.5
    assert table.loc[~table["forced"], "correct"].mean() > 0.8
    capsys.readouterr()
    assert main([*done, "--force", "--edits", "lesion D1"]) == 0
    assert pd.read_csv(path)["forced"].all()


def test_lesions_of_a_circuit_without_nats_are_compared_in_its_unit(tmp_path, capsys):
    path = tmp_path / "lesions.csv"
    asked = ["--circuit", "gpr", "--engine", "rate", "--gain", "0.1", "--edits", "lesion STN 50%"]
    asked += ["--task", "trials=100", "t_max=20", "--accuracies", "0.9", "0.97"]
    assert main(["compare", "--save", str(path), *asked]) == 0
    printed = capsys.readouterr().err
    assert "gpr works in salience, not nats: its thresholds are in salience" in printed
    assert "circuit minus intact" in set(pd.read_csv(path)["model"])
