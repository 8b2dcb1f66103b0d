"""Studies on circuits: a small comparison that must succeed, and controls that must fail."""

import json
import re
import warnings
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bgmodel import Msprt, first_crossing, stream
from bgmodel.cli import main
from bgmodel.comparison import circuits as circuit_study
from bgmodel.comparison.circuits import (
    CIRCUIT,
    DECODER,
    MSPRT,
    MSPRT_AT_GAIN,
    at_rest,
    compare_edits,
    compare_with_msprt,
    decide_at_thresholds,
    msprt_sweeps,
    thresholds_about,
)
from bgmodel.comparison.compare import compare
from bgmodel.comparison.decoder import decoded_input
from bgmodel.comparison.page import behaviour, page
from bgmodel.comparison.steady import leader_drive, leader_out, out_shift, steady_out, steady_shifts
from bgmodel.evidence import Evidence, gaussian_evidence
from bgmodel.files import provenance_path
from bgmodel.integrators import basal_ganglia
from bgmodel.integrators.basal_ganglia import BasalGanglia, drive_of
from bgmodel.tables.trials import Trials, trial_table
from circuits.anatomy import circuit
from circuits.controls import correlated, perturbed, shuffled_stn

SEED, GAIN = 51, 0.5
TABLE = circuit("spiking_msprt", 4)
EVIDENCE = gaussian_evidence(
    120, 30, 1 / np.sqrt(2), rng=stream(SEED, "study"), hypotheses=4, step_ms=50.0
)
MODEL = BasalGanglia(TABLE, "ensemble", GAIN, SEED, {"workers": 2})


def of(table, measure, model=CIRCUIT, reference=MSPRT_AT_GAIN, column="value", **more):
    rows = table[(table["measure"] == measure) & (table["model"] == model)]
    rows = rows[rows["reference"] == reference]
    for name, value in more.items():
        rows = rows[rows[name] == value]
    return rows[column].iloc[0]


@pytest.fixture(scope="module")
def table():
    return compare_with_msprt(MODEL, EVIDENCE, seed=SEED, accuracies=(0.9, 0.95), resamples=200)


def test_the_spiking_circuit_decides_as_the_msprt(table):
    """120 trials: the bars of `make score` need thousands, these are three errors below them."""
    assert of(table, "agreement", accuracy=0.95) > 0.95
    assert of(table, "within_50_ms", accuracy=0.95) > 0.7
    assert 20 < of(table, "extra_ms", accuracy=0.95) < 100
    assert of(table, "pearson_r", DECODER, accuracy=0.95) > 0.9
    # Counting for 20 ms and nothing else takes less time than the circuit.
    assert of(table, "extra_ms", DECODER, accuracy=0.95) < of(table, "extra_ms", accuracy=0.95)
    assert of(table, "accuracy_gap", "race", MSPRT, "high", accuracy=0.95) < 0
    text = page(table)
    assert "cortical decoder" in text
    assert "at 0.95" in text
    assert "same where the reference errs" in text


@pytest.mark.parametrize("kind", ["sign", "shuffled"])
def test_wrong_evidence_does_not(kind):
    """Negative controls: the circuit gets something else than the test."""
    values = EVIDENCE.log_likelihood
    wrong = replace(EVIDENCE, log_likelihood=-values if kind == "sign" else values[::-1].copy())
    test = msprt_sweeps(EVIDENCE, GAIN)[MSPRT_AT_GAIN]
    found = decide_at_thresholds(MODEL, wrong, thresholds_about(test), decoder_tau_ms=None)[CIRCUIT]
    # The posterior is that of the right evidence.
    known = np.exp(-Msprt().run(EVIDENCE).out_nats)[:, -1]
    chosen = known[np.arange(EVIDENCE.trials), found.choice]
    assert chosen.mean(axis=1).max() < 0.6
    measured = compare(test, found, rng=stream(1, "b"), accuracies=(0.95,), resamples=50)
    agreement = measured.set_index("measure")["value"]["agreement"]
    assert np.isnan(agreement) or agreement < 0.5


def test_what_computes_is_needed():
    """GPe held at its rest, the STN's sum to the wrong channel: worse by a margin."""
    edited = {
        "GPe": TABLE.without("GPe", replaced=True),
        "shuffled": shuffled_stn(TABLE),
    }
    found = compare_edits(MODEL, edited, EVIDENCE, seed=SEED, accuracies=(0.95,), resamples=100)
    rows = found[found["kind"] == "value"].set_index(["variant", "measure"])["value"]
    assert rows["GPe", "within_50_ms"] < rows["intact", "within_50_ms"] - 0.2
    assert np.isnan(rows["shuffled", "agreement"])  # it never is right that often
    assert "intact" in behaviour(found)


