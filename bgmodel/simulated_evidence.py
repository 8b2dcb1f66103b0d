"""Evidence that is drawn with a seed: the Gaussian task, and expectancy over a foreperiod."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bgmodel.evidence import Evidence, check_evidence, whole_steps
from bgmodel.support.checks import check_finite, check_positive, check_range, whole
from bgmodel.support.processes import check_evidence_memory
from bgmodel.support.seeds import generator


def gaussian_evidence(
    trials: int,
    *,
    d_prime: float = 0.5,
    channels: int = 2,
    t_max: int = 40,
    step_ms: float = 50.0,
    conflict: float = 0.0,
    seed: np.random.Generator | int,
) -> Evidence:
    """Draw Gaussian evidence, as for the task "gaussian" of the command line.

    Parameters
    ----------
    trials : int
        Number of trials. Truth is balanced: trial ``k`` belongs to hypothesis ``k mod N``. Choose
        the trials of a further condition at random, because every second trial has the same truth
        if N is even.
    d_prime : float
        Discriminability of two hypotheses by one reading: their separation over the standard
        deviation of the difference of their channels, > 0.
    channels : int
        Number of hypotheses, N.
    t_max : int
        Readings in a trial.
    step_ms : float
        Time between readings, ms.
    conflict : float
        Mean of one competitor relative to that of the truth: 0 is that of the other channels, 1
        that of the truth. The likelihoods do not account for it.
    seed : int or numpy.random.Generator
        The source of all random numbers.

    Raises
    ------
    ValueError
        For a number out of its range, by its name.
    """
    check_positive(d_prime=d_prime)
    return separated_evidence(
        trials,
        whole("t_max", t_max, 1),
        d_prime / np.sqrt(2),
        rng=generator(seed, "seed"),
        hypotheses=whole("channels", channels, 2),
        step_ms=step_ms,
        conflict=conflict,
    )


def separated_evidence(
    trials: int,
    steps: int,
    separation: float,
    *,
    rng: np.random.Generator | int,
    hypotheses: int = 2,
    step_ms: float = 1.0,
    conflict: float = 0.0,
) -> Evidence:
    """Draw the classic Gaussian problem: the true channel has mean ``separation``, the others 0.

    Each reading holds one unit-variance sample per channel, and ``log p(reading | H_i)`` is
    ``separation * x_i`` up to a shared constant (Bogacz & Gurney 2007, with g* = separation).
    For two hypotheses the log-likelihood ratio has mean ``+-separation**2`` and variance
    ``2 separation**2``, so the discriminability of two alternatives by one reading is
    ``d' = sqrt(2) separation``.

    Truth is balanced: trial ``k`` belongs to hypothesis ``k mod N``. ``conflict`` is the mean of
    one competitor, the channel after the true one, as a fraction of the true one's. The likelihoods
    remain those of the problem without a competitor, and are then overconfident. Terms common to
    all channels cancel and are left out.
    """
    trials, steps = whole("trials", trials, 1), whole("steps", steps, 1)
    hypotheses = whole("hypotheses", hypotheses, 2)
    check_positive(separation=separation)
    check_finite(conflict=conflict)
    check_evidence_memory(trials, steps, hypotheses)
    rng = generator(rng)
    truth = np.arange(trials) % hypotheses
    samples = rng.standard_normal((trials, steps, hypotheses))
    samples[np.arange(trials), :, truth] += separation
    samples[np.arange(trials), :, (truth + 1) % hypotheses] += conflict * separation
    return Evidence(separation * samples, truth, step_ms=step_ms, baseline=0.0)


def expecting(
    evidence: Evidence, most_nats: float, foreperiod_ms: float, *, rng: np.random.Generator | int
) -> Evidence:
    """Return evidence with a foreperiod over which expectancy rises linearly.

    At the onset it is R nats, drawn for each trial from a uniform distribution on [0, most_nats];
    the foreperiod is a multiple of the evidence's ``step_ms``.
    """
    check_evidence(evidence)
    check_range(0, np.inf, most_nats=most_nats)
    steps = whole_steps(foreperiod_ms, evidence.step_ms)
    top = generator(rng).uniform(0, most_nats, evidence.trials)
    ramp = top[:, None] * np.arange(1, steps + 1) / steps
    return replace(evidence, onset_ms=foreperiod_ms, expectancy_nats=ramp)
