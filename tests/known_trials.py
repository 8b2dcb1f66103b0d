"""Trials with known evidence that several tests use."""

import numpy as np

from bgmodel.fitting.known.known_likelihood import observed, readings_from
from bgmodel.fitting.known.models import EXACT
from bgmodel.fitting.known.trials import KnownTrials
from bgmodel.simulated_evidence import gaussian_evidence

TRUTH = {"gain": 1.0, "threshold": 0.12, "noise": 0.03, "t0_s": 0.3, "t0_sd_s": 0.05, "lapse": 0.02}


def simulated(trials=200, seed=5, model="msprt", channels=2, t_max=40, **values):
    """Return the trials of an observer on Gaussian evidence."""
    evidence = gaussian_evidence(trials, d_prime=0.5, channels=channels, t_max=t_max, seed=seed)
    return observed(EXACT[model], readings_from(evidence), {**TRUTH, **values}, seed)


def few(trials=20, readings=3, alternatives=3, seed=1, forced=False):
    """Return small random trials, each response after all readings."""
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(trials, readings, alternatives))
    time_s = np.tile(0.1 * (1 + np.arange(readings)), (trials, 1))
    return KnownTrials(
        values, time_s, np.full(trials, readings), tuple("abcde"[:alternatives]),
        np.arange(trials) % alternatives, 0.4 + 0.3 * rng.random(trials),
        tuple(str(k) for k in range(trials)), forced,
    )  # fmt: skip