@pytest.mark.parametrize(
    "edited",
    [TABLE, TABLE.without("STN", 0.3), TABLE.with_neurons(30)],
    ids=["intact", "crosses early", "noisy"],
)
@pytest.mark.parametrize("tau_ms", [None, 20.0])
def test_dropping_decided_trials_changes_nothing(monkeypatch, edited, tau_ms):
    """Below the lowest threshold a trial is over, unless the decoder has not got there."""
    given = thresholds_about(msprt_sweeps(EVIDENCE, GAIN)[MSPRT_AT_GAIN])
    model = replace(MODEL, circuit=edited)
    # Batches of 20: a trial that is run again has the noise of its place among all.
    monkeypatch.setattr(basal_ganglia, "BATCH", 20)
    dropped = decide_at_thresholds(model, EVIDENCE[:40], given, decoder_tau_ms=tau_ms)
    monkeypatch.setattr(circuit_study, "DROPPING", ())
    whole = decide_at_thresholds(model, EVIDENCE[:40], given, decoder_tau_ms=tau_ms)
    assert set(whole) == {CIRCUIT} | ({DECODER} if tau_ms else set())
    for name, one in whole.items():
        for field in ("choice", "time_ms", "forced", "posterior"):
            assert np.array_equal(getattr(one, field), getattr(dropped[name], field)), (name, field)


def test_trials_do_not_depend_on_their_batch(monkeypatch):
    given = thresholds_about(msprt_sweeps(EVIDENCE, GAIN)[MSPRT_AT_GAIN])
    whole = decide_at_thresholds(MODEL, EVIDENCE[:30], given)
    monkeypatch.setattr("bgmodel.integrators.basal_ganglia.BATCH", 7)
    parts = decide_at_thresholds(MODEL, EVIDENCE[:30], given)
    for name in (CIRCUIT, DECODER):
        assert np.array_equal(whole[name].time_ms, parts[name].time_ms)
        assert np.array_equal(whole[name].choice, parts[name].choice)


def test_the_decoder_of_a_steady_input_is_the_test():
    """Its OUT is -ln softmax of what the cortex stands for, within the counting error."""
    steady = replace(EVIDENCE[:40], log_likelihood=np.zeros((40, 20, 4)))
    steady.log_likelihood[:, 0, 0] = 3.0
    activity = MODEL.activity(steady)
    out = decoded_input(activity, MODEL.trace(activity, steady), tau_ms=100.0).out_nats[:, -200:, 0]
    wanted = Msprt(GAIN).run(steady).out_nats[0, -1, 0]
    assert out.mean() == pytest.approx(wanted, abs=0.03)


@pytest.mark.parametrize("name", ["bogacz_gurney", "appendix_b", "spiking_msprt"])
@pytest.mark.parametrize("lost", [0.1, 0.2])
def test_losing_stn_shifts_out_by_ln_of_what_is_left(name, lost):
    """The posterior criterion becomes (1 - f) P: exact, and nearly so where S - ln S is a line."""
    table = circuit(name, 3)
    shift = out_shift(table, table.without("STN", lost), 0.3)
    close = 0.01 if name == "spiking_msprt" else 1e-9
    assert shift == pytest.approx(np.log(1 - lost), abs=close)


def test_lesions_of_the_spiking_circuit_follow_its_fixed_point():
    edited = {"STN": TABLE.without("STN", 0.1), "D1": TABLE.without("D1", 0.1)}
    found = steady_shifts(TABLE, edited, [2.0, 2.5], seed=SEED, trials=10)
    assert (np.abs(found["value"] - found["exact_nats"]) < 0.02).all()
    assert (found[found["variant"] == "STN"]["high"] < -0.05).all()
    assert (found[found["variant"] == "D1"]["low"] > 0.02).all()


def test_what_lines_miss_of_a_lesion_is_in_the_cells_own_laws_and_their_number():
    edited = {"STN": TABLE.without("STN", 0.2), "GPe": TABLE.without("GPe", replaced=True)}
    found = steady_shifts(TABLE, edited, [1.75, 2.75], seed=SEED, trials=10)
    assert (np.abs(found["value"] - found["finite_nats"]) < 0.005).all()
    line_misses = np.abs(found["value"] - found["exact_nats"])
    assert line_misses.max() > 0.03


