"""Learning a gap on tactile evidence, compared with exhaustive search and the exact optimum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.integrators.first_passage import Empirical
from bgmodel.integrators.sprt_theory import (
    OptimalThreshold,
    optimal_separation,
    reward_curve,
    sprt,
)
from bgmodel.learning.reinforce import (
    SEPARATIONS,
    GaussianPolicy,
    Learned,
    Learner,
    exhaustive_search,
    learn,
    smoothed,
    trials_of,
)
from bgmodel.support.seeds import stream
from bgmodel.tactile.source import FOLDS, Source, source
from bgmodel.tactile.task import SameDifferent
from circuits.arrays import Array
from circuits.errors import InputError

BLOCK = 50_000
"""Trials that are drawn at a time for an exhaustive search."""
WIDER = 1.25
"""Greatest gap that is explored by default, over the best one, if that is not below 8 nats."""
RUN_COLUMNS = ["period_mm", "start_separation", "fold", "repeat", "learned_separation", "regret"]
RUN_COLUMNS += ["optimal_separation", "optimal_cost", "start_regret"]


def increments(readings: Source) -> tuple[Empirical, Empirical]:
    """Return the exact distributions of the log-likelihood ratio under S1 and S2."""
    s1, s2 = readings.log_ratios
    return Empirical.of_sample(s1), Empirical.of_sample(s2)


def fold_sources(taps: pd.DataFrame, period_mm: float) -> list[Source]:
    """Return same/different readings of one grating for each of the six folds."""
    task = SameDifferent(period_mm)
    return [source(taps, task, fold=fold) for fold in range(FOLDS)]


def search_folds(
    sources: list[Source],
    separations: npt.ArrayLike,
    *,
    trials: int,
    t_max: int,
    seed: int,
    name: object,
) -> pd.DataFrame:
    """Score every gap on every fold by simulation and exactly, one row each; forced is a share."""
    rows = []
    gaps = np.atleast_1d(np.asarray(separations, dtype=float))
    for fold, readings in enumerate(sources):
        rng = stream(seed, "search", name, fold)
        sizes = [min(BLOCK, trials - k) for k in range(0, trials, BLOCK)]
        counts = exhaustive_search((readings.draw(n, t_max, rng=rng) for n in sizes), gaps)
        exact = sprt(*increments(readings), gaps, t_max=t_max)
        rows.append(
            pd.DataFrame(
                {
                    "fold": fold,
                    "boundary_separation": gaps,
                    "trials": counts.trials,
                    "accuracy": counts.accuracy,
                    "mean_steps": counts.mean_steps,
                    "forced": counts.forced / counts.trials,
                    "exact_accuracy": 1 - exact.error_rate,
                    "exact_mean_steps": exact.mean_steps,
                }
            )
        )
    return pd.concat(rows, ignore_index=True)


def check_start(start_separation: float, field: str = "start_separation") -> None:
    """Raise ValueError, naming a field, if learning can't start from this gap."""
    low, high = SEPARATIONS
    if not low <= start_separation <= high:
        raise InputError.of(field, f"must be within {low:g}..{high:g} nats", start_separation)


def policy_for(optima: Sequence[OptimalThreshold]) -> GaussianPolicy:
    """Return a policy that can learn the best gaps."""
    best, (least, most) = max(optimum.boundary_separation for optimum in optima), SEPARATIONS
    return GaussianPolicy(bounds=(least, most if best < most else WIDER * best))


def learn_sources(
    sources: list[Source],
    *,
    xi: float,
    starts: Sequence[float],
    repeats: int,
    t_max: int,
    seed: int,
    name: object,
    policy: GaussianPolicy,
    learner: Learner | None = None,
) -> Learned:
    """Learn the gap on several sets of readings from several initial gaps.

    Runs are ordered by set of readings, then by initial gap, then by repeat. Each has its own
    random-number streams, so that it is independent of the others.
    """
    for start in starts:
        check_start(start, "starts")
    runs = list(product(range(len(sources)), starts, range(repeats)))
    draws = []
    for i, start, k in runs:
        rng = stream(seed, "trials", name, i, k, start)
        draws.append(partial(sources[i].draw, steps=t_max, rng=rng))
    return learn(
        trials_of(draws, xi),
        [start for _, start, _ in runs],
        rngs=[stream(seed, "explore", name, i, k, start) for i, start, k in runs],
        policy=policy,
        learner=learner,
    )


