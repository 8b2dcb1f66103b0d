"""Learning a level of dopamine from reward, and the cost of the learned level."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.comparison.matched import MOST_FORCED
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.learning.dopamine import THRESHOLD_NATS, decide_at_levels
from bgmodel.learning.policies import GaussianPolicy
from bgmodel.learning.reinforce import Learned, Learner, course, learn
from bgmodel.learning.worlds import LevelOutcomes
from bgmodel.support.arrays import Array
from bgmodel.support.seeds import stream
from circuits.errors import DeadlineWarning, InputError, require

LAST_SHARE = 0.08
"""Final exploration, sd as a share of the range of levels; tuned on seed 1002. With less, an
optimum near the edge is found too late; with more, one at a bend of the curve is missed."""


def level_outcomes(
    model: BasalGanglia,
    evidence: Evidence,
    levels: npt.ArrayLike,
    threshold_nats: float = THRESHOLD_NATS,
) -> LevelOutcomes:
    """Return the outcomes of a circuit's decisions at each level of dopamine.

    Raises
    ------
    ValueError
        If the circuit decides without evidence at the threshold, or if the deadline decides most
        trials at every level.

    Warns
    -----
    UserWarning
        If the deadline decides most trials at some levels.
    """
    decided = decide_at_levels(model, evidence, levels, threshold_nats)
    outcomes = LevelOutcomes.of(decided, evidence)
    check_decided(outcomes)
    return outcomes


def check_decided(outcomes: LevelOutcomes) -> None:
    """Warn of levels at which the deadline decides most trials; ValueError if it does so at all."""
    late = outcomes.forced > MOST_FORCED
    if late.all():
        said = "the deadline decides most trials at every level: give more readings"
        raise InputError(said, "evidence")
    if late.any():
        DeadlineWarning.warn(
            f"the deadline decides most trials at {late.sum()} of {len(late)} levels"
        )


def learn_level(
    outcomes: LevelOutcomes,
    *,
    xi: float,
    start_level: float,
    runs: int,
    seed: int,
    name: object,
    policy: GaussianPolicy | None = None,
    learner: Learner | None = None,
) -> Learned:
    """Learn the level of dopamine from reward, in several independent runs.

    Parameters
    ----------
    outcomes : LevelOutcomes
        Outcomes of the circuit; the learner sees only their rewards.
    xi : float
        Cost of an error in readings.
    start_level : float
        Initial tonic level.
    runs : int
        Number of runs, with independent trials and exploration.
    seed, name :
        Seed and name of the random-number streams.
    policy, learner :
        A ``GaussianPolicy`` on the levels of the outcomes, with final exploration ``LAST_SHARE``,
        and the learner of the abstract test.

    Returns
    -------
    Learned
        ``played`` is the level of each trial, ``mean_played`` the tonic level, and
        ``prediction_error`` phasic dopamine.

    Raises
    ------
    ValueError
        If the start or an action is outside the levels of the outcomes, or there is no run.
    """
    low, high = float(outcomes.levels[0]), float(outcomes.levels[-1])
    policy = policy or GaussianPolicy(bounds=(low, high), last_share=LAST_SHARE)
    must, (least, most) = f"must be within {low:.3f}..{high:.3f}", policy.bounds
    require(low <= least < most <= high, "bounds", must, policy.bounds)
    require(low <= start_level <= high, "start_level", must, start_level)
    require(runs >= 1, "runs", "must be >= 1", runs)
    # Runs of one name are paired: all starts have the same trials and perturbations.
    trials = [stream(seed, "dopamine", name, run, "trials") for run in range(runs)]
    explored = [stream(seed, "dopamine", name, run, "explored") for run in range(runs)]
    return learn(
        outcomes.environment(xi, trials),
        start_level,
        rngs=explored,
        policy=policy,
        learner=learner,
    )


def learned_table(learned: Learned) -> pd.DataFrame:
    """Return a course of learning as a table.

    Returns
    -------
    DataFrame
        One row per trial of a run: run, episode, tonic (the mean level), level (as sampled),
        reward, phasic (the reward prediction error).
    """
    return course(learned, mean="tonic", played="level", error="phasic")


def regret(level: npt.ArrayLike, fresh: LevelOutcomes, xi: float) -> Array:
    """Return the excess cost of a level over the best one, as a share of the least cost.

    Parameters
    ----------
    level : array
        Levels of dopamine; the result is NaN outside the levels of ``fresh``.
    fresh : LevelOutcomes
        Outcomes of the circuit on trials not used for learning.
    xi : float
        Cost of an error in readings.
    """
    best = fresh.best(xi)[1]
    return (best - fresh.expected(level, xi)) / abs(best)


def scored_runs(
    ends: npt.ArrayLike,
    fresh: LevelOutcomes,
    *,
    xi: float,
    start_level: float,
    first: LevelOutcomes | None = None,
) -> pd.DataFrame:
    """Score learned levels on trials not used for learning.

    Parameters
    ----------
    ends : array (runs,)
        Level learned by each run.
    fresh : LevelOutcomes
        Outcomes of the circuit on trials not used for learning.
    xi : float
        Cost of an error in readings.
    start_level : float
        Initial level of all runs.
    first : LevelOutcomes, optional
        Outcomes that include the start, if ``fresh`` does not.

    Returns
    -------
    DataFrame
        One row per run: run, learned_level, reward and regret (NaN outside the levels of
        ``fresh``), start_level, start_regret, best_level and best_reward.
    """
    learned = np.asarray(ends, dtype=np.float64)
    inside = (learned >= fresh.levels[0]) & (learned <= fresh.levels[-1])
    best_level, best_reward = fresh.best(xi)
    return pd.DataFrame(
        {
            "run": np.arange(len(learned)),
            "learned_level": learned,
            "reward": np.where(inside, fresh.expected(learned, xi), np.nan),
            "regret": np.where(inside, regret(learned, fresh, xi), np.nan),
            "start_level": start_level,
            "start_regret": float(regret(start_level, first or fresh, xi)),
            "best_level": best_level,
            "best_reward": best_reward,
        }
    )


def after_errors(learned: Learned, xi: float) -> pd.DataFrame:
    """Return post-error slowing of each run: time after errors minus after correct choices.

    For the second half of the trials; each is compared with the mean of the 50 around it, without
    itself and the one before, to remove slow drifts.

    Parameters
    ----------
    learned : Learned
        With rewards ``xi W - T``.
    xi : float
        Cost of an error in readings; must exceed any trial's duration, to identify errors.

    Returns
    -------
    DataFrame
        Columns run, slower (readings) and errors (share).

    Raises
    ------
    ValueError
        If there may be trials that take xi readings or more.
    """
    cost = -learned.reward[:, learned.reward.shape[1] // 2 :]
    wrong = cost >= xi
    if cost[~wrong].max(initial=0) > 0.9 * xi or cost.max(initial=0) > 1.9 * xi:
        raise InputError.of("xi", "must be longer than any trial", xi)
    steps = cost - xi * wrong
    rows = []
    for run, (error, time) in enumerate(zip(wrong, steps, strict=True)):
        about = pd.Series(time).rolling(51, center=True, min_periods=3)
        others = about.sum().to_numpy()[1:] - time[1:] - time[:-1]
        beyond = time[1:] - others / (about.count().to_numpy()[1:] - 2)
        if error[:-1].any():
            slower = beyond[error[:-1]].mean() - beyond[~error[:-1]].mean()
            rows.append({"run": run, "slower": slower, "errors": error.mean()})
    return pd.DataFrame(rows, columns=["run", "slower", "errors"])
