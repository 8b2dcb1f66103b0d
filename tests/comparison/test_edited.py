"""A circuit versus the MSPRT: a small comparison that must succeed, and controls that must fail."""

import re
from dataclasses import replace

import numpy as np
import pytest

from bgmodel import stream
from bgmodel.comparison.compare import compare, with_other_noise
from bgmodel.comparison.edited import compare_edits
from bgmodel.comparison.matched import OTHER_NOISE, matched_measures
from bgmodel.comparison.page import page
from bgmodel.comparison.thresholds import MSPRT, MSPRT_AT_GAIN, msprt_tradeoffs
from bgmodel.deciding.tradeoff import tradeoff
from bgmodel.integrators import basal_ganglia
from bgmodel.integrators.at_thresholds import (
    CIRCUIT,
    DECODER,
    decide_at_thresholds,
    thresholds_about,
    without_noise_alone,
)
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.baselines import BASELINES
from bgmodel.simulated_evidence import separated_evidence
from circuits.anatomy import load_circuit
from circuits.engines import Spikes, engine_of
from circuits.errors import EditWarning, RangeWarning
from circuits.laws.controls import shuffled_stn

SEED, GAIN = 51, 0.5
TABLE = load_circuit("spiking_msprt", 4)
FOUR = {"hypotheses": 4, "step_ms": 50.0}
EVIDENCE = separated_evidence(120, 30, 1 / np.sqrt(2), rng=stream(SEED, "study"), **FOUR)
MODEL = BasalGanglia(TABLE, Spikes(workers=2), GAIN, SEED)
POPULATIONS = replace(MODEL, engine=engine_of("population"))
"""For controls that must fail by far: with the noise of its cells, and faster."""


def of(table, measure, model=CIRCUIT, reference=MSPRT_AT_GAIN, column="value", **more):
    rows = table[(table["measure"] == measure) & (table["model"] == model)]
    rows = rows[rows["reference"] == reference]
    for name, value in more.items():
        rows = rows[rows[name] == value]
    return rows[column].iloc[0]


@pytest.fixture(scope="module")
def table():
    every = tuple(BASELINES)
    options = {"seed": SEED, "accuracies": (0.9, 0.95), "resamples": 200}
    return compare(MODEL, EVIDENCE, baselines=every, **options).table


def test_the_spiking_circuit_decides_as_the_msprt(table):
    """120 trials: the bars of `make score` need thousands, these are three errors below them."""
    assert of(table, "agreement", accuracy=0.95) > 0.95
    assert of(table, "within_50_ms", accuracy=0.95) > 0.7
    assert 20 < of(table, "extra_ms", accuracy=0.95) < 100
    assert of(table, "pearson_r", DECODER, accuracy=0.95) > 0.9
    # Counting for 20 ms and nothing else takes less time than the circuit.
    assert of(table, "extra_ms", DECODER, accuracy=0.95) < of(table, "extra_ms", accuracy=0.95)
    assert of(table, "accuracy_gap", "race", MSPRT, "high", accuracy=0.95) < 0
    # Rivals are abstract: all of their time is decision time.
    near = {"accuracies": (0.9, 0.95)}
    full = msprt_tradeoffs(EVIDENCE, GAIN, **near)[MSPRT]
    for name, baseline in BASELINES.items():
        options = {"truth": EVIDENCE.truth, "resamples": 2, **near}
        swept = tradeoff(baseline().run(EVIDENCE), EVIDENCE, **near)
        alone = matched_measures(full, swept, rng=stream(1, "b"), latency_ms=0.0, **options)
        gap = alone[alone["measure"] == "accuracy_gap"].set_index("accuracy")["value"][0.95]
        np.testing.assert_equal(of(table, "accuracy_gap", name, MSPRT, accuracy=0.95), gap)
    text = page(table)
    assert "cortical decoder" in text
    assert "at an accuracy of 0.9" in text
    assert "other noise" not in text


def test_without_gpe_or_the_right_sum_the_circuit_agrees_less():
    edited = {"GPe": TABLE.clamp("GPe"), "shuffled": shuffled_stn(TABLE)}
    options = {"seed": SEED, "accuracies": (0.95,), "resamples": 100}
    comparison = compare_edits(POPULATIONS, edited, EVIDENCE, **options)
    rows = comparison[comparison["kind"] == "value"].set_index(["variant", "measure"])["value"]
    assert rows["GPe", "within_50_ms"] < rows["intact", "within_50_ms"] - 0.2
    assert np.isnan(rows["shuffled", "agreement"])  # it never is right that often