def test_a_shift_that_is_not_known_is_nan():
    """Neither that of cells that differ, by the laws of a finite number, nor 0 in its place."""
    differ = TABLE.with_spread(0.1)
    assert np.isnan(out_shift(differ, differ.without("STN", 0.1), 0.3, laws="finite"))
    assert np.isfinite(out_shift(differ, differ.without("STN", 0.1), 0.3, laws="cells"))


def test_without_integrate_and_fire_cells_own_laws_are_the_lines():
    table = circuit("appendix_b", 3)
    drive = np.array([[[1.0, 0.0, -1.0]]])
    line, own = (
        BasalGanglia(table, options={"laws": laws}).run_drive(drive, 1.0)
        for laws in ("table", "cells")
    )
    np.testing.assert_allclose(own.output_nats, line.output_nats, atol=1e-9)


def test_noise_of_out_falls_with_the_number_of_cells():
    sd = [
        steady_out(TABLE.with_neurons(n), [2.0], seed=SEED, trials=30, mean_ms=50).std()
        for n in (50, 450)
    ]
    assert 1.8 < sd[0] / sd[1] < 5  # 3 if cells are all there is


def test_every_number_is_varied_once_each_way():
    made = perturbed(TABLE, 0.2)
    assert len({str(table) for table in made.values()} | {str(TABLE)}) == len(made) + 1
    assert made["STN cv +20%"].population("STN").cell.cv == pytest.approx(0.36)
    assert made["ctx->STN delay_ms -20%"].projection("ctx", "STN").delay_ms == 2.0
    assert made["GPe tau_ms +20%"].population("GPe").cell.tau_ms == pytest.approx(12)
    assert made["read-out tau_ms -20%"].readout_tau_ms == pytest.approx(22.4)


def test_shared_noise_has_the_size_that_was_asked():
    noisy = correlated(TABLE, 0.2)
    silence = np.zeros((40, 10, 4))
    sd = []
    for table in (TABLE, noisy):
        y = BasalGanglia(table, "ensemble", seed=SEED).run_drive(silence, 50.0).decoded_nats("ctx")
        # Over 20 ms, the time of the shared noise.
        sd.append(y.reshape(40, 25, 20, 4).mean(axis=2).std())
    assert np.sqrt(sd[1] ** 2 - sd[0] ** 2) == pytest.approx(
        0.2 * np.sqrt(2 * np.exp(-1)), rel=0.25
    )


def test_a_threshold_that_noise_crosses_is_warned_of():
    with pytest.warns(
        UserWarning, match=r"threshold of 0\.62 nats in \d+% of trials within 500 ms"
    ):
        MODEL.warn_of_noise(0.62)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        MODEL.warn_of_noise(0.3)
        replace(MODEL, engine="algebra").warn_of_noise(0.62)


def run(*arguments):
    return main([str(a) for a in arguments])


SMALL = ("--trials", 100, "--d-prime", 1, "--t-max", 20, "--edits.neurons", 100)


def test_compare_command(tmp_path, capsys):
    out = tmp_path / "a.csv"
    assert run("compare", out, *SMALL, "--accuracies", 0.9) == 0
    shown = capsys.readouterr().out
    assert "MSPRT at its gain, circuit: " in shown
    found = pd.read_csv(out, comment="#")
    assert {"circuit", "cortical decoder", "race", "LCA"} <= set(found["model"])
    behind = json.loads(provenance_path(out).read_text())
    assert behind["parameters"]["command"]["gain"] == 0.7
    again = tmp_path / "b.csv"
    assert run("compare", again, *SMALL, "--accuracies", 0.9, "--workers", 1) == 0
    assert out.read_bytes() == again.read_bytes()
    algebra = ("--engine", "algebra", "--trials", 100, "--accuracies", 0.9, "--force")
    assert run("compare", out, *algebra) == 0
    assert re.search(r"same choice +1\.000", capsys.readouterr().out)


@pytest.mark.parametrize("channels", [2, 3, 5])
def test_a_leader_is_ahead_of_each_other_channel_by_its_log_odds(channels):
    """At the fixed point of the exact circuit its OUT is then -ln P."""
    odds = np.array([[0.5, 1.0], [1.5, 2.0]])
    drive = leader_drive(odds, channels)[:, 0]
    np.testing.assert_allclose(
        drive[:, :1] - drive[:, 1:], np.repeat(odds.reshape(-1, 1), channels - 1, 1)
    )
    assert np.abs(drive.sum(axis=1)).max() < 1e-12
    found = leader_out(circuit("bogacz_gurney", channels), odds)
    np.testing.assert_allclose(found, np.log1p((channels - 1) * np.exp(-odds)), atol=1e-9)


