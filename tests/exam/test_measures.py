"""Measures of tables against closed forms, and against what they must not answer."""

import numpy as np
import pandas as pd
import pytest

from bgmodel import Msprt, first_crossing, gaussian_evidence, threshold_from_posterior
from bgmodel.exam import of_circuit
from bgmodel.exam.exam import Exam
from bgmodel.exam.measures import MEASURES, Estimate, Results
from bgmodel.exam.simulation import Simulation
from bgmodel.exam.tables import Failed, NotApplicable, Tables, read_tables
from bgmodel.experiments.models import DecisionModel
from bgmodel.support.seeds import stream
from circuits.anatomy import load_circuit
from circuits.dynamics.fixed_point import resting_hz
from tests.helpers import refused

TASKS = Exam.shipped().tasks


def asked(trials=None, rates=None, **more):
    return Results(read_tables(trials, rates, TASKS), TASKS, 1, **more)


def decided(task, posterior, d_prime=0.2, seed=3, trials=2000, t_max=600):
    """Return trials of the optimal test with readings every ms."""
    evidence = gaussian_evidence(trials, d_prime=d_prime, t_max=t_max, step_ms=1.0, seed=seed)
    crossing = first_crossing(Msprt().run(evidence), threshold_from_posterior(posterior, 2))
    right = (crossing.choice == evidence.truth).astype(int)
    return pd.DataFrame({"task": task, "rt_ms": crossing.time_ms, "correct": right})


def test_the_optimal_test_trades_speed_for_accuracy_as_wald_says():
    # E[T] = (theta / m) tanh(theta / 2), theta = logit accuracy (Wald 1947); overshoot at a d' of
    # 0.2 adds 0.117 to both theta, which the criterion takes off.
    def bound(accuracy):
        return np.log(accuracy / (1 - accuracy))

    def time(accuracy):
        return bound(accuracy) * np.tanh(bound(accuracy) / 2)

    def criterion(accuracy):
        return 1 / (1 + np.exp(-(bound(accuracy) - 0.5826 * 0.2)))

    table = pd.concat([decided("speed", criterion(0.78)), decided("accuracy", criterion(0.874))])
    change = MEASURES["time_change"](asked(table), "accuracy", "speed", unit="percent")
    expected = 100 * (time(0.874) / time(0.78) - 1)
    assert expected == pytest.approx(104.4, abs=0.1)
    assert abs(change.value - expected) < 3 * change.se
    assert change.se < 5


def test_the_skewness_of_times_without_drift_is_that_of_the_closed_form():
    # Survival of Brownian motion between -1 and 1: (4 / pi) sum (-1)^k / (2 k + 1) exp(...).
    k = np.arange(60)
    odd = 2 * k + 1
    t = np.linspace(0.01, 6, 6000)
    rates = np.exp(-(odd**2) * np.pi**2 / 8 * t[:, None])
    survival = 4 / np.pi * (((-1.0) ** k / odd) * rates).sum(axis=1)
    q = [t[np.searchsorted(-survival, -(1 - p))] for p in (0.1, 0.5, 0.9)]
    expected = (q[2] - q[1]) / (q[1] - q[0])
    walk = np.cumsum(0.07 * stream(5, "walk").standard_normal((2500, 1400)), axis=1)
    times = (np.abs(walk) >= 1).argmax(axis=1) + 1.0
    table = pd.DataFrame({"task": "no evidence", "rt_ms": times})
    skewness = MEASURES["skewness"](asked(table), "no evidence")
    assert expected == pytest.approx(2.63, abs=0.02)
    assert abs(skewness.value - expected) < 3 * skewness.se


def test_errors_of_the_optimal_test_are_as_slow_as_correct_responses():
    delay = MEASURES["error_delay"](asked(decided("reference", 0.8)), "reference")
    assert abs(delay.value) < 3 * delay.se < 0.3


def test_a_change_has_the_standard_error_of_paired_trials():
    rng = stream(1, "pairs")
    common = rng.normal(600, 100, 2000)
    table = pd.concat(
        pd.DataFrame({"task": task, "trial": range(2000), "rt_ms": common + more})
        for task, more in (("reference", 0.0), ("stimulation", rng.normal(-30, 10, 2000)))
    )
    paired = MEASURES["time_change"](asked(table), "stimulation", "reference")
    assert paired.value == pytest.approx(-30, abs=1)
    assert paired.se == pytest.approx(10 / np.sqrt(2000), rel=0.15)
    apart = table.assign(trial=np.arange(len(table)))
    alone = MEASURES["time_change"](asked(apart), "stimulation", "reference")
    assert alone.se == pytest.approx(100 * np.sqrt(2 / 2000), rel=0.15)


