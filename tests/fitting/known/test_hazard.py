"""Decisions at each reading: exact sums over all courses of noise, and the limit without noise."""

import itertools

import numpy as np
import pytest
from scipy.stats import norm

from bgmodel.deciding.decision import first_crossing
from bgmodel.fitting.known.hazard import decisions, delayed
from bgmodel.integrators.sprt import Msprt
from bgmodel.simulated_evidence import gaussian_evidence


def enumerated(out, level, bias, scale, ends):
    """Return decisions by the probability of every course of events, one after the other."""
    readings, count = out.shape
    decided, left = np.zeros((readings, count)), 0.0
    for course in itertools.product(range(count + 1), repeat=readings):
        probability, first = 1.0, None
        for k, event in enumerate(course):
            waits = 0.0 if ends and k == readings - 1 else 1.0
            odds = np.append(waits, np.exp((level[k] + bias - out[k]) / scale))
            probability *= odds[event] / odds.sum()
            if first is None and event > 0:
                first = (k, event - 1)
        if first is None:
            left += probability
        else:
            decided[first] += probability
    return decided, left


@pytest.mark.parametrize(("count", "ends"), [(2, False), (2, True), (3, False), (4, True)])
def test_the_recursion_is_the_sum_over_all_courses_of_events(count, ends):
    rng = np.random.default_rng(3)
    out, level = rng.normal(size=(1, 7, count)), rng.normal(size=7)
    bias, scale = rng.normal(size=count), np.array([0.7, 0.4])
    levels = level[:, None] + bias
    decided, left = decisions(out, levels, scale, np.array([0, 4, 7]), np.array([ends, False]))
    for trial, (part, last) in enumerate(((slice(0, 4), ends), (slice(4, 7), False))):
        expected, rest = enumerated(out[0, part], level[part], bias, scale[trial], last)
        np.testing.assert_allclose(decided[part], expected, atol=1e-12)
        assert left[trial] == pytest.approx(rest, abs=1e-12)
        assert decided[part].sum() + left[trial] == pytest.approx(1.0)


def test_without_noise_it_decides_as_the_msprt():
    evidence = gaussian_evidence(300, d_prime=0.5, channels=3, t_max=30, seed=2)
    out = np.ascontiguousarray(Msprt().run(evidence).out_nats[:, 1:])
    decision = first_crossing(Msprt().run(evidence), 0.3)
    decided, _ = decisions(
        out.reshape(1, -1, 3), np.full((9000, 3), 0.3), np.full(300, 1e-6),
        30 * np.arange(301), np.ones(300, bool),
    )  # fmt: skip
    reading, choice = np.divmod(decided.reshape(300, -1).argmax(axis=1), 3)
    np.testing.assert_array_equal(choice, decision.choice)
    np.testing.assert_array_equal(reading + 1, decision.steps)


def test_hazards_are_means_over_runs():
    rng = np.random.default_rng(6)
    out = rng.normal(size=(2, 3, 2))
    rule = (np.zeros((3, 2)), np.full(1, 0.5))
    decided, left = decisions(out, *rule, np.array([0, 3]), np.array([False]))
    alone = [decisions(each[None], *rule, np.array([0, 3]), np.array([False]))[0] for each in out]
    np.testing.assert_allclose(decided[0], np.mean(alone, axis=0)[0])
    assert decided.sum() + left[0] == pytest.approx(1.0)
    assert not np.allclose(decided, np.mean(alone, axis=0))


def test_a_response_time_is_a_decision_and_a_gaussian_delay():
    decided = np.array([[0.2, 0.1], [0.3, 0.2], [0.5, 0.4]])
    at_s, rt_s = np.array([0.1, 0.4, 0.2]), np.array([0.7, 0.5, np.nan])
    t0_s, t0_sd_s = np.array([0.25, 0.2, 0.25]), np.array([0.06, 0.08, 0.06])
    density = delayed(decided, at_s, rt_s, np.array([0, 2, 3, 3]), t0_s, t0_sd_s)
    late = norm.pdf(0.7, at_s[:2] + 0.25, 0.06)
    np.testing.assert_allclose(density[0], decided[:2].T @ late)
    np.testing.assert_allclose(density[1], decided[2] * norm.pdf(0.5, 0.4, 0.08))
    np.testing.assert_array_equal(density[2], 0.0)
