"""The stop-signal task as a record: in experiments, in sweeps, and what is refused."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import bgmodel as bg
from bgmodel.cli import main
from bgmodel.commands.circuit import STOPPED
from bgmodel.conditions import STREAM
from bgmodel.deciding.decision import UNDECIDED, Decision
from bgmodel.deciding.measures import OF_STOP, Behaviour
from bgmodel.experiments.experiment import Experiment
from bgmodel.stopping.estimates import estimate_ssrt, inhibition_function, ssrt_by_delay
from bgmodel.stopping.inputs import StopSignal, decide_with_stop, receiving, with_input, with_stop
from bgmodel.stopping.task import StopTask, decided, walk
from bgmodel.stopping.trials import StopTrials, drawn_delays
from bgmodel.sweeps.plan import Plan
from bgmodel.sweeps.sweep import Sweep
from bgmodel.task import Gaussian
from circuits.errors import DataWarning, EditWarning
from tests.helpers import doubting, refused, refusing, unwarned

TASK = Gaussian(d_prime=0.35, step_ms=10.0, t_max=100, trials=600)
MODEL = bg.BasalGanglia("macaque", seed=3)
LEVEL = MODEL.threshold(None, 0.82)
RUN = ("circuit", "run")


@pytest.fixture(scope="module")
def evidence():
    return bg.gaussian_evidence(400, d_prime=0.35, t_max=100, step_ms=10, seed=5)


def rng():
    return np.random.default_rng(7)


def test_go_trials_are_those_of_the_task_without_signals(evidence):
    """No trial depends on another: signals in some trials change no other trial."""
    with_signals, ssd = decided(StopTask(), MODEL, evidence, LEVEL, rng())
    without = MODEL.decided(evidence, LEVEL)
    go = np.isnan(ssd)
    assert 0.15 < (~go).mean() < 0.35
    np.testing.assert_array_equal(with_signals.time_ms[go], without.time_ms[go])
    assert (with_signals.time_ms[~go] != without.time_ms[~go]).any()


def test_drawn_delays_are_a_stop_signal_of_that_delay(evidence):
    """The record and the function of Python give the same trials."""
    task = StopTask(amount_nats=0.5, delay_ms=40.0)
    decision, ssd = decided(task, MODEL, evidence, LEVEL, rng())
    signal = StopSignal(amount_nats=0.5, delay_ms=40.0)
    same = decide_with_stop(MODEL, evidence, ssd, signal, threshold=LEVEL)
    np.testing.assert_array_equal(~decision.forced, same.responded)
    assert set(ssd[~np.isnan(ssd)]) <= set(task.delays_ms)


def test_staircases_settle_where_half_of_the_signals_fail(evidence):
    task = StopTask(share=0.5, staircases=2, delays_ms=tuple(range(50, 600, 50)))
    decision, ssd = decided(task, MODEL, evidence, LEVEL, rng())
    stop = ~np.isnan(ssd)
    assert decision.forced[stop].mean() == pytest.approx(0.5, abs=0.08)
    again = decide_with_stop(MODEL, evidence, ssd, StopSignal(), threshold=LEVEL)
    np.testing.assert_array_equal(~decision.forced, again.responded)
    # Choices and times are those at the delay of each trial, too.
    drawn = with_stop(evidence, ssd, StopSignal())
    at_once = receiving(MODEL, StopSignal()).decided(drawn, LEVEL)
    np.testing.assert_array_equal(decision.choice, at_once.choice)
    np.testing.assert_array_equal(decision.time_ms, at_once.time_ms)
    # Each staircase goes one up after a successful stop, one down after a failed one.
    first = np.flatnonzero(stop)[::2]
    inside = (ssd[first[:-1]] > 50) & (ssd[first[:-1]] < 550)
    moved = np.where(decision.forced[first[:-1]], 50, -50)
    np.testing.assert_array_equal(np.diff(ssd[first])[inside], moved[inside])


def test_cancelling_makes_a_pulse_stop(evidence):
    """A pulse only postpones; a reset of the evidence, before it ends, leaves what was too fast."""
    ssd = np.append(np.nan, np.full(evidence.trials - 1, 250.0))
    held = decide_with_stop(MODEL, evidence, ssd, StopSignal(), threshold=LEVEL)
    with pytest.warns(EditWarning):
        pulse = StopSignal(duration_ms=150.0)
    with unwarned():
        cancel = StopSignal(duration_ms=150.0, cancel_ms=100.0)
        late = StopSignal(duration_ms=150.0, cancel_ms=400.0)
    p_respond = {
        name: decide_with_stop(MODEL, evidence, ssd, signal, threshold=LEVEL).p_respond
        for name, signal in {"pulse": pulse, "cancel": cancel, "late": late}.items()
    }
    assert p_respond["pulse"] > 0.9
    assert p_respond["cancel"] == pytest.approx(held.p_respond, abs=0.02)
    assert p_respond["cancel"] < p_respond["late"] <= p_respond["pulse"]


def test_a_cancelled_trial_is_back_at_its_prior():
    prior = np.array([0.7, 0.3])
    drawn = replace(bg.gaussian_evidence(6, d_prime=1.0, t_max=20, step_ms=10, seed=1), prior=prior)
    stops = with_stop(drawn, [50, np.nan, 0, 120, 150, 30], StopSignal(delay_ms=20, cancel_ms=60))
    at = np.array([11, 21, 6, 18, 21, 9])  # the first reading from SSD + 60 ms on
    for trial, first in enumerate(at):
        after = stops.posterior[trial, first:]
        assert after == pytest.approx(np.broadcast_to(prior, after.shape))
        kept, known = (each.log_likelihood[trial, : first - 1] for each in (stops, drawn))
        np.testing.assert_array_equal(kept, known)


def test_a_signal_after_the_end_of_its_own_trial_is_refused(evidence):
    """Otherwise a trial that was over counts as a successful stop."""
    lengths = np.where(np.arange(400) % 2, 100, 20)
    read = np.arange(evidence.steps) < lengths[:, None]
    values = np.where(read[:, :, None], evidence.log_likelihood, 0.0)
    short = replace(evidence, log_likelihood=values, lengths=lengths)
    with refused("delays_ms must be before the deadline of every trial, 200 ms"):
        StopTask().decide(MODEL, short, posterior=0.82)
    StopTask(delays_ms=(100.0,)).decide(MODEL, short, posterior=0.82)
    ssd = np.where(np.arange(400) == 4, 300.0, np.nan)
    with refused("ssd_ms must be before the deadline of the trial, or NaN"):
        decide_with_stop(MODEL, short, ssd, StopSignal(), posterior=0.82)


def test_no_signal_reaches_the_nucleus_before_it_is_given(evidence):
    """The spread of the delay is cut off at a delay of 0."""
    task = StopTask(share=0.9, delays_ms=(300.0,), delay_sd_ms=200.0)
    decision, ssd = decided(task, MODEL, evidence, LEVEL, rng())
    go = MODEL.decided(evidence, LEVEL)
    early = ~np.isnan(ssd) & (go.time_ms < 300)
    assert early.sum() > 50
    np.testing.assert_array_equal(decision.time_ms[early], go.time_ms[early])


def test_inputs_add_up_column_by_column(evidence):
    one = with_input(evidence, 100.0, 0.5)
    two = with_input(one, np.where(np.arange(400) < 200, 50.0, np.nan), -1.0, 30.0)
    np.testing.assert_array_equal(two.inputs_nats[..., :1], one.inputs_nats)
    assert two.inputs_nats[:, :, 1].sum(axis=1).tolist() == [-3.0] * 200 + [0.0] * 200
    with refused("every_ms must be the resolution of the inputs that the evidence has"):
        with_input(one, 100.0, every_ms=5.0)


def behaved(time_ms, missed, ssd, end_ms=200.0):
    """Return the behaviour of trials that end at ``end_ms``, where those missed are forced."""
    none, ends = np.zeros(len(ssd), bool), np.full(len(ssd), end_ms)
    times = np.where(missed, end_ms, time_ms)
    decision = Decision(missed.astype(int), times, missed, none, 1.0, ends, none.astype(int))
    return Behaviour(decision, np.full(len(ssd), 0.9), none, 2, ssd)


def test_measures_of_known_trials():
    """Go times of 1..100 ms; at 20 ms, half of the stop trials have a response: 50 - 20 ms."""
    go = np.arange(1.0, 101.0)
    time_ms = np.concatenate([go, [10.0, 20.0, np.nan, np.nan], [5.0] * 4])
    ssd = np.concatenate([np.full(100, np.nan), np.full(4, 20.0), np.full(4, 90.0)])
    behaviour = behaved(time_ms, np.isnan(time_ms), ssd)
    values = behaviour.measures(np.ones((1, len(ssd))))
    assert {name: values[name][0] for name in OF_STOP} == {
        "p_respond": 0.75, "ssrt_ms": 30.0, "failed_minus_go_ms": 50 / 6 - 50.5,
    }  # fmt: skip
    assert values["mean_ms"][0] == 50.5
    assert values["missed"][0] == 0.0
    assert values["decided"][0] == 100
    # Without the fast half of the go trials, the same share is reached later.
    weights = np.concatenate([np.repeat([0.0, 1.0], 50), np.ones(8)])[None]
    assert behaviour.measures(weights)["ssrt_ms"][0] == 75 - 20
    assert behaviour.in_time().choice.min() == UNDECIDED


def test_missed_go_trials_count_as_the_slowest():
    """Of 100 go trials 40 are missed, 60 take 1..60 ms; 7 of 10 responses are beyond their end."""
    time_ms = np.concatenate([np.arange(1.0, 101.0), np.full(10, 30.0)])
    ssd = np.where(np.arange(110) < 100, np.nan, 20.0)
    missed = (np.isnan(ssd) & (time_ms > 60)) | (np.arange(110) >= 107)
    values = behaved(time_ms, missed, ssd).measures(np.ones((1, 110)))
    assert values["ssrt_ms"][0] == 60 - 20
    assert values["failed_minus_go_ms"][0] == 30 - 30.5


def test_pooling_wide_delays_is_biased_where_each_delay_is_not():
    """A race of known stop-signal reaction time, with go times as skewed as the circuit's."""
    draws = np.random.default_rng(8)
    go_ms = 100 + draws.gamma(1.5, 250, 60_000)
    ssd_ms = drawn_delays(60_000, np.arange(100, 501, 50), 0.5, draws)
    escaped = ~(go_ms > ssd_ms + 70)
    trials = StopTrials(np.where(escaped, go_ms, np.nan), ssd_ms)
    assert ssrt_by_delay(inhibition_function(trials)) == pytest.approx(70, abs=4)
    assert estimate_ssrt(trials).ssrt_ms < 60
    measured = behaved(go_ms, ~escaped, ssd_ms, 3000.0).measures(np.ones((1, 60_000)))["ssrt_ms"][0]
    assert measured == pytest.approx(ssrt_by_delay(inhibition_function(trials)))