@pytest.mark.parametrize(
    "edited",
    [TABLE, TABLE.lesion("STN", 0.3), TABLE.with_neurons(30)],
    ids=["intact", "crosses early", "noisy"],
)
@pytest.mark.parametrize(("tau_ms", "share"), [(None, 0.3), (20.0, 0.3), (20.0, 0.97)])
def test_dropping_decided_trials_changes_nothing(monkeypatch, edited, tau_ms, share):
    """A trial is over where it is dropped, unless the decoder has not got there."""
    monkeypatch.setattr("bgmodel.integrators.at_thresholds.DROPPED", share)
    levels = thresholds_about(msprt_tradeoffs(EVIDENCE, GAIN)[MSPRT_AT_GAIN])
    model = replace(MODEL, circuit=edited)
    # Batches of 6: a trial that is run again has the noise of its place among all.
    monkeypatch.setattr(basal_ganglia, "BATCH", 6)
    dropped = decide_at_thresholds(model, EVIDENCE[:12], levels, decoder_tau_ms=tau_ms)
    monkeypatch.setattr(Spikes, "until", lambda engine, level_nats, rates: engine)
    undropped = decide_at_thresholds(model, EVIDENCE[:12], levels, decoder_tau_ms=tau_ms)
    assert set(undropped) == {CIRCUIT} | ({DECODER} if tau_ms else set())
    for name, one in undropped.items():
        for field in ("choice", "time_ms", "forced", "posterior"):
            assert np.array_equal(getattr(one, field), getattr(dropped[name], field)), (name, field)


QUICK = BasalGanglia(TABLE, "population", GAIN, SEED)
LONG = separated_evidence(200, 60, 1 / np.sqrt(2), rng=stream(SEED, "refused"), **FOUR)


def test_accuracies_that_out_cannot_stand_for_are_refused_and_the_others_given():
    """At 0.8 the MSPRT decides where OUT rests, at 0.999 where no OUT is read."""
    options = {"seed": SEED, "baselines": (), "accuracies": (0.8, 0.95, 0.999), "resamples": 20}
    with pytest.warns(RangeWarning) as caught:
        comparison = compare(QUICK, LONG, **options).table
    # Each with its own reason.
    texts = " ".join(str(one.message) for one in caught)
    assert re.search("possible at accuracy 0.8: spiking_msprt .* OUT rests at", texts)
    assert re.search("possible at accuracy 0.999: spiking_msprt .* its read-out resolves", texts)
    known = comparison[(comparison["model"] == CIRCUIT) & (comparison["measure"] == "agreement")]
    known = known[known["reference"] == MSPRT_AT_GAIN].set_index("accuracy")["value"]
    assert known.notna().to_dict() == {0.8: False, 0.95: True, 0.999: False}


def test_a_lesion_gives_no_value_and_no_change_where_evidence_does_not_decide():
    edited = {"blind": TABLE.scale("ctx->STN", 0.5)}
    options = {"seed": SEED, "accuracies": (0.8, 0.95), "resamples": 20}
    with pytest.warns(RangeWarning, match="no comparison is possible at") as caught:
        edits = compare_edits(QUICK, edited, LONG, **options)
    text = " ".join(str(one.message) for one in caught)
    assert "no comparison is possible at accuracy 0.8: spiking_msprt would have to" in text
    assert "no comparison is possible at accuracy 0.8, 0.95: blind decides without evidence" in text
    rows = edits[edits["measure"].eq("agreement")].set_index(["variant", "kind", "accuracy"])
    known = rows["value"].notna()
    assert known[known].index.tolist() == [("intact", "value", 0.95), ("intact", "change", 0.95)]
    fixed = edits[edits["kind"].eq("fixed")].set_index(["variant", "accuracy", "measure"])["value"]
    assert fixed["blind", 0.95, "without_evidence"] == 1
    assert np.isnan(fixed["blind", 0.8, "without_evidence"])


def test_the_ceiling_is_the_circuit_beside_itself_and_1_without_noise():
    options = {"seed": SEED, "baselines": (), "accuracies": (0.95,), "resamples": 20}
    noisy = compare(QUICK, LONG, noise_ceiling=True, **options).table
    r = of(noisy, "pearson_r", reference=OTHER_NOISE)
    assert 0.8 < r < 1
    exact = of(noisy, "pearson_r") / np.sqrt(r)
    assert of(noisy, "r_noise_corrected") == pytest.approx(exact, rel=0.03)
    assert of(noisy, "agreement_chance") < of(noisy, "agreement", reference=OTHER_NOISE)
    # Against itself it has no latency. Only the circuit has another noise, and so a ceiling.
    again = noisy[noisy["reference"] == OTHER_NOISE].set_index("measure")["value"]
    assert abs(again["accuracy_gap"]) < 0.02
    rows = noisy[noisy["measure"] == "r_noise_corrected"]
    assert set(rows["model"]) == {CIRCUIT}
    assert set(rows["reference"]) == {MSPRT_AT_GAIN, MSPRT}
    text = page(noisy)
    assert "circuit with other noise: the circuit compared with itself" in text
    exact = replace(QUICK, engine="algebra")
    without = compare(exact, LONG, noise_ceiling=True, **options).table
    for measure in ("agreement", "agreement_corrected", "pearson_r", "within_50_ms"):
        assert of(without, measure, reference=OTHER_NOISE) == pytest.approx(1)
    assert of(without, "r_noise_corrected") == pytest.approx(of(without, "pearson_r"))


