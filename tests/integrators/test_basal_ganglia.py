"""A circuit as an integrator: its drive, its batches, its warnings."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bgmodel import Msprt, first_crossing, stream
from bgmodel.evidence import Evidence, minus_log_softmax
from bgmodel.integrators import basal_ganglia
from bgmodel.integrators.at_thresholds import decide_at_thresholds
from bgmodel.integrators.basal_ganglia import BasalGanglia, drive_of
from bgmodel.integrators.criterion import gain_of
from bgmodel.simulated_evidence import expecting, gaussian_evidence, separated_evidence
from bgmodel.trials.named_evidence import NamedEvidence, trial_table
from circuits import anatomy
from circuits.anatomy import load_circuit, macaque
from circuits.engines import Algebra, Populations, Rates, Spikes, engine_of
from circuits.errors import CalibrationWarning, EditWarning, NoiseWarning, RangeWarning
from tests.helpers import refused, unwarned

SEED, GAIN = 51, 0.5
TABLE = load_circuit("spiking_msprt", 4)
EVIDENCE = separated_evidence(
    120, 30, 1 / np.sqrt(2), rng=stream(SEED, "study"), hypotheses=4, step_ms=50.0
)
MODEL = BasalGanglia(TABLE, Spikes(workers=2), GAIN, SEED)


def test_without_integrate_and_fire_cells_own_laws_are_the_lines():
    table = load_circuit("appendix_b", 3)
    drive = np.array([[[1.0, 0.0, -1.0]]])
    line, of_cells = (
        BasalGanglia(table, Algebra(laws=laws)).run_drive(drive, 1.0) for laws in ("table", "cells")
    )
    np.testing.assert_allclose(of_cells.output_nats, line.output_nats, atol=1e-9)


def test_one_trial_is_what_it_is_among_all_with_its_own_noise():
    evidence = EVIDENCE[:6]
    model = BasalGanglia(TABLE, "population", GAIN, SEED)
    ((_, activity, _),) = model.batches(evidence)
    for first, trial in ((0, 3), (2, 1), (2, 3)):
        alone, _ = model.one_trial(evidence[first:], first, trial)
        np.testing.assert_array_equal(alone.output_nats[0], activity.output_nats[first + trial])


def test_a_threshold_that_noise_crosses_is_warned_of():
    with pytest.warns(NoiseWarning):
        MODEL.warn_of_noise(0.62)
    with unwarned():
        MODEL.warn_of_noise(0.3)
        replace(MODEL, engine="algebra").warn_of_noise(0.62)


@pytest.mark.parametrize("sample_ms", [0.5, 1.0, 5.0])
def test_a_batch_without_rates_holds_as_many_trials_as_its_out_has_room_for(sample_ms):
    """More samples, fewer trials; with rates, or of very long trials, the least batch."""
    engine = Populations(noise=False, rates=False, sample_ms=sample_ms)
    model = BasalGanglia(macaque(2), engine, GAIN, SEED)
    long = separated_evidence(4000, 60, 0.5, rng=stream(SEED, "long"), step_ms=50.0)
    activity = model.activity(long[:1])
    numbers = activity.output_nats.size
    most = min(basal_ganglia.WIDE_BATCH, basal_ganglia.WIDE_NUMBERS / numbers)
    assert model.batch(long) == pytest.approx(most, rel=0.03)
    with_rates = replace(model, engine=replace(engine, rates=True))
    assert with_rates.batch(long) == basal_ganglia.BATCH
    if sample_ms == 1.0:  # each ms, unless an option says otherwise
        by_default = replace(model, engine=Populations(noise=False, rates=False))
        assert by_default.batch(long) == model.batch(long)
    endless = replace(long, step_ms=50_000.0)
    assert model.batch(endless) == basal_ganglia.BATCH


@given(
    arrays(np.float64, (3, 4, 5), elements=st.floats(-60, 60)), st.floats(2, 20), st.floats(0.3, 1)
)
def test_a_reach_changes_out_by_no_more_than_it_says(readings, reach, gain):
    """OUT is -ln P within ln(1 + (N - 1) exp(-reach)), however strong the evidence."""
    evidence = Evidence(readings)
    exact = Msprt(gain).run(evidence).out_nats
    held = minus_log_softmax(drive_of(evidence, gain, reach))
    winner = exact.argmin(axis=2)[..., None]
    change = np.take_along_axis(held - exact, winner, axis=2)
    assert np.all(change >= -1e-9)
    assert np.all(change <= np.log1p(4 * np.exp(-reach)) + 1e-9)
    drive = drive_of(evidence, gain, reach)
    assert np.ptp(drive, axis=2).max() <= reach + 1e-9


def test_ties_of_a_circuit_are_those_of_the_test_in_any_batch(monkeypatch):
    """Evidence that says nothing: the choice hangs on the trial's number alone."""
    monkeypatch.setattr(basal_ganglia, "BATCH", 7)
    flat = Evidence(np.zeros((40, 2, 3)), np.arange(40) % 3, step_ms=50.0)
    model = BasalGanglia(load_circuit("bogacz_gurney", 3), "algebra")
    decision = decide_at_thresholds(model, flat, [0.5])["circuit"]
    expected = first_crossing(Msprt().run(flat), 0.5)
    assert decision.forced.all()
    assert (decision.choice[0] == expected.choice).all()
    # And a trial of one reading of two ends a step after it.
    short = replace(flat, lengths=np.where(np.arange(40) % 2, 1, 2))
    trace = BasalGanglia(load_circuit("bogacz_gurney", 3), "rate").run(short)
    ends_ms = first_crossing(trace, 0.5).deadline_ms
    assert set(ends_ms[::2]) == {150.0}
    assert set(ends_ms[1::2]) == {100.0}