def test_workers_and_blocks_draw_their_own_signals(monkeypatch):
    monkeypatch.setattr("bgmodel.sweeps.plan.BLOCK", 100)
    plan = Plan(
        task=replace(TASK, trials=200), stop=StopTask(share=0.5), grid={"stop.delay_ms": (0.0,)}
    )
    (point,) = Sweep(plan).points
    first, second = (
        point.behaviour(point.model(2), point.block(n, 100).evidence, point.block_seed(n)).ssd_ms
        for n in (0, 100)
    )
    assert (np.isnan(first) != np.isnan(second)).any()


FILE = "name='x'\nnote=''\n{}\n[manipulation]\nedits=['lesion STN 5%']\n"
SHORT = "[task]\nd_prime=0.35\nstep_ms=10.0\nt_max=100\ntrials=100\n[stop]\n"
MEASURE = "[[predictions]]\nmeasure='p_respond'\ndirection='up'\nat_least=0.05\n"


test_a_bad_stop_task_gets_one_clear_sentence = refusing(
    (SHORT + "share = 0", "share must be between 0 and 1"),
    (SHORT + "share = 1.0", "share must be between 0 and 1"),
    (SHORT + "delays_ms = []", "delays_ms must be numbers >= 0"),
    (SHORT + "delays_ms = [-5]", "delays_ms must be numbers >= 0"),
    (SHORT + "delays_ms = [100, 2000]", "delays_ms before the deadline of every trial, 1000 ms"),
    (SHORT + "failures = 1.5", "failures must be within 0..1"),
    (SHORT + "staircases = 1\ndelays_ms = [200]", "delays_ms must be two rising numbers"),
    (SHORT + "strength = 1", "stop.strength key 'stop.strength'; there are .*share"),
    (SHORT + "nucleus = 'ctx'", "nucleus must be one that the signal can act through"),
    (SHORT + "nucleus = 'STM'", "more_inputs must be among .*STN"),
    (MEASURE, r"measure one of a task without stop signals: there is no \[stop\]"),
    of=lambda text: Experiment.from_text(FILE.format(text)).run(),
)


