"""Dopamine: levels against closed forms, and what cannot be a level."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bgmodel import Msprt, first_crossing, stream
from bgmodel.deciding.decision import any_crossing
from bgmodel.deciding.tradeoff import Tradeoff, tradeoff
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.learning import dopamine as levels
from bgmodel.learning.dopamine import (
    THRESHOLD_NATS,
    decide_at_levels,
    decided_out,
    level_table,
    stopping_posterior,
    usable_range,
    working_range,
)
from bgmodel.simulated_evidence import separated_evidence
from circuits.anatomy import load_circuit
from circuits.engines import Rates
from circuits.errors import NoiseWarning
from tests.helpers import ROOT, refused, refusing
from tests.levels import GAIN, LEVELS, MODEL, SEED


@pytest.mark.parametrize("channels", [2, 5])
@pytest.mark.parametrize("level", [0.7, 1.0, 1.3])
def test_a_level_shifts_out_by_the_gain_times_the_drive(channels, level):
    """In the exact circuit OUT = S - k y, as long as that is a rate: not below 0."""
    table = load_circuit("bogacz_gurney", channels)
    odds = 1.5
    y = table.reference_nats - np.log(channels) + odds * (1 - 1 / channels)
    s = y + np.log1p((channels - 1) * np.exp(-odds))
    assert decided_out(table, level, odds) == pytest.approx(max(s - level * y, 0.0), abs=1e-9)


@pytest.mark.parametrize("channels", [2, 4])
def test_normal_dopamine_decides_at_the_posterior_of_the_threshold(channels):
    """At level 1 OUT = -ln softmax(kappa L): its inverse, all other alternatives equal."""
    table = load_circuit("bogacz_gurney", channels)
    p = np.exp(-0.3)
    odds = np.log(p * (channels - 1) / (1 - p)) / GAIN
    expected = 1 / (1 + (channels - 1) * np.exp(-odds))
    assert stopping_posterior(table, 1.0, 0.3, GAIN) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("name", ["macaque", "spiking_msprt"])
@pytest.mark.parametrize(("channels", "threshold"), [(2, 0.3), (4, 0.3), (4, 0.34)])
def test_the_fixed_point_spans_posteriors_from_75_to_99(name, channels, threshold):
    table = load_circuit(name, channels)
    gain = GAIN if name == "spiking_msprt" else gain_of(table)
    low, high = working_range(table, threshold)
    levels = np.geomspace(1.01 * low, 0.99 * high, 5)
    posteriors = [stopping_posterior(table, level, threshold, gain) for level in levels]
    assert np.all(np.diff(posteriors) < 0)
    assert posteriors[-1] < 0.75
    assert posteriors[0] > 0.99
    # The edges are where they are documented to be.
    most = table.max_deficit_nats if table.centred else table.reference_nats
    lowest = decided_out(table, low, np.linspace(0, most, 500)).min()
    assert lowest == pytest.approx(threshold, abs=1e-3)
    if high < 2:
        assert decided_out(table, high, 0.0) == pytest.approx(threshold, abs=1e-3)


def test_more_evidence_tells_the_default_circuit_next_to_nothing_once_its_competitors_are_silent():
    """Below its lowest level the fixed point never decides, however far the leader is ahead."""
    table = load_circuit("macaque")
    low, _ = working_range(table, THRESHOLD_NATS)
    far = table.reference_nats * np.array([1.0, 1.5, 2.0, 3.0])
    out = decided_out(table, 0.95 * low, far)
    assert np.all(out > THRESHOLD_NATS)
    assert out == pytest.approx(out[0], abs=4e-3)
    with refused("level"):
        stopping_posterior(table, 0.5, THRESHOLD_NATS, gain_of(table))


def test_a_learner_plays_what_evidence_decides_and_less_of_it_with_noise():
    low, high = working_range(MODEL.circuit, THRESHOLD_NATS)
    assert usable_range(MODEL, THRESHOLD_NATS) == pytest.approx((1.02 * low, 0.98 * high))
    silence = np.zeros((1, 1, 2))
    for level in LEVELS[[0, -1]]:
        model = replace(MODEL, circuit=MODEL.circuit.dopamine(level))
        assert model.run_drive(silence, step_ms=500.0).output_nats.min() > THRESHOLD_NATS
    table = MODEL.circuit.with_neurons(100)
    # Populations have the noise of their cells, and run faster.
    spikes = replace(MODEL, circuit=table, engine="population", seed=SEED)
    least, most = usable_range(spikes, THRESHOLD_NATS)
    assert least == pytest.approx(1.02 * low)
    assert 1.1 < most < 0.9 * high
    # Fresh noise at the edge finds what was asked for.
    edge = replace(spikes, circuit=table.dopamine(most), seed=SEED + 1)
    assert any_crossing(edge.out_at_rest(400), THRESHOLD_NATS).mean() < 0.06
    # Fewer cells make more noise.
    few = replace(spikes, circuit=table.with_neurons(40))
    assert usable_range(few, THRESHOLD_NATS)[1] < most - 0.05
    with refused("threshold_nats no level of dopamine takes spiking_msprt to"):
        usable_range(replace(few, circuit=few.circuit.with_neurons(5)), THRESHOLD_NATS)


CIRCUIT = MODEL.circuit


test_levels_and_thresholds_that_cannot_be_are_refused = refusing(
    (lambda: working_range(CIRCUIT, 3.0), "threshold_nats spiking_msprt, 0.0539 to 0.65 nats"),
    (lambda: working_range(CIRCUIT, 0.0), "threshold_nats must be within .* got 0"),
    (lambda: stopping_posterior(CIRCUIT, 1.9, 0.3, 0.5), r"level 0.8. to 1.7., got 1.9"),
    (lambda: decide_at_levels(MODEL, None, [], 0.3), "levels one or more numbers"),
    (lambda: decide_at_levels(MODEL, None, [1.0, 1.0], 0.3), "levels each once"),
    (lambda: decide_at_levels(MODEL, None, [1.0, -0.5], 0.3), r"levels must be within 0..2"),
    (lambda: CIRCUIT.scale("ctx->D1", 1.2, channel=0).dopamine(1.1), "dopamine ctx->D1"),
)


def test_a_sweep_of_levels_is_the_circuit_at_each_level(swept, level_evidence):
    assert np.all(np.diff(swept.settings) < 0)
    level = float(swept.settings[2])
    changed = replace(MODEL, circuit=MODEL.circuit.dopamine(level))
    alone = first_crossing(changed.run(level_evidence), THRESHOLD_NATS)
    assert np.array_equal(alone.choice, swept.choice[2])
    assert np.array_equal(alone.time_ms, swept.time_ms[2])


def test_a_level_at_which_a_circuit_decides_against_the_evidence_is_warned_of():
    evidence = separated_evidence(100, 60, 0.7, rng=3, step_ms=50.0)
    model = BasalGanglia("macaque", Rates(rates=False))
    with pytest.warns(NoiseWarning):
        decisions = decide_at_levels(model, evidence, [0.0, 1.0], 0.2)
    assert (decisions.choice[1] == evidence.truth).mean() < 0.2


def test_the_gap_in_equal_time_sees_a_slower_decider(level_evidence):
    """The MSPRT itself has none; with times half as long again, or 100 ms late, it loses."""
    test = tradeoff(Msprt(GAIN).run(level_evidence), level_evidence)
    keep = np.searchsorted(test.posterior.mean(axis=1), [0.7, 0.75, 0.8, 0.85, 0.9])
    fields = {n: getattr(test, n)[keep] for n in ("choice", "forced", "premature", "posterior")}
    gaps = {}
    for factor, late in ((1.0, 0.0), (1.5, 0.0), (1.0, 100.0)):
        time_ms = factor * test.time_ms[keep] + late
        slow = Tradeoff(np.linspace(1.6, 0.9, 5), time_ms=time_ms, **fields)
        options = {"circuit": MODEL.circuit, "gain": GAIN, "rng": stream(SEED, "boot")}
        table = level_table(slow, {"MSPRT": test}, latency_ms=0.0, **options)
        rows = table[table["measure"] == "accuracy_gap"]
        gaps[factor, late] = rows["value"].to_numpy()
    assert np.abs(gaps[1.0, 0.0]).max() < 0.005
    assert gaps[1.5, 0.0].max() < -0.01
    assert gaps[1.0, 100.0].max() < -0.005


@pytest.mark.parametrize("channels", levels.LATENCY_MS)
def test_the_latency_is_what_was_measured_on_raw_evidence(channels):
    """The time that the default circuit takes more than its test, in a table of the results."""
    table = pd.read_csv(ROOT / "figures/decisions/tables/raw_decisions.csv")
    table = table[table["evidence"].eq(f"Gaussian, d' 1, N = {channels}")]
    table = table[table["engine"].eq("population")]
    extra_ms = table[table["accuracy"].isin([0.9, 0.95])]["extra_ms"]
    assert len(extra_ms) == 2
    assert levels.LATENCY_MS[channels] == pytest.approx(extra_ms.mean(), abs=1)