@pytest.mark.parametrize("engine", ["algebra", "rate", "spikes"])
def test_a_circuit_decides_a_short_trial_as_if_it_were_alone(engine):
    """Among longer ones each ends a step after its own last reading, decided, forced or not."""
    lengths = np.array([1, 2, 3, 5, 8, 8])
    drawn = separated_evidence(6, 8, 0.8, rng=stream(SEED, "ragged"), step_ms=50.0)
    values = drawn.log_likelihood * (np.arange(8) < lengths[:, None])[..., None]
    ragged = replace(drawn, log_likelihood=values, lengths=lengths)
    table = load_circuit("spiking_msprt", 2).with_neurons(40)
    model = BasalGanglia(table, engine, 0.7, SEED if engine == "spikes" else None)
    for threshold in (0.55, 0.1):
        together = first_crossing(model.run(ragged), threshold)
        for n, length in enumerate(lengths):
            trial = Evidence(values[n : n + 1, :length], step_ms=50.0, numbers=np.array([n]))
            activity = model.activity(trial, first_trial=n)
            alone = first_crossing(model.trace(activity, trial), threshold)
            assert alone.choice[0] == together.choice[n]
            assert alone.forced[0] == together.forced[n]
            assert alone.time_ms[0] == together.time_ms[n]
            assert alone.deadline_ms[0] == together.deadline_ms[n]
            row = trial_table(alone, NamedEvidence(trial, ["a", "b"]), model="m")
            assert row["steps"][0] <= length
    assert together.forced.any()


def test_a_gain_is_the_tables_own_or_asked_for():
    spiking = {n: gain_of(anatomy.spiking_msprt(n)) for n in (2, 3, 4, 7, 8, 12)}
    assert spiking == {2: 0.7, 3: 0.5, 4: 0.5, 7: 0.5, 8: 0.6, 12: 0.6}
    assert gain_of(anatomy.spiking_msprt(), 0.3) == 0.3
    for name in ("bogacz_gurney", "appendix_b"):
        exact = load_circuit(name)
        assert gain_of(exact) == gain_of(exact.dopamine(0.9)) == 1
        assert gain_of(exact, 0.7) == 0.7
    for name in ("linear_gpe", "gpr", "humphries", "stewart"):
        with pytest.raises(ValueError, match=rf"{name} has no default gain: give gain"):
            BasalGanglia(name)
    # Numbers made for two alternatives say nothing of five.
    assert anatomy.spiking_msprt(2).with_channels(5).default_gain is None
    assert anatomy.spiking_msprt(2).with_channels(2).default_gain == 0.7


@pytest.mark.parametrize("forced", [True, False])
def test_decisions_that_are_not_right_as_often_as_their_posteriors_say_are_warned_of(forced):
    """Python warns as the command does; evidence that is shuffled has no truth in it."""
    evidence = separated_evidence(300, 40, 0.5, rng=3, step_ms=50)
    model = BasalGanglia("macaque", Populations(rates=False), seed=3)
    with unwarned():
        model.decide(evidence, posterior=0.8, forced=forced)
    shuffled = replace(evidence, truth=stream(3, "shuffled").permutation(evidence.truth))
    with pytest.warns(CalibrationWarning, match="too sure"):
        model.decide(shuffled, posterior=0.8, forced=forced)
    model.decide(replace(evidence, truth=None), posterior=0.8)