test_what_is_doubtful_is_warned_of = doubting(
    (DataWarning, "in ms, not in seconds", lambda: StopTask(delays_ms=(0.2, 0.3))),
    (EditWarning, "does not cancel", lambda: StopTask(duration_ms=100.0)),
    (EditWarning, "no effect", lambda: StopTask(amount_nats=0.0)),
    (None, "", lambda: StopTask(amount_nats=0.0, cancel_ms=50.0)),
)


def test_the_command_and_python_decide_alike(tmp_path, capsys):
    """One seed, one table, at the terminal and in Python."""
    out, drawing = tmp_path / "out.csv", tmp_path / "out.png"
    options = ["--task", "d_prime=0.35", "step_ms=10", "trials=300", "t_max=100"]
    options += ["--seed", "5", "--stop", "delay_ms=40"]
    assert main([*RUN, "--save", str(out), "--plot", str(drawing), *options]) == 0
    text = capsys.readouterr().out
    condition = bg.Condition(task=replace(STOPPED, trials=300, t_max=100), seed=5)
    evidence = condition.drawn(STREAM).evidence
    stop = bg.StopTask(share=0.5, delay_ms=40.0)
    mine = stop.decide(condition.model(2), evidence, posterior=0.82, seed=5)
    pd.testing.assert_frame_equal(pd.read_csv(out), mine.to_dataframe())
    assert "40 ms of it are the given delay to STN" in text
    assert drawing.stat().st_size > 10_000
    assert main([*RUN, "--json", *options]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["p_respond"] == mine.p_respond
    assert len(printed["records"]) == len(stop.delays_ms)


def test_the_command_says_why_there_is_no_estimate(capsys):
    options = ["--task", "d_prime=0.35", "step_ms=10", "trials=120", "t_max=40", "--stop"]
    options += ["share=0.5", "delays_ms=20"]
    assert main([*RUN, *options]) == 0
    text = capsys.readouterr().out
    assert "no stop-signal reaction time: at no delay do 25% to 75% of the stop trials" in text
    assert "% of go trials missed, no failed stops, responses in 0.0% of stop trials" in text
    assert "nan" not in text.partition("mean go time")[2]
    assert main([*RUN, "--json", *options]) == 0
    printed = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert printed["ssrt_by_delay_ms"] is None


DELAYS = np.arange(0.0, 1001.0, 50.0)


def test_a_staircase_moves_up_after_a_stop_and_down_after_a_response():
    delays = [100.0, 200.0, 300.0]
    stops = np.zeros((3, 6), bool)
    stops[:, [2, 3, 4, 5]] = True
    # Two successes reach the end and stay; then four failures reach the other one and stay.
    assert walk(stops, delays, 200.0).tolist() == [1, 2, 2, 1, 0, 0]


def test_interleaved_staircases_each_see_only_their_own_trials():
    table = np.random.default_rng(1).random((len(DELAYS), 200)) < 0.5
    both = walk(table, DELAYS, [200.0, 400.0])
    for which, start in enumerate((200.0, 400.0)):
        assert (both[which::2] == walk(table[:, which::2], DELAYS, start)).all()


@pytest.mark.parametrize(("outcome", "kind"), [(True, "failed"), (False, "successful")])
def test_a_staircase_that_never_reverses_is_warned_of(outcome, kind):
    table = np.full((len(DELAYS), 30), outcome)
    with pytest.warns(DataWarning, match=f"never reverses: all of its 30 stop trials are {kind}"):
        walk(table, DELAYS, 250.0)
    table[:, 7] = not outcome
    with unwarned():
        walk(table, DELAYS, 250.0)


TABLE = np.ones((2, 5), bool)


test_tables_and_starts_that_do_not_fit_are_refused = refusing(
    ((np.ones((2, 5)), [100, 200], 100), "responded True or False"),
    ((np.ones((3, 5), bool), [100, 200], 100), "responded each of 2 delays"),
    ((TABLE, [200, 100], 100), "delays_ms increasing"),
    ((TABLE, [-100, 100], 100), "delays_ms >= 0"),
    ((TABLE, [100, 200], [100, 150]), "starts_ms among"),
    ((TABLE[:, :1], [100, 200], [100, 200]), "starts_ms at most one per"),
    of=lambda asked: walk(*asked),
)
