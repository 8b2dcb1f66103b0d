"""Trials until the Bayes factor decides: in theory, and in experiments on the best task."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from bgmodel.bootstrap import Z95
from bgmodel.discriminating.designs import (
    Direction,
    TaskDesign,
    TaskInformation,
    informed,
    shares_of,
)
from bgmodel.discriminating.information import Information
from bgmodel.discriminating.trials import PairedTrials
from bgmodel.integrators.first_passage import Empirical, walk
from bgmodel.integrators.sprt_theory import OVERSHOOT
from bgmodel.support.seeds import stream
from circuits.arrays import Array, Integers
from circuits.errors import InputError

FACTOR = 10.0
"""Bayes factor at which an experiment ends."""
BOUND_NATS = float(np.log(FACTOR))
SHORT = 400
"""Medians up to here are computed exactly."""
STEEP = 30.0
"""Drift, relative to noise, from which the walk goes straight to its bound."""
REPEATS = 200
"""Simulated experiments for each of the two models."""
LEAST_RIGHT = 1 - 1 / 11 - 3 * float(np.sqrt(10 / 11**2 / REPEATS))
"""Least share of experiments that must favour the truth, that of a Bayes factor of 10 within three
standard errors; otherwise the models are not told apart."""
OF_EXPERIMENTS = ("simulated_median", "right", "experiments")
"""Columns of simulated experiments; unknown where models cannot be told apart."""


def exit_median(mean: float, variance: float, bound: float = BOUND_NATS) -> float:
    """Return the median number of steps in which a walk leaves (-bound, bound), by diffusion.

    The survival of a diffusion between two bounds is a series of sines (Cox & Miller 1965); it is
    solved for 1/2. The mean number of steps is Wald's (1945).
    """
    from scipy.optimize import brentq

    length = 2 * (bound + OVERSHOOT * np.sqrt(variance))
    k = np.arange(1, 400) * np.pi / length
    tilt = mean / variance
    odd = np.where(np.arange(1, 400) % 2, 1.0, -1.0)
    half = tilt * length / 2
    if half > STEEP:
        return float(length / 2 / mean)
    # The integral of exp(tilt x) sin(k x), relative to the start half-way.
    ends = k * (np.exp(-half) + odd * np.exp(half)) / (tilt**2 + k**2)
    size = 2 / length * ends * np.sin(k * length / 2)
    rate = (mean**2 / variance + k**2 * variance) / 2

    def above_half(log_time: float) -> float:
        return float(size @ np.exp(-rate * np.exp(log_time))) - 0.5

    scale = np.log(length**2 / variance)
    return float(np.exp(brentq(above_half, scale - 8, scale + 8)))


def median_trials(values: Array, weights: Array) -> float:
    """Return the median number of trials until a Bayes factor reaches its bound on either side.

    Small numbers are those of the exact Markov chain (``first_passage``), larger ones those
    of the diffusion.
    """
    mean = float(weights @ values)
    variance = float(weights @ (values - mean) ** 2)
    about = exit_median(mean, variance)
    if about > SHORT:
        return about
    end = int(4 * about) + 20
    steps = walk(Empirical(values, weights), -BOUND_NATS, BOUND_NATS, t_max=end).steps_pmf
    assert steps is not None
    return float(np.searchsorted(np.cumsum(steps), 0.5))


def wald_mean(nats: float) -> float:
    """Return Wald's mean number of trials: bound tanh(bound / 2) / nats, without overshoot."""
    return float(BOUND_NATS * np.tanh(BOUND_NATS / 2) / nats)


def experiments(
    values: list[Array],
    bins: list[Integers],
    shares: list[float],
    rng: np.random.Generator,
    *,
    repeats: int = 200,
    most: int = 100_000,
) -> tuple[Array, Array]:
    """Simulate experiments that end when the Bayes factor decides."""
    state, ended = np.zeros(repeats), np.full(repeats, np.nan)
    right = np.zeros(repeats)
    scores = [ratio[place] for ratio, place in zip(values, bins, strict=True)]
    done, block = 0, 64
    while done < most and np.isnan(ended).any():
        kind = rng.choice(len(shares), size=(repeats, block), p=shares)
        steps = np.zeros((repeats, block))
        for k, score in enumerate(scores):
            here = kind == k
            steps[here] = rng.choice(score, int(here.sum()))
        path = state[:, None] + np.cumsum(steps, axis=1)
        over = np.abs(path) >= BOUND_NATS
        first = over.argmax(axis=1)
        new = over.any(axis=1) & np.isnan(ended)
        ended[new] = done + 1 + first[new]
        right[new] = path[new, first[new]] > 0
        state, done = path[:, -1], done + block
        block = min(2 * block, 4096)
    return ended, right