class Steep:
    """A test whose setting is ten times the share of errors, or 0."""

    def __init__(self, factor=10.0):
        self.factor = factor

    def setting(self, accuracy):
        return self.factor * (1 - accuracy)


def test_thresholds_of_a_circuit_lie_about_those_of_the_test_from_80_to_98_per_cent():
    """By 30 % on either side; from where the test's are 0, from 2 to 1 thousandths of a nat."""
    levels = thresholds_about(Steep())
    assert (len(levels), *levels[[0, -1]]) == pytest.approx((120, 1.3 * 2.0, 0.7 * 0.2))
    assert np.diff(np.log(levels)) == pytest.approx(np.log(levels[1] / levels[0]))
    levels = thresholds_about(Steep(), highest=0.99, lowest=0.5)
    assert levels[[0, -1]] == pytest.approx((1.3 * 5.0, 0.7 * 0.1))
    assert thresholds_about(Steep(0.0))[[0, -1]] == pytest.approx((0.002, 0.001))


@pytest.mark.parametrize(
    ("engine", "options", "noisy"),
    [
        ("population", {}, True),
        ("population", {"noise": False}, False),
        ("spikes", {}, True),
        ("rate", {}, False),
        ("algebra", {}, False),
    ],
)
def test_only_noise_keeps_thresholds_away_from_rest(monkeypatch, engine, options, noisy):
    """At rest 20 of 1000 trials reach 0.5, one more 0.6: the share that noise may cross is 2 %."""
    rest = np.full((1000, 3, 2), 0.8)
    rest[:20, 1, 0], rest[20, 2, 1] = 0.5, 0.6
    monkeypatch.setattr(BasalGanglia, "out_at_rest", lambda self: rest)
    model = replace(QUICK, engine=engine_of(engine, **options))
    assert model.engine.noisy == noisy
    levels = np.array([0.9, 0.6, 0.55, 0.5, 0.3])
    kept = without_noise_alone(model, levels).tolist()
    assert kept == ([0.55, 0.5, 0.3] if noisy else levels.tolist())


def test_each_seed_has_another_noise_of_its_own(monkeypatch):
    asked = []

    def decided(model, evidence, thresholds, *, decoder_tau_ms):
        asked.append(model.seed)
        return {CIRCUIT: None}

    monkeypatch.setattr("bgmodel.comparison.compare.decide_at_thresholds", decided)
    test = msprt_tradeoffs(EVIDENCE, GAIN)[MSPRT]
    for seed in (7, 8, None, 0):
        with_other_noise(replace(QUICK, seed=seed), EVIDENCE, test)
    assert len(set(asked[:3])) == 3
    assert asked[2] == asked[3]
    assert with_other_noise(replace(QUICK, engine="algebra"), EVIDENCE, test) is test
    assert len(asked) == 4


def test_an_edit_that_changes_nothing_is_warned_of():
    options = {"seed": SEED, "accuracies": (0.95,), "resamples": 100}
    edited = {"D1->SNr=1": TABLE.scale("D1->SNr", 1.0)}
    with pytest.warns(EditWarning):
        compare_edits(replace(QUICK, engine="rate"), edited, LONG, **options)


@pytest.mark.parametrize(
    "other",
    [
        load_circuit("spiking_msprt", 2),  # other channels
        load_circuit("macaque", 4),  # another table
        TABLE.edited("add TRN like=STN", "add TRN->GPe weight=0.1"),  # rows that the circuit lacks
    ],
)
def test_what_a_circuit_is_no_edit_of_is_no_reference_of_it(other):
    options = {"seed": SEED, "accuracies": (0.95,), "resamples": 20}
    for call in (
        lambda: compare(QUICK, LONG, intact=other, **options).table,
        lambda: compare_edits(replace(QUICK, circuit=other), {"mine": TABLE}, LONG, **options),
    ):
        with pytest.raises(ValueError, match="is no edit of"):
            call()


@pytest.mark.parametrize("edited", ["STN", ["STN"], {"STN": "0.5"}, {"STN": QUICK}, {"STN": None}])
def test_edits_are_circuits_by_name(edited):
    with pytest.raises(ValueError, match="edited"):
        compare_edits(QUICK, edited, LONG, seed=SEED, resamples=20)