def regret_of(
    boundary_separation: Array, readings: Source, optimum: OptimalThreshold, xi: float, t_max: int
) -> Array:
    """Return the excess cost of gaps over that of the best, relative, exact to 3e-4."""
    cost = -reward_curve(*increments(readings), boundary_separation, xi, t_max=t_max)
    return np.maximum((cost - optimum.cost) / optimum.cost, 0.0)


def learn_folds(
    taps: pd.DataFrame,
    period_mm: float,
    *,
    xi: float,
    starts: Sequence[float],
    repeats: int,
    t_max: int,
    seed: int,
    learner: Learner,
    keep: int = 250,
    window: int = 100,
) -> pd.DataFrame:
    """Learn the gap on every fold from each start, and score the learned values.

    Each run has ``keep`` rows. smoothed_separation is the running mean over ``window`` trials; what
    was learned, its regret and the optimum are constant within a run. All runs are simulated
    together, which is faster than one start at a time.
    """
    sources = fold_sources(taps, period_mm)
    optima = [optimal_separation(*increments(one), xi, t_max=t_max) for one in sources]
    options: dict[str, Any] = {"xi": xi, "t_max": t_max, "seed": seed, "name": period_mm}
    learned = learn_sources(
        sources,
        starts=starts,
        repeats=repeats,
        policy=policy_for(optima),
        learner=learner,
        **options,
    )
    episodes = np.linspace(0, learner.episodes - 1, keep).round().astype(int)
    curves = smoothed(learned.mean_played, window)[:, episodes]
    rows = []
    for fold, readings in enumerate(sources):
        count = len(starts) * repeats
        of_fold = slice(fold * count, (fold + 1) * count)
        runs_of_fold = learned.learned[of_fold], readings, np.repeat(starts, repeats), optima[fold]
        runs = _scored(*runs_of_fold, xi, t_max).assign(
            period_mm=period_mm, fold=fold, repeat=np.tile(np.arange(repeats), len(starts))
        )
        rows.append(
            runs.loc[runs.index.repeat(keep), RUN_COLUMNS].assign(
                episode=np.tile(episodes, count), smoothed_separation=curves[of_fold].ravel()
            )
        )
    return pd.concat(rows, ignore_index=True)


def _scored(
    learned: Array,
    readings: Source,
    starts: Array,
    optimum: OptimalThreshold,
    xi: float,
    t_max: int,
) -> pd.DataFrame:
    """Return learned gaps of one fold with its optimum and their starts, one row per run."""
    return pd.DataFrame(
        {
            "start_separation": starts,
            "learned_separation": learned,
            "regret": regret_of(learned, readings, optimum, xi, t_max),
            "optimal_separation": optimum.boundary_separation,
            "optimal_cost": optimum.cost,
            "start_regret": regret_of(starts, readings, optimum, xi, t_max),
        }
    )


@dataclass(frozen=True)
class LearnedGap:
    """Gaps that several runs learned on the same readings, and the exact optimum."""

    learned: Learned
    regret: Array  # (runs,), excess cost over that of the optimum, relative
    optimum: OptimalThreshold


def learn_gap(
    readings: Source,
    *,
    name: tuple[float, int],
    xi: float,
    start_separation: float,
    runs: int,
    t_max: int,
    seed: int,
    learner: Learner | None = None,
) -> LearnedGap:
    """Learn the gap on the readings of one task and fold; compare with the exact optimum.

    ``name`` is the number of the stimulus and of the fold, which name random-number streams.
    """
    check_start(start_separation)
    optimum = optimal_separation(*increments(readings), xi, t_max=t_max)
    learned = learn_sources(
        [readings],
        xi=xi,
        starts=[start_separation],
        repeats=runs,
        t_max=t_max,
        seed=seed,
        name=name,
        policy=policy_for([optimum]),
        learner=learner,
    )
    regret = regret_of(learned.learned, readings, optimum, xi, t_max)
    return LearnedGap(learned, regret, optimum)
