"""Studies on dopamine: what the command line, the figures and the scores all run."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.basal_ganglia import BasalGanglia, Circuit
from bgmodel.comparison import SPAN, Sweep, curve, time_at
from bgmodel.dopamine import Body, criterion, knob, working_range
from bgmodel.evidence import Evidence
from bgmodel.learning import Learned, Learner, learn
from bgmodel.policies import GaussianPolicy
from bgmodel.seeds import stream

Array = npt.NDArray[np.float64]
THRESHOLD_NATS = 0.3
"""OUT at which the circuit decides, whatever the dopamine: levels span posteriors .75 to .99."""
PLAYED = (0.75, 2.0)
"""Levels that a learner plays: beyond the working range on both sides, for two alternatives."""


def levels_between(low: float, high: float, count: int) -> Array:
    """Return levels, evenly spaced in their logarithm: OUT moves less the higher they are."""
    return np.geomspace(low, high, count)


def knob_table(
    swept: Sweep,
    test: Sweep,
    *,
    circuit: Circuit,
    gain: float,
    threshold_nats: float = THRESHOLD_NATS,
    rng: np.random.Generator,
    resamples: int = 500,
) -> pd.DataFrame:
    """Return what each level of dopamine does, beside the fixed point and the MSPRT.

    Parameters
    ----------
    swept, test : Sweep
        As from ``dopamine.knob``, and the MSPRT's on the same evidence.
    circuit, gain, threshold_nats :
        What was swept.
    rng : numpy.random.Generator
        For the bootstrap over trials.

    Returns
    -------
    DataFrame
        One row a level and measure: level, measure, value, low, high. Measures: criterion (mean
        posterior of what is chosen), fixed_point (the posterior at which the fixed point decides,
        NaN outside its range), mean_ms, forced, premature, and accuracy_gap: expected accuracy
        minus the MSPRT's at the same mean time, the circuit's mean extra time taken off.
    """
    n = swept.trials
    drawn = rng.multinomial(n, np.full(n, 1 / n), size=resamples) / n
    weights = np.concatenate([np.full((1, n), 1 / n), drawn])
    late = time_at(SPAN, curve(swept, weights)) - time_at(SPAN, curve(test, weights))
    late = np.nanmean(late, axis=1, keepdims=True)
    values = {
        "criterion": weights @ swept.posterior.T,
        "mean_ms": weights @ swept.time_ms.T,
        "forced": weights @ swept.forced.T,
        "premature": weights @ swept.premature.T,
    }
    known, time = curve(test, weights)
    at = values["mean_ms"] - late
    same = [np.interp(*row, np.nan, np.nan) for row in zip(at, time, known, strict=True)]
    values["accuracy_gap"] = values["criterion"] - np.array(same)
    low, high = working_range(circuit, threshold_nats)
    rows = []
    for k, level in enumerate(swept.thresholds):
        inside = low < level < high
        exact = criterion(circuit, float(level), threshold_nats, gain) if inside else np.nan
        rows.append((level, "fixed_point", exact, np.nan, np.nan))
        for name, found in values.items():
            ends = [np.nan, np.nan]
            if np.isfinite(found[:, k]).mean() > 0.95:
                ends = np.nanquantile(found[1:, k], [0.025, 0.975])
            rows.append((level, name, found[0, k], *ends))
    return pd.DataFrame(rows, columns=["level", "measure", "value", "low", "high"])


def body(
    model: BasalGanglia,
    evidence: Evidence,
    levels: npt.ArrayLike,
    threshold_nats: float = THRESHOLD_NATS,
) -> Body:
    """Return a circuit as a learner meets it: its decisions at each level of dopamine."""
    return Body.of(knob(model, evidence, levels, threshold_nats), evidence)


def learn_level(
    met: Body,
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
    met : Body
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
        ``GaussianPolicy`` within ``PLAYED``, and the learner of the abstract test.

    Returns
    -------
    Learned
        Whose ``gap`` is the level of each trial, ``mean_gap`` the tonic level, and
        ``prediction_error`` phasic dopamine.
    """
    trials = [stream(seed, "dopamine", name, run, "trials") for run in range(runs)]
    explored = [stream(seed, "dopamine", name, run, "explored") for run in range(runs)]
    return learn(
        met.environment(xi, trials),
        start_level,
        rngs=explored,
        policy=policy or GaussianPolicy(bounds=PLAYED),
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
    runs, episodes = learned.gap.shape
    return pd.DataFrame(
        {
            "run": np.repeat(np.arange(runs), episodes),
            "episode": np.tile(np.arange(episodes), runs),
            "tonic": learned.mean_gap.ravel(),
            "level": learned.gap.ravel(),
            "reward": learned.reward.ravel(),
            "phasic": learned.prediction_error.ravel(),
        }
    )


def regret(level: npt.ArrayLike, fresh: Body, xi: float) -> Array:
    """Return how much more a level costs than the best one, as a share of the least cost.

    Parameters
    ----------
    level : array
        Levels of dopamine.
    fresh : Body
        The circuit on trials that were not learned from.
    xi : float
        Cost of an error in readings.
    """
    best = fresh.best(xi)[1]
    return (best - fresh.expected(level, xi)) / abs(best)


def after_errors(learned: Learned, xi: float) -> pd.DataFrame:
    """Return how much slower each run is after an error than after a correct choice, readings.

    The second half of the trials; every trial is held to the mean of the run's trials about it, so
    that slow drifts and the errors of slow trials do not count.

    Returns
    -------
    DataFrame
        Columns run, slower (readings) and errors (share).
    """
    cost = -learned.reward[:, learned.reward.shape[1] // 2 :]
    wrong = cost >= xi
    steps = cost - xi * wrong
    rows = []
    for run, (error, time) in enumerate(zip(wrong, steps, strict=True)):
        local = pd.Series(time).rolling(51, center=True, min_periods=1).mean().to_numpy()
        beyond = (time - local)[1:]
        if error[:-1].any():
            slower = beyond[error[:-1]].mean() - beyond[~error[:-1]].mean()
            rows.append({"run": run, "slower": slower, "errors": error.mean()})
    return pd.DataFrame(rows, columns=["run", "slower", "errors"])