def test_a_circuit_that_decides_without_evidence_is_not_compared(tmp_path, capsys):
    """Half of ctx->STN: OUT rests below every threshold."""
    task = ("--channels", 3, "--d-prime", 0.8, "--trials", 100, "--t-max", 10)
    halved = ("--edits.scale", "ctx->STN=0.5", "--edits.neurons", 40)
    for command in (("compare",), ("circuit", "lesion")):
        assert run(*command, tmp_path / "a.csv", *task, *halved) == 2
        assert "it would decide without evidence, or never" in capsys.readouterr().err
    assert run("circuit", "learn", tmp_path / "a.csv", "--edits.scale", "ctx->STN=0.5") == 2
    assert "no level of dopamine" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
    given = (*task[:-1], 40, "ctx->STN=0.5", "--engine", "rate", "--accuracies", 0.8)
    assert run("circuit", "lesion", tmp_path / "a.csv", *given) == 0
    shown = capsys.readouterr().out
    assert re.search(r"intact +0.8 +by evidence", shown)
    assert re.search(r"ctx->STN=0.5 0.8 +without evidence", shown)
    assert re.search(r"ctx->STN=0.5: unknown ms later", shown)
    assert "nan" not in shown


def test_a_lesion_without_an_edit_says_which_it_runs(tmp_path, capsys):
    small = ("--trials", 100, "--t-max", 4, "--engine", "algebra", "--accuracies", 0.7)
    assert run("circuit", "lesion", tmp_path / "a.csv", *small) == 0
    said = "no edit given, these run: STN=0.2, GPe=0.2, D2, ctx->STN=0.9, D1->SNr=0.9"
    assert said in capsys.readouterr().err
    assert run("compare", tmp_path / "b.csv", *small[:-1], 0.505) == 2
    assert "accuracies must lie above chance, 0.5, got 0.505" in capsys.readouterr().err


def test_compare_command_on_gratings(tmp_path, capsys):
    options = ("--task", "same-different", "--trials", 100, "--t-max", 10, "--engine", "algebra")
    assert run("compare", tmp_path / "a.csv", *options) == 0
    assert "race" not in capsys.readouterr().out


def test_lesion_command(tmp_path, capsys):
    out = tmp_path / "l.csv"
    edits = ("STN=0.1", "D1->SNr=0.95", "STN->GPe.delay_ms=4", "D1->GPe weight=-0.01")
    given = (*edits, *SMALL, "--accuracies", 0.9)
    assert run("circuit", "lesion", out, *given) == 0
    shown = capsys.readouterr().out
    assert "a prediction" in shown
    assert {"intact", *edits} == set(pd.read_csv(out, comment="#")["variant"])
    idle = ("circuit", "lesion", out, "STN.neurons=3", "--engine", "rate", "--force")
    assert run(*idle) == 2
    assert "'STN.neurons=3' says nothing to the rate engine" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["compare", "a.txt"], "output must end in .parquet or .csv"),
        (["compare", "a.csv", "--trials", "50"], "an interval needs 100 trials or more, got 50"),
        (["compare", "a.csv", "--accuracies", "1.2"], "accuracies must lie between 0 and 1"),
        (["compare", "a.csv", "--channels", "40"], "takes at most 12 alternatives"),
        (["compare", "a.csv", "--task", "same-different", "--channels", "3"], "2 alternatives"),
        (["circuit", "lesion", "a.csv", "GPi"], "has no nucleus 'GPi'"),
        (["circuit", "lesion", "a.csv", "SNr"], "SNr is the read-out"),
    ],
)
def test_bad_use_gets_one_clear_sentence(tmp_path, monkeypatch, capsys, arguments, says):
    monkeypatch.chdir(tmp_path)
    assert run(*arguments) == 2
    lines = [x for x in capsys.readouterr().err.splitlines() if x.startswith("bgmodel:")]
    assert len(lines) == 1
    assert says in lines[0]
    assert not list(tmp_path.iterdir())


def test_at_rest_rates_are_the_animals_and_cells_fire_irregularly():
    """MSN at most 5 Hz, STN 8-25, GPe 25-75, SNr 20-80 (the ranges of rat and macaque)."""
    for channels in (2, 4):
        found = at_rest(circuit("spiking_msprt", channels), seed=SEED).set_index("nucleus")
        for name, low, high in (
            ("D1", 0, 5),
            ("D2", 0, 5),
            ("STN", 8, 25),
            ("GPe", 25, 75),
            ("SNr", 20, 80),
        ):
            assert low <= found.loc[name, "rate_hz"] <= high, name
        # What the table says of its own cells.
        assert abs(found.loc["ctx", "interval_cv"] - 0.5) < 0.1
        assert abs(found.loc["STN", "interval_cv"] - 0.3) < 0.1


