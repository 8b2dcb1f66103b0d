"""The check of the best task with another seed, and sequential experiments with a third."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from bgmodel.discriminating.designs import Design, Direction, Told, shares_of, told
from bgmodel.discriminating.result import needed
from bgmodel.discriminating.sequential import experiments
from bgmodel.discriminating.trials import Trials
from bgmodel.support.seeds import stream
from circuits.errors import InputError

REPEATS = 200
"""Simulated experiments for each of the two models."""
LEAST_RIGHT = 1 - 1 / 11 - 3 * float(np.sqrt(10 / 11**2 / REPEATS))
"""Least share of experiments that must favour the truth, that of a Bayes factor of 10 within three
standard errors; otherwise the models are not told apart."""
OF_EXPERIMENTS = ("simulated_median", "right", "experiments")
"""Columns of simulated experiments; unknown where models cannot be told apart."""


def _only(trials: Trials, design: Design, seed: int, count: int) -> Trials:
    """Return trials of one task alone, with another seed."""
    space = replace(trials.space, accuracy=(design.accuracy,), deadline_ms=(design.deadline_ms,))
    return replace(trials, space=space, seed=seed, trials=count, kept={})


def again(trials: Trials, design: Design, seed: int, count: int, free_time: bool) -> Told:
    """Return what a task tells with another seed."""
    found = list(told(_only(trials, design, seed, count), design.probe, free_time))
    if not found:
        said = f"{design.text()}: the accuracy is not reached with seed {seed}"
        raise InputError(said, "check_seed")
    return found[0]


def simulated_experiments(trials: Trials, check: Told, seed: int, count: int) -> pd.DataFrame:
    """Return predicted numbers of trials, and those of simulated sequential experiments.

    Columns are those of ``Discrimination.sequential``.
    """
    others = _only(trials, check.design, seed, count)
    # Thresholds are those of the check; these trials give choices and times alone.
    probe, accuracy = check.design.probe, check.design.accuracy
    for k, way in enumerate(check.directions):
        others.kept["levels", k, probe.channels, probe.d_prime] = {accuracy: way.levels[0]}
    rows = []
    for k, way in enumerate(check.directions):
        found = needed(way.information) | dict.fromkeys(OF_EXPERIMENTS, np.nan)
        if np.isfinite(found["median"]):
            found |= _ended(others, k, way, check.design)
        rows.append({"truth": trials.models[k].name, **found})
    table = pd.DataFrame(rows)
    # Thresholds that are matched with an error tell models apart that are one: experiments with
    # other trials then do not favour the truth.
    if (table["right"] < LEAST_RIGHT).any():
        table[["median", "high", "wald_mean"]] = np.inf
    return table


def _ended(trials: Trials, k: int, way: Direction, design: Design) -> dict[str, float]:
    """Return the median of experiments in which a model makes the trials, and who is favoured."""
    kinds, shares = shares_of(trials, design.probe)
    bins = [
        partition.place(trials.simulated(k, kind).at(way.levels[0], design.deadline_ms))
        for partition, kind in zip(way.partitions, kinds, strict=True)
    ]
    cuts = np.cumsum([one.bins for one in way.partitions])[:-1]
    ratios = np.split(way.information.values, cuts)
    rng = stream(trials.seed, "discriminate", "experiments", k)
    ended, right = experiments(ratios, bins, shares, rng, repeats=REPEATS)
    median = float(np.median(np.nan_to_num(ended, nan=np.inf)))
    return {"simulated_median": median, "right": float(right.mean()), "experiments": REPEATS}
