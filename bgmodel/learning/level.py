"""Learning of a level of dopamine, and the table of what each level does."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.comparison.compare import Sweep, curve, interval, resampled
from bgmodel.dopamine import criterion, decide_at_levels, usable_range, working_range
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.learning.policies import GaussianPolicy
from bgmodel.learning.reinforce import Learned, Learner, learn
from bgmodel.learning.worlds import LevelOutcomes
from bgmodel.seeds import stream
from circuits.spec import Circuit

Array = npt.NDArray[np.float64]
THRESHOLD_NATS = 0.3
"""OUT at which the circuit decides, whatever the dopamine: for two to four alternatives the fixed
point spans posteriors .75 to .99."""
COARSE = {"dt_ms": 0.5, "sample_ms": 2.0}
"""Ticks of the rate engine where thousands of trials are run at each of many levels."""
LAST_SHARE = 0.08
"""Exploration in the end, sd as a share of the levels' distance; tuned on seed 1002. With less, an
optimum beside the edge is found too late; with more, one in a bend is missed."""


def levels_between(low: float, high: float, count: int) -> Array:
    """Return levels, evenly spaced in their logarithm: OUT moves less the higher they are."""
    return np.geomspace(low, high, count)


def playable_levels(
    model: BasalGanglia, count: int, threshold_nats: float = THRESHOLD_NATS
) -> Array:
    """Return levels (count,) at which a learner meets a circuit, over its ``usable_range``."""
    return levels_between(*usable_range(model, threshold_nats), count)


def level_table(
    swept: Sweep,
    tests: Mapping[str, Sweep],
    *,
    circuit: Circuit,
    gain: float,
    latency_ms: float,
    threshold_nats: float = THRESHOLD_NATS,
    rng: np.random.Generator,
    resamples: int = 500,
) -> pd.DataFrame:
    """Return what each level of dopamine does, beside the fixed point and tests.

    Parameters
    ----------
    swept : Sweep
        As from ``dopamine.decide_at_levels``.
    tests : mapping of Sweep
        By name, as from ``comparison.circuits.msprt_sweeps``, on the same evidence.
    circuit, gain, threshold_nats :
        The circuit that was swept.
    latency_ms : float
        What is no decision time: known from elsewhere, not fitted to what is judged by it.
    rng : numpy.random.Generator
        For the bootstrap over trials.

    Returns
    -------
    DataFrame
        One row a level and measure: level, measure, value, low, high, reference. Measures:
        criterion (mean posterior of what is chosen), fixed_point (the posterior at which the fixed
        point decides, NaN outside its range), mean_ms, forced, premature; and beside each test
        accuracy_gap (expected accuracy minus the test's at the same mean time less the latency) and
        extra_ms (mean time minus the test's at the same expected accuracy, the latency not taken
        off).
    """
    weights = resampled(swept.trials, resamples, rng)
    weights = weights / weights.sum(axis=1, keepdims=True)
    values = {
        ("criterion", ""): weights @ swept.posterior.T,
        ("mean_ms", ""): weights @ swept.time_ms.T,
        ("forced", ""): weights @ swept.forced.T,
        ("premature", ""): weights @ swept.premature.T,
    }
    reached, took = values["criterion", ""], values["mean_ms", ""]
    for name, test in tests.items():
        known, time = curve(test, weights)
        values["accuracy_gap", name] = reached - _between(took - latency_ms, time, known)
        values["extra_ms", name] = took - _between(reached, known, time)
    low, high = working_range(circuit, threshold_nats)
    rows = []
    for k, level in enumerate(swept.settings):
        inside = low < level < high
        exact = criterion(circuit, float(level), threshold_nats, gain) if inside else np.nan
        rows.append((level, "fixed_point", exact, np.nan, np.nan, ""))
        rows += [(level, m, *interval(found[:, k]), name) for (m, name), found in values.items()]
    return pd.DataFrame(rows, columns=["level", "measure", "value", "low", "high", "reference"])


def _between(at: Array, x: Array, y: Array) -> Array:
    """Return y where x is ``at``, row by row; NaN beyond the curve."""
    return np.array([np.interp(*row, np.nan, np.nan) for row in zip(at, x, y, strict=True)])


def level_outcomes(
    model: BasalGanglia,
    evidence: Evidence,
    levels: npt.ArrayLike,
    threshold_nats: float = THRESHOLD_NATS,
) -> LevelOutcomes:
    """Return the outcomes of a circuit's decisions at each level of dopamine."""
    return LevelOutcomes.of(decide_at_levels(model, evidence, levels, threshold_nats), evidence)


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
    """Let dopamine learn its own level from reward, in several independent runs.

    Parameters
    ----------
    outcomes : LevelOutcomes
        The circuit; the learner sees its rewards alone.
    xi : float
        Cost of an error in readings.
    start_level : float
        Tonic level at the start.
    runs : int
        Each with trials and exploration of its own.
    seed, name :
        Of the streams.
    policy, learner :
        A ``GaussianPolicy`` on the levels of the outcomes, its last exploration ``LAST_SHARE``, and
        the learner of the abstract test.

    Returns
    -------
    Learned
        ``played`` is the level of each trial, ``mean_played`` the tonic level, and
        ``prediction_error`` phasic dopamine.

    Raises
    ------
    ValueError
        If the start or what is played lies beyond the levels of the outcomes, or there is no run.
    """
    low, high = float(outcomes.levels[0]), float(outcomes.levels[-1])
    policy = policy or GaussianPolicy(bounds=(low, high), last_share=LAST_SHARE)
    if not low <= policy.bounds[0] < policy.bounds[1] <= high:
        raise ValueError(f"what is played must lie in {low:.3f}..{high:.3f}, got {policy.bounds}")
    if not low <= start_level <= high:
        raise ValueError(f"start_level must lie in {low:.3f}..{high:.3f}, got {start_level}")
    if runs < 1:
        raise ValueError(f"runs must be >= 1, got {runs}")
    # Starts with one name are paired: the same trials and perturbations from any of them.
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
        One row a trial of a run: run, episode, tonic (the mean level), level (what was played),
        reward, phasic (the reward prediction error).
    """
    runs, episodes = learned.played.shape
    return pd.DataFrame(
        {
            "run": np.repeat(np.arange(runs), episodes),
            "episode": np.tile(np.arange(episodes), runs),
            "tonic": learned.mean_played.ravel(),
            "level": learned.played.ravel(),
            "reward": learned.reward.ravel(),
            "phasic": learned.prediction_error.ravel(),
        }
    )


def regret(level: npt.ArrayLike, fresh: LevelOutcomes, xi: float) -> Array:
    """Return how much more a level costs than the best one, as a share of the least cost.

    Parameters
    ----------
    level : array
        Levels of dopamine.
    fresh : LevelOutcomes
        The circuit on trials that were not learned from.
    xi : float
        Cost of an error in readings.
    """
    best = fresh.best(xi)[1]
    return (best - fresh.expected(level, xi)) / abs(best)


def after_errors(learned: Learned, xi: float) -> pd.DataFrame:
    """Return how much slower each run is after an error than after a correct choice, readings.

    The second half of the trials; each is held to the mean of the 50 about it, itself and the one
    before left out, so that slow drifts do not count.

    Parameters
    ----------
    learned : Learned
        With rewards ``xi W - T``.
    xi : float
        Cost of an error in readings; more than any trial takes, or errors could not be told.

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
        raise ValueError(f"xi must be longer than any trial, got {xi} for trials that reach it")
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