def test_what_is_expected_reaches_all_channels_before_the_onset():
    drawn = separated_evidence(3, 4, 0.5, rng=stream(1, "x"), step_ms=50.0)
    ahead = expecting(drawn, 3.0, 100.0, rng=stream(1, "r"))
    model = BasalGanglia(macaque(2), "population", 0.5, seed=1)
    before, after = np.split(model.drive(ahead), [2], axis=1)
    top = ahead.expectancy_nats[:, -1, None, None]
    np.testing.assert_allclose(before[:, :, 0], 0.5 * ahead.expectancy_nats)
    np.testing.assert_allclose(after - 0.5 * top, model.drive(drawn))
    trace = model.run(ahead)
    assert trace.time_ms[[0, -1]].tolist() == [1, 350]
    assert trace.onset_ms == 100
    ragged, part = replace(ahead, lengths=np.array([4, 4, 4])), ahead[1:2]
    np.testing.assert_array_equal(model.run(ragged).of_trials()[0], [350] * 3)
    np.testing.assert_array_equal(
        model.trace(model.activity(part, 1), part).out_nats, trace.out_nats[1:2]
    )


def test_evidence_drives_a_circuit_by_its_own_nats_unless_a_gain_is_given():
    total = EVIDENCE.totals
    wanted = total - total.mean(axis=2, keepdims=True)
    np.testing.assert_allclose(drive_of(EVIDENCE), wanted, atol=1e-12)


def strong(d_prime, channels=2, trials=200, steps=40, step_ms=50.0):
    """Gaussian evidence with a separation in standard deviations per reading."""
    return separated_evidence(
        trials,
        steps,
        d_prime / np.sqrt(2),
        rng=stream(SEED, "strong"),
        hypotheses=channels,
        step_ms=step_ms,
    )


@given(st.sampled_from([2, 4, 8]), st.sampled_from([10.0, 50.0, 200.0]), st.floats(0.05, 40))
def test_the_lead_per_100_ms_decides_between_silence_warning_and_refusal(channels, step_ms, ratio):
    table, most = macaque(channels), basal_ganglia.REFUSED_TIMES
    per_reading = ratio * table.max_lead_nats / max(1, 100 / step_ms)
    reading = np.zeros(channels)
    reading[0] = per_reading
    evidence = Evidence(np.broadcast_to(reading, (2, 5, channels)), step_ms=step_ms, baseline=0.0)
    model = BasalGanglia(table, "rate", 1.0)
    assert model.lead_nats(evidence) == pytest.approx(ratio * table.max_lead_nats)
    BasalGanglia(table, "algebra", 1.0).check_strength(evidence)
    BasalGanglia(replace(table, max_lead_nats=np.inf), "rate", 1.0).check_strength(evidence)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        if ratio > 1.001 * most:
            with refused("evidence lower the gain"):
                model.check_strength(evidence)
        elif ratio < 0.999 * most:
            model.check_strength(evidence)
    if min(abs(ratio - 1), abs(ratio / most - 1)) > 2e-3:
        assert len(caught) == (1 < ratio < most)


def test_too_strong_evidence_is_refused_wherever_a_circuit_runs_on_evidence_and_said_once():
    table = macaque(2)
    model = BasalGanglia(table, "population", gain_of(table), SEED)
    for run in (model.run, model.activity, lambda evidence: next(model.batches(evidence))):
        with refused("evidence too strong"):
            run(strong(10.0))
    with pytest.warns(RangeWarning, match="too strong") as caught:
        parts = [part.trials for part, _, _ in model.batches(strong(4.0, trials=300, steps=2))]
    assert (len(parts), len(caught)) == (2, 1)


TIMES = ("set STN->GPe.delay_ms=4", "set STN->GPe.tau_ms=7")


@pytest.mark.parametrize(
    ("edit", "without", "used"),
    [
        (lambda c: c.with_heterogeneity(0.2), ["algebra", "rate"], "population"),
        (lambda c: c.with_neurons(5), ["algebra", "rate"], "population"),
        (lambda c: c.with_neurons(5), [], Algebra(laws="finite")),
        (lambda c: c.with_connections(0.5), ["algebra", "rate"], "population"),
        (lambda c: c.edited("set STN.cell.cv=0.9", "set STN.bias_nats=0.1"), ["algebra", "rate"],
         "population"),
        (lambda c: c.edited(*TIMES), ["algebra"], "rate"),
        (lambda c: c.lesion("STN", 0.5), [], "algebra"),
        (lambda c: c, [], "rate"),
    ],
)  # fmt: skip
def test_an_edit_that_an_engine_makes_no_use_of_is_warned_of(edit, without, used):
    for engine in without:
        with pytest.warns(EditWarning):
            BasalGanglia(edit(macaque()), engine)
    with unwarned():
        BasalGanglia(edit(macaque()), used, seed=SEED if used == "population" else None)