def needed(information: Information, quantile: float = Z95) -> dict[str, float]:
    """Return the trials until a Bayes factor of 10: nats, error, median, low, high, wald_mean.

    The interval is that of the information, 95 %, ``quantile`` standard errors on either side. If
    the information is not above 0, the median is infinite, and low is the number of trials that is
    needed at least.
    """
    nats, half = information.nats, quantile * information.error
    least, most = nats - half, max(nats, 0) + half
    known = {"nats": nats, "error": information.error}
    if least <= 0:
        low = exit_median(most, 2 * most) if most > 0 else np.inf
        return known | {"median": np.inf, "low": low, "high": np.inf, "wald_mean": np.inf}
    # Numbers of trials are inversely proportional to the information.
    scale = median_trials(information.values, information.weights) * information.plain_nats
    ends = {"median": scale / nats, "low": scale / most, "high": scale / least}
    return known | ends | {"wald_mean": wald_mean(nats)}


def _only(trials: PairedTrials, design: TaskDesign, seed: int, count: int) -> PairedTrials:
    """Return trials of one task alone, with another seed."""
    space = replace(trials.space, accuracy=(design.accuracy,), deadline_ms=(design.deadline_ms,))
    return replace(trials, space=space, seed=seed, trials=count)


def again(
    trials: PairedTrials, design: TaskDesign, seed: int, count: int, free_time: bool
) -> TaskInformation[TaskDesign]:
    """Return the information of a task with another seed."""
    tasks = list(informed(_only(trials, design, seed, count), design.probe, free_time))
    if not tasks:
        raise InputError(
            f"{design.text()}: the accuracy is not reached with seed {seed}", "check_seed"
        )
    return tasks[0]


def simulated_experiments(
    trials: PairedTrials, check: TaskInformation[TaskDesign], seed: int, count: int
) -> pd.DataFrame:
    """Return predicted numbers of trials, and those of simulated sequential experiments.

    Columns are those of ``Discrimination.sequential``.
    """
    others = _only(trials, check.design, seed, count)
    # Thresholds are those of the check; these trials give choices and times alone.
    probe, accuracy = check.design.probe, check.design.accuracy
    for k, direction in enumerate(check.directions):
        others.cache["_matched", k, probe.plain] = {accuracy: direction.levels[0]}, None
    rows = []
    for k, direction in enumerate(check.directions):
        row = needed(direction.information) | dict.fromkeys(OF_EXPERIMENTS, np.nan)
        if np.isfinite(row["median"]):
            row |= _ended(others, k, direction, check.design)
        rows.append({"truth": trials.models[k].name, **row})
    return confirmed(rows)


def confirmed(rows: list[dict[str, Any]]) -> pd.DataFrame:
    """Return the trials needed as a table, without medians where experiments contradict them.

    Thresholds that are matched with an error, or fits to few trials, tell models apart that are
    one: experiments with other trials then do not favour the truth.
    """
    table = pd.DataFrame(rows)
    if (table["right"] < LEAST_RIGHT).any():
        table[["median", "high", "wald_mean"]] = np.inf
    return table


def _ended(
    trials: PairedTrials, k: int, direction: Direction, design: TaskDesign
) -> dict[str, float]:
    """Return the median length of experiments on a model's trials, and the share that favour it."""
    kinds, shares = shares_of(trials, design.probe)
    bins = [
        partition.place(trials.simulated(k, kind).at(direction.levels[0], design.deadline_ms))
        for partition, kind in zip(direction.partitions, kinds, strict=True)
    ]
    cuts = np.cumsum([partition.bins for partition in direction.partitions])[:-1]
    ratios = np.split(direction.information.values, cuts)
    rng = stream(trials.seed, "discriminate", "experiments", k)
    return outcome(*experiments(ratios, bins, shares, rng, repeats=REPEATS))


def outcome(ended: Array, right: Array) -> dict[str, float]:
    """Return the columns of simulated experiments."""
    median = float(np.median(np.nan_to_num(ended, nan=np.inf)))
    return {"simulated_median": median, "right": float(right.mean()), "experiments": len(ended)}