@given(
    arrays(np.float64, (3, 4, 5), elements=st.floats(-60, 60)),
    st.floats(2, 20),
    st.floats(0.3, 1),
)
def test_a_reach_changes_out_by_no_more_than_it_says(readings, reach, gain):
    """OUT is -ln P within ln(1 + (N - 1) exp(-reach)), however strong the evidence."""
    evidence = Evidence(readings)
    exact = Msprt(gain).run(evidence).out_nats
    held = Msprt().output(drive_of(evidence, gain, reach))
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
    model = BasalGanglia(circuit("bogacz_gurney", 3), "algebra")
    found = decide_at_thresholds(model, flat, [0.5])["circuit"]
    expected = first_crossing(Msprt().run(flat), 0.5)
    assert found.forced.all()
    assert (found.choice[0] == expected.choice).all()
    # And a trial of one reading of two ends a step after it.
    short = replace(flat, lengths=np.where(np.arange(40) % 2, 1, 2))
    trace = BasalGanglia(circuit("bogacz_gurney", 3), "rate").run(short)
    ends_ms = first_crossing(trace, 0.5).deadline_ms
    assert set(ends_ms[::2]) == {150.0}
    assert set(ends_ms[1::2]) == {100.0}


def test_what_the_deadline_decides_is_not_compared(tmp_path, capsys):
    mine = tmp_path / "zero.csv"
    rows = [f"{n},{t},0,0" for n in range(100) for t in range(2)]
    mine.write_text("\n".join(["trial,step,ll_a,ll_b", *rows]))
    given = ("--evidence", mine, "--engine", "algebra", "--accuracies", 0.6)
    assert run("compare", tmp_path / "a.csv", *given) == 0
    assert "not reached" in capsys.readouterr().out
    assert pd.read_csv(tmp_path / "a.csv").query("measure == 'agreement'")["value"].isna().all()
    small = ("--trials", 100, "--engine", "algebra", "--accuracies", 0.9, "--d-prime", 1)
    assert run("circuit", "lesion", tmp_path / "b.csv", "GPe", *small, "--t-max", 40) == 0
    assert re.search(r"GPe +0.9 +mostly at the deadline", capsys.readouterr().out)
    assert run("circuit", "lesion", tmp_path / "d.csv", "GPe", *small, "--t-max", 2) == 0
    assert re.search(r"intact +0.9 +not reached", capsys.readouterr().out)
    little = ("--trials", 20, "--t-max", 1, "--levels", 2, "--period-mm", 1)
    assert run("circuit", "learn", tmp_path / "c.csv", *little) == 2
    assert "the deadline decides most trials at every level" in capsys.readouterr().err


@pytest.mark.parametrize("engine", ["algebra", "rate", "ensemble"])
def test_a_circuit_decides_a_short_trial_as_if_it_were_alone(engine):
    """Among longer ones each ends a step after its own last reading, decided, forced or not."""
    lengths = np.array([1, 2, 3, 5, 8, 8])
    drawn = gaussian_evidence(6, 8, 0.8, rng=stream(SEED, "ragged"), step_ms=50.0)
    values = drawn.log_likelihood * (np.arange(8) < lengths[:, None])[..., None]
    ragged = replace(drawn, log_likelihood=values, lengths=lengths)
    table = circuit("spiking_msprt", 2).with_neurons(40)
    model = BasalGanglia(table, engine, 0.7, SEED if engine == "ensemble" else None)
    for threshold in (0.55, 0.1):
        together = first_crossing(model.run(ragged), threshold)
        for n, length in enumerate(lengths):
            own = Evidence(values[n : n + 1, :length], step_ms=50.0, numbers=np.array([n]))
            activity = model.activity(own, first_trial=n)
            alone = first_crossing(model.trace(activity, own), threshold)
            assert alone.choice[0] == together.choice[n]
            assert alone.forced[0] == together.forced[n]
            assert alone.time_ms[0] == together.time_ms[n]
            assert alone.deadline_ms[0] == together.deadline_ms[n]
            found = trial_table(alone, Trials(own, ["a", "b"]), model="m")
            assert found["steps"][0] <= length
    assert together.forced.any()
