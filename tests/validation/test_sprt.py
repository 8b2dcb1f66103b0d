"""Tests and their exact solution in a million trials: make validate."""

import numpy as np
import pytest

from bgmodel import Msprt, Sprt, first_crossing, stream
from bgmodel.integrators.sprt_theory import gaussian_pair, sprt
from bgmodel.learning.gap import fold_sources
from bgmodel.simulated_evidence import separated_evidence
from bgmodel.tactile.source import held_out_taps

pytestmark = pytest.mark.validate
XI, T_MAX = 50.0, 30


def test_two_hypothesis_msprt_is_the_sprt_in_a_million_trials():
    separations = np.linspace(0, 8, 33)
    readings = fold_sources(held_out_taps(), 2.0)[0]
    for part in range(50):
        rng = stream(101, "equality", part)
        if part % 2:
            evidence = readings.draw(20_000, T_MAX, rng=rng)
        else:
            evidence = separated_evidence(20_000, 50, 0.4, rng=rng)
        a = first_crossing(Sprt().run(evidence), Sprt.threshold(separations))
        b = first_crossing(Msprt().run(evidence), Msprt.threshold(separations))
        assert (a.choice != b.choice).sum() + (a.time_ms != b.time_ms).sum() == 0


def test_discrete_simulation_ends_as_the_exact_solution():
    """|z| < 4 for error rate and mean time at 1e6 trials over a grid of (d, theta)."""
    trials, t_max = 1_000_000, 200
    thetas = np.array([0.0, 0.5, 1.0, 2.0, 3.0, 4.0])
    for d in (0.5, 1.0, 2.0):
        sums = np.zeros((4, len(thetas)))
        for part in range(50):
            rng = stream(101, "exact", d, part)
            evidence = separated_evidence(trials // 50, t_max, d / np.sqrt(2), rng=rng)
            decision = first_crossing(Sprt().run(evidence), Sprt.threshold(2 * thetas))
            wrong = decision.choice != evidence.truth
            sums += [wrong.sum(1), decision.steps.sum(1), (decision.steps**2).sum(1), 0 * thetas]
        error, steps, squares, _ = sums / trials
        exact = sprt(*gaussian_pair(d), 2 * thetas, t_max=t_max)
        p = exact.error_rate
        z_error = (error - p) / np.sqrt(p * (1 - p) / trials)
        z_steps = (steps - exact.mean_steps) / np.sqrt((squares - steps**2) / trials + 1e-30)
        print(f"d {d}: z of error {np.round(z_error, 1)}, of time {np.round(z_steps, 1)}")
        assert np.abs(z_error).max() < 4
        assert np.abs(z_steps[steps > 1]).max() < 4