def test_missed_trials_count_at_the_deadline_and_most_of_them_fail():
    table = pd.DataFrame(
        {"task": "reference", "rt_ms": [500.0] * 300 + [None] * 100, "deadline_ms": 900.0}
    )
    both = pd.concat([table, table.assign(task="stimulation", rt_ms=500.0)])
    change = MEASURES["time_change"](asked(both), "stimulation", "reference")
    assert change.value == pytest.approx(-100)
    silent = table.assign(task="stimulation", rt_ms=[500.0] * 100 + [None] * 300)
    with pytest.raises(Failed):
        MEASURES["time_change"](asked(pd.concat([table, silent])), "stimulation", "reference")


def rates(task, value, role="all", window="late", spread=2.0, count=200):
    noise = stream(2, task, role, window).normal(0, spread, count)
    columns = {"task": task, "nucleus": "STN", "window": window, "role": role}
    return pd.DataFrame({**columns, "trial": range(count), "rate_hz": value + noise})


def test_a_change_of_rate_is_paired_or_not_and_may_be_in_percent():
    table = pd.concat([rates("conflict", 22.0), rates("middle", 20.0)])
    change = {"nucleus": "STN", "window": "late", "task": "conflict", "minus_task": "middle"}
    hz = MEASURES["rate_change"](asked(rates=table), **change)
    assert hz.value == pytest.approx(2, abs=4 * hz.se)
    percent = MEASURES["rate_change"](asked(rates=table), **change, unit="percent")
    assert percent.value == pytest.approx(hz.value / 0.2, rel=0.05)
    apart = pd.concat([table[:200], table[200:].assign(trial=range(500, 700))])
    assert MEASURES["rate_change"](asked(rates=apart), **change).value == pytest.approx(hz.value)


def test_abstract_rates_have_a_sign_and_no_hz():
    tables = Tables(rates=rates("rest", 20.0, window="rest"), abstract=frozenset({"STN"}))
    place = {"nucleus": "STN", "window": "rest", "task": "rest"}
    assert MEASURES["rate"](Results(tables, TASKS, 1), **place).value == pytest.approx(20, abs=1)
    with pytest.raises(NotApplicable):
        MEASURES["rate"](Results(tables, TASKS, 1, in_hz=True), **place)


def blocked(circuit, nucleus, receptors):
    runs = Simulation(DecisionModel("own", lambda _: circuit), TASKS, 1)
    return of_circuit.blocked(Results(runs, TASKS, 1), nucleus, receptors)


def test_a_block_takes_signal_and_tone_of_a_receptor_from_a_cell_alone():
    """Rates on a straight line: what is lost is weight times the source's rate over its gain."""
    circuit = load_circuit("macaque")
    rest = resting_hz(circuit)

    def nats(name):
        return rest[name] / circuit.population(name).gain_hz_per_nat

    gain = circuit.population("SNr").gain_hz_per_nat
    from_stn = gain * 2 * nats("STN")
    from_gaba = gain * (nats("D1") + 0.55 * nats("GPe"))
    for receptors, hz in (
        ("AMPA, NMDA", rest["SNr"] - from_stn),
        ("NMDA", rest["SNr"] - from_stn / 3),
        ("NMDA, GABA-A", rest["SNr"] - from_stn / 3 + from_gaba),
        ("GABA-A", rest["SNr"] + from_gaba),
        ("AMPA, NMDA, GABA-A", rest["SNr"] - from_stn + from_gaba),
    ):
        assert blocked(circuit, "SNr", receptors).value == pytest.approx(max(hz, 0), rel=1e-6)
    assert resting_hz(circuit)["GPe"] == rest["GPe"]


def test_pathways_that_name_their_receptors_answer_with_their_own_shares():
    circuit = load_circuit("macaque")
    for ampa in (2 / 3, 0.5):
        named = circuit.edited(
            "set STN->GPe.synapse AMPA", f"scale STN->GPe AMPA {ampa}",
            f"add STN->GPe NMDA like=STN->GPe weight={(1 - ampa) * circuit['STN->GPe'].weight}",
        )  # fmt: skip
        for receptors in ("AMPA", "NMDA", "AMPA, GABA-A"):
            two, one = (blocked(each, "GPe", receptors).value for each in (named, circuit))
            assert (two == pytest.approx(one, rel=1e-6)) == (ampa != 0.5)


