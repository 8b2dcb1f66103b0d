"""The baselines: closed forms, limits, and the decision times that Bogacz & Gurney print."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import logsumexp

from bgmodel import Msprt, Sprt, first_crossing, stream
from bgmodel.deciding.tradeoff import curve, tradeoff
from bgmodel.evidence import Evidence
from bgmodel.integrators.baselines import (
    BASELINES,
    Lca,
    LinearGpe,
    MaxVsAverage,
    MaxVsNext,
    Race,
    baselines_on,
)
from bgmodel.simulated_evidence import separated_evidence
from tests.helpers import refusing


def drawn(trials=300, steps=20, hypotheses=4, separation=0.5, seed=1):
    rng = stream(seed, "baselines")
    return separated_evidence(
        trials, steps, separation, rng=rng, hypotheses=hypotheses, step_ms=10.0
    )


def test_a_race_sums_each_channel_alone():
    evidence = drawn(5)
    wanted = -np.cumsum(evidence.log_likelihood, axis=1)
    np.testing.assert_allclose(Race().run(evidence).out_nats[:, 1:], wanted)
    assert np.abs(Race().run(evidence).out_nats[:, 0]).max() < 1e-12


@pytest.mark.parametrize("kind", [MaxVsAverage, MaxVsNext, Msprt])
def test_a_common_input_changes_nothing_but_a_race(kind):
    evidence = drawn()
    common = stream(2, "common").normal(size=(300, 20, 1))
    shifted = Evidence(evidence.log_likelihood + common, evidence.truth, step_ms=10.0)
    one, two = (kind().run(e).out_nats for e in (evidence, shifted))
    np.testing.assert_allclose(one, two, atol=1e-10)


@pytest.mark.parametrize("name", sorted(BASELINES))
def test_a_baseline_says_whether_what_all_hypotheses_share_counts(name):
    evidence = drawn()
    shifted = replace(evidence, log_likelihood=evidence.log_likelihood + 0.1)
    choices = [first_crossing(BASELINES[name]().run(e), -1.0).time_ms for e in (evidence, shifted)]
    assert BASELINES[name].needs_zero != np.array_equal(*choices)


def test_of_two_alternatives_baselines_that_compare_decide_as_the_sprt():
    """N = 2: every rule but the race is a function of the log odds."""
    evidence = drawn(hypotheses=2)
    z = Sprt().run(evidence).out_nats
    np.testing.assert_allclose(MaxVsNext().run(evidence).out_nats, z, atol=1e-12)
    np.testing.assert_allclose(MaxVsAverage().run(evidence).out_nats, z / 2, atol=1e-12)
    np.testing.assert_allclose(Msprt().run(evidence).out_nats, np.log1p(np.exp(z)), atol=1e-12)


def test_max_vs_next_is_the_msprt_of_high_gain():
    evidence = drawn()
    high = Msprt(gain=400.0).run(evidence).out_nats[:, 1:] / 400
    wanted = np.maximum(MaxVsNext().run(evidence).out_nats[:, 1:], 0)
    np.testing.assert_allclose(high, wanted, atol=np.log(4) / 400)


def test_lca_without_leak_is_a_race_and_with_strong_balance_max_vs_average():
    evidence = drawn()
    race = Race().run(evidence).out_nats
    np.testing.assert_allclose(Lca(0, 0).run(evidence).out_nats, race, atol=1e-9)
    balanced = Lca(1e9, 1e9).run(evidence).out_nats
    np.testing.assert_allclose(balanced, MaxVsAverage().run(evidence).out_nats, atol=1e-5)


def test_lca_solves_its_differential_equation():
    evidence = drawn(1, 6, 3)
    rates = evidence.log_likelihood[0] / 0.01
    leak, inhibition = 30.0, 20.0
    matrix = (leak - inhibition) * np.eye(3) + inhibition
    x = np.zeros(3)
    out = Lca(leak, inhibition).run(evidence).out_nats[0]
    for step in range(6):
        x = solve_ivp(
            lambda t, x, k=step: rates[k] - matrix @ x, (0, 0.01), x, rtol=1e-10, atol=1e-12
        ).y[:, -1]
        np.testing.assert_allclose(-out[step + 1], x, rtol=1e-6)


@pytest.mark.parametrize(("gain", "slope"), [(1.0, 1.0), (0.4, 0.84), (3.0, 2.5)])
def test_a_linear_gpe_solves_its_equation(gain, slope):
    """It is a Sigma + ln Sigma = ln sum exp y; the table of that circuit is held to Lambert's W."""
    evidence = drawn()
    y = gain * np.concatenate([np.zeros((300, 1, 4)), evidence.log_likelihood.cumsum(axis=1)], 1)
    sigma = LinearGpe(gain, slope).run(evidence).out_nats + y
    np.testing.assert_allclose(sigma, sigma[:, :, :1] + np.zeros(4), atol=1e-12)
    s = logsumexp(y, axis=2)
    np.testing.assert_allclose(slope * sigma[:, :, 0] + np.log(sigma[:, :, 0]), s, atol=1e-9)


test_bad_constants_are_refused = refusing(
    (lambda: Lca(leak_hz=-1), "leak_hz"),
    (lambda: Lca(inhibition_hz=np.nan), "inhibition_hz"),
    (lambda: LinearGpe(slope=0), "slope"),
)


def test_decision_times_are_those_that_bogacz_and_gurney_print():
    """N = 10, 1 % errors, 1 ms, (mu+ - mu-) = 1.41, sigma = 0.33.

    Printed: 628 ms for the UM/LCA, 676 for the race. The MSPRT is plotted only, and was reproduced
    at 515. Their tolerance of the error rate, 0.2 %, is worth 11 ms.
    """
    separation = 1.41 / 0.33 * np.sqrt(0.001)
    rng = stream(10, "bogacz gurney")
    evidence = separated_evidence(1500, 1600, separation, rng=rng, hypotheses=10)
    one = np.ones((1, 1500))
    times = {}
    for name, kind in {"MSPRT": Msprt, "LCA": Lca, "race": Race}.items():
        accuracy, time = curve(tradeoff(kind().run(evidence), evidence), one)
        times[name] = np.interp(0.99, accuracy[0], time[0])
    assert times["MSPRT"] == pytest.approx(515, abs=25)
    assert times["LCA"] == pytest.approx(628, abs=30)
    assert times["race"] == pytest.approx(676, abs=30)


def test_without_a_zero_only_baselines_that_compare_are_left():
    assert baselines_on(True) == list(BASELINES)
    assert baselines_on(False) == ["max vs average", "max vs next"]