@pytest.mark.parametrize("engine", ["rate", "population"])
def test_decisions_on_less_evidence_than_asked_for_are_warned_of(engine):
    """A hopeless third alternative, or a jump of all, which leave the test's decisions as they are.

    OUT of the others falls before STN and GPe have balanced what all have gained.
    """
    drawn = gaussian_evidence(200, d_prime=0.5, t_max=60, step_ms=50, seed=0)
    third = np.concatenate([drawn.log_likelihood, np.full((200, 60, 1), -50.0)], axis=2)
    jump = drawn.log_likelihood.copy()
    jump[:, 0] += 10
    for readings in (third, jump):
        evidence = Evidence(readings, drawn.truth, step_ms=50.0, baseline=readings.mean())
        model = BasalGanglia(load_circuit("macaque", readings.shape[2]), engine, seed=SEED)
        with pytest.warns(CalibrationWarning):
            assert model.decide(evidence, posterior=0.75).accuracy < 0.7
    model = BasalGanglia(load_circuit("macaque", 2), engine, seed=SEED)
    with unwarned():
        assert model.decide(drawn, posterior=0.75).accuracy > 0.85
        edited = replace(model, circuit=model.circuit.edited("lesion STN 5%"))
        edited.decide(drawn, posterior=0.75)


def test_decisions_against_the_evidence_at_the_deadline_are_warned_of():
    """What is left of OUT without D1 comes from D2, and rises with the evidence."""
    evidence = separated_evidence(100, 20, 0.7, rng=3, step_ms=50.0)
    with pytest.warns(CalibrationWarning, match="choices go against the evidence"):
        decided = BasalGanglia(macaque().lesion("D1"), "algebra").decide(evidence, posterior=0.82)
    assert decided.forced.all()
    assert (decided.choice == evidence.truth).mean() < 0.2


def test_decisions_against_the_evidence_are_warned_of_with_and_without_a_truth():
    evidence = separated_evidence(100, 60, 0.7, rng=3, step_ms=50.0)
    for given_truth in (evidence, replace(evidence, truth=None)):
        with pytest.warns(CalibrationWarning, match="choices go against the evidence"):
            decided = BasalGanglia(macaque().dopamine(0.0), Rates(rates=False)).decide(
                given_truth, posterior=0.82
            )
        assert (decided.choice == evidence.truth).mean() < 0.2
        with unwarned():
            for level in (0.6, 1.0):
                model = BasalGanglia(macaque().dopamine(level), Rates(rates=False))
                model.decide(given_truth, posterior=0.7)


@pytest.mark.parametrize("engine", ["spikes", "rate"])
def test_the_memory_of_a_run_is_told_in_gigabytes(engine):
    """As much as what it gives, and not many times that."""
    model = BasalGanglia(load_circuit("spiking_msprt"), engine, 0.5, 1)
    activity = model.run_drive(np.zeros((10, 4, 2)), 50.0)
    held = activity.output_nats.nbytes + sum(rates.nbytes for rates in activity.rates_hz.values())
    assert 0.5 * held < 1e9 * model.memory_gb(10, 4, 50.0) < 20 * held
    # The documented memory for 200 samples, one per ms, in units of 1e9 bytes.
    kept = engine_of(engine).memory_bytes(model.circuit, 10, 200)
    assert 1e9 * model.memory_gb(10, 4, 50.0) == pytest.approx(kept)
    coarse = replace(model, engine=engine_of(engine, sample_ms=5.0))
    kept = coarse.engine.memory_bytes(model.circuit, 10, 40)
    assert 1e9 * coarse.memory_gb(10, 4, 50.0) == pytest.approx(kept)


def test_a_circuit_without_the_mean_over_channels_refuses_what_is_expected():
    ahead = expecting(
        separated_evidence(3, 4, 0.5, rng=stream(1, "x")), 3.0, 5.0, rng=stream(1, "r")
    )
    with refused("evidence ^the expectation is common to all channels"):
        BasalGanglia(load_circuit("spiking_msprt"), "algebra", gain=0.5).run(ahead)