def test_a_block_needs_cells_and_their_receptors():
    circuit = load_circuit("macaque")
    for nucleus, receptors in (("SNr", "mGluR"), ("nobody", "GABA-A")):
        with pytest.raises(NotApplicable):
            blocked(circuit, nucleus, receptors)
    with pytest.raises(NotApplicable):
        blocked(load_circuit("bogacz_gurney"), "SNr", "GABA-A")
    named = circuit.set("STN->SNr.synapse", "NMDA")
    with refused("receptors"):
        blocked(circuit, "GPe", "AMPA, GABA-a")
    assert blocked(named, "SNr", "NMDA") == blocked(circuit, "SNr", "AMPA, NMDA")


def test_a_race_with_a_fixed_stop_time_has_that_ssrt():
    rng = stream(4, "race")
    go = rng.normal(450, 80, 6000)
    ssd = np.where(rng.random(6000) < 0.5, rng.choice([150.0, 200, 250, 300], 6000), np.nan)
    parts = []
    for task, ssrt in (("stop", 200.0), ("stop, STN lesion", 230.0)):
        stopped = go > ssd + ssrt
        rt = np.where(stopped, np.nan, go)
        parts.append(pd.DataFrame({"task": task, "rt_ms": rt, "ssd_ms": ssd, "deadline_ms": 2000}))
    table = pd.concat(parts)
    names = ("stop, STN lesion", "stop")
    change = MEASURES["ssrt_change"](asked(table), *names)
    assert change.value == pytest.approx(30, abs=3 * change.se)
    assert change.se < 8
    more = MEASURES["respond_change"](asked(table), *names)
    assert 0.05 < more.value < 0.3
    failed, alone = go <= ssd + 200, np.isnan(ssd)
    sooner = MEASURES["failed_minus_go"](asked(table), "stop").value
    assert sooner == pytest.approx(go[failed].mean() - go[alone].mean())
    with pytest.raises(NotApplicable):
        MEASURES["ssrt_change"](asked(table.assign(ssd_ms=np.nan)), *names)


def test_times_on_a_line_over_ln_n_have_its_slope():
    tasks = {"two": 2, "four": 4, "eight": 8}
    parts = [
        pd.DataFrame(
            {"task": name, "rt_ms": stream(1, name).normal(200 + 300 * np.log(n), 50, 500)}
        )
        for name, n in tasks.items()
    ]
    slope = MEASURES["hick_slope"](asked(pd.concat(parts)), "two, four, eight")
    assert slope.value == pytest.approx(300, abs=4 * slope.se)


def test_too_few_known_resamples_are_no_answer():
    values = np.full(101, np.nan)
    values[:50] = 1.0
    with pytest.raises(NotApplicable):
        Estimate.of(values, 10)


def test_times_are_those_of_go_trials_whatever_happened_on_stop_trials():
    go = pd.DataFrame({"task": "reference", "rt_ms": [500.0] * 300, "ssd_ms": None})
    stop = pd.DataFrame({"task": "reference", "rt_ms": [300.0] * 100, "ssd_ms": 150.0})
    base = pd.concat([go, stop.assign(rt_ms=None)])
    other = pd.concat([go.assign(rt_ms=540.0), stop]).assign(task="stimulation")
    change = MEASURES["time_change"](asked(pd.concat([base, other])), "stimulation", "reference")
    assert change.value == pytest.approx(40)


def test_missed_trials_without_a_deadline_have_no_mean_time():
    """With one they count at it, and without it they are not left out as if they were none."""
    rt = np.where(np.arange(400) % 5 == 0, np.nan, 500.0)
    stop = np.where(np.arange(400) % 4 == 0, 480.0, np.nan)
    one = pd.DataFrame({"task": "stop", "rt_ms": rt + np.arange(400) % 7, "ssd_ms": stop})
    both = pd.concat([one, one.assign(task="stop, STN lesion", rt_ms=one["rt_ms"] + 20)])
    of = {"task": "stop, STN lesion", "minus_task": "stop"}
    with pytest.raises(NotApplicable, match="no deadline_ms"):
        MEASURES["time_change"](asked(both), **of)
    at_end = MEASURES["time_change"](asked(both.assign(deadline_ms=2000.0)), **of)
    assert at_end.value == pytest.approx(20 * 0.8, abs=0.1)
    late = pd.concat([one, one.assign(task="stop, STN lesion", rt_ms=np.nan)])
    with pytest.raises(Failed, match="100% of trials"):
        MEASURES["time_change"](asked(late), **of)
