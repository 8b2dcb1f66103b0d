"""Dopamine as the knob of the threshold: what its level does to a circuit, and learning by it.

The read-out's threshold stays where it is. A level of dopamine moves D1's and D2's cortical gain in
opposite directions and with them OUT, so the circuit stops at another posterior. The learner is
that of the abstract test (``learning.learn``); what it plays here is the level. It sees rewards and
its own perturbations of the level, no gap, no evidence and no test.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from bgmodel.basal_ganglia import BasalGanglia, Circuit, run_engine
from bgmodel.comparison import Sweep, sweep
from bgmodel.evidence import Evidence
from bgmodel.learning import Environment

Array = npt.NDArray[np.float64]
LEVELS = (0.0, 2.0)
"""Levels that a circuit takes; 1 is normal."""


def decided_out(circuit: Circuit, level: float, log_odds: float) -> float:
    """Return the winner's OUT at the fixed point, nats.

    Parameters
    ----------
    circuit : Circuit
        The table.
    level : float
        Dopamine.
    log_odds : float
        Of the winner against each other alternative, in the circuit's nats.
    """
    drive = np.zeros((1, 1, circuit.channels))
    drive[0, 0, 0] = log_odds
    drive -= drive.mean()
    found = run_engine(circuit.dopamine(level), drive, engine="algebra", step_ms=1.0)
    return float(found.output_nats[0, 0, 0])


def working_range(circuit: Circuit, threshold_nats: float) -> tuple[float, float]:
    """Return the lowest and highest level at which the circuit decides, and by evidence.

    Below, the OUT of the strongest evidence stays above the threshold: no decision. Above, OUT at
    rest is past it: decisions without evidence. Both are those of the fixed point; noise takes a
    little off.

    Raises
    ------
    ValueError
        If dopamine at no level in 0..2 does.
    """
    strongest = circuit.reach_nats if np.isfinite(circuit.reach_nats) else 20.0

    def turns(log_odds: float) -> float:
        def past(level: float) -> float:
            return decided_out(circuit, level, log_odds) - threshold_nats

        low, high = LEVELS
        if past(low) <= 0:
            return low
        return high if past(high) > 0 else float(brentq(past, low, high, xtol=1e-4))

    low, high = turns(strongest), turns(0.0)
    if not low < high:
        raise ValueError(
            f"no level of dopamine in {LEVELS[0]:g}..{LEVELS[1]:g} takes {circuit.name} to a "
            f"threshold of {threshold_nats:.2f} nats by evidence alone"
        )
    return low, high


def criterion(circuit: Circuit, level: float, threshold_nats: float, gain: float) -> float:
    """Return the posterior at which the fixed point decides, the other alternatives equal.

    Parameters
    ----------
    circuit : Circuit
        The table.
    level : float
        Dopamine, within ``working_range``.
    threshold_nats : float
        OUT at which the circuit decides.
    gain : float
        Nats in the circuit a nat of evidence.
    """
    strongest = circuit.reach_nats if np.isfinite(circuit.reach_nats) else 20.0

    def past(log_odds: float) -> float:
        return decided_out(circuit, level, log_odds) - threshold_nats

    odds = float(brentq(past, 0.0, strongest, xtol=1e-6))
    return float(1 / (1 + (circuit.channels - 1) * np.exp(-odds / gain)))


def knob(
    model: BasalGanglia, evidence: Evidence, levels: npt.ArrayLike, threshold_nats: float
) -> Sweep:
    """Let a circuit decide at several levels of dopamine, its threshold fixed.

    Parameters
    ----------
    model : BasalGanglia
        The circuit.
    evidence : Evidence
        The same for all levels, and so is the noise.
    levels : array (K,)
        Dopamine.
    threshold_nats : float
        OUT at which it decides.

    Returns
    -------
    Sweep
        Whose ``thresholds`` are the levels, highest first.
    """
    falling = np.sort(np.asarray(levels, dtype=np.float64))[::-1]
    rows = [_at_level(model, evidence, float(level), threshold_nats) for level in falling]
    names = ("choice", "time_ms", "forced", "premature", "posterior")
    return Sweep(falling, *(np.concatenate([getattr(r, n) for r in rows]) for n in names))


def _at_level(
    model: BasalGanglia, evidence: Evidence, level: float, threshold_nats: float
) -> Sweep:
    table = model.circuit.dopamine(level)
    options = dict(model.options)
    if model.engine == "ensemble":
        options = {"drop_below": threshold_nats - 0.01, "rates": False, **options}
    changed = replace(model, circuit=table, options=options)
    parts = [
        sweep(changed.trace(activity, part), part, [threshold_nats])
        for part, activity in changed.batches(evidence)
    ]
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total


@dataclass(frozen=True)
class Body:
    """A circuit as a learner meets it: its decisions at each level, on the same trials.

    Parameters
    ----------
    levels : array (K,)
        Dopamine, rising.
    correct : bool array (K, trials)
        Whether the choice was right.
    steps : array (K, trials)
        Time of the decision in readings, all latencies included.
    """

    levels: Array
    correct: npt.NDArray[np.bool_]
    steps: Array

    @classmethod
    def of(cls, found: Sweep, evidence: Evidence) -> Body:
        """Build from decisions and the truth."""
        if evidence.truth is None:
            raise ValueError("reward needs the truth of each trial")
        steps = np.maximum(found.time_ms, 0.0) / evidence.step_ms
        correct = found.choice == evidence.truth
        return cls(found.thresholds[::-1], correct[::-1], steps[::-1])

    def rewards(self, xi: float) -> Array:
        """Return ``r = xi W - T`` of each level and trial, (K, trials)."""
        if not (np.isfinite(xi) and xi > 0):
            raise ValueError(f"xi must be > 0 readings, got {xi}")
        return -xi * ~self.correct - self.steps

    def expected(self, level: npt.ArrayLike, xi: float) -> Array:
        """Return the mean reward at levels, linear between those that were run."""
        means: Array = self.rewards(xi).mean(axis=1)
        return np.interp(np.asarray(level, dtype=np.float64), self.levels, means)

    def best(self, xi: float) -> tuple[float, float]:
        """Return the level with the highest mean reward, and that reward: exhaustive search."""
        means: Array = self.rewards(xi).mean(axis=1)
        return float(self.levels[means.argmax()]), float(means.max())

    def environment(self, xi: float, rngs: Sequence[np.random.Generator]) -> Environment:
        """Return the world of a learner: it plays levels, one a run, and gets rewards.

        Each run draws its trials at random from those that were simulated. A level between two
        that were run is one of both by chance, so that the mean reward is linear between them.
        """
        table = self.rewards(xi)
        count, trials = table.shape
        where = np.arange(count, dtype=np.float64)

        def rewards(episode: int, played: Array) -> Array:
            place = np.interp(played, self.levels, where)
            chance = np.array([rng.random(2) for rng in rngs])
            row = np.minimum(np.floor(place + chance[:, 0]).astype(np.intp), count - 1)
            return table[row, (chance[:, 1] * trials).astype(np.intp)]

        return rewards


def switching(worlds: Sequence[Environment], every: int) -> Environment:
    """Return a world that changes: ``every`` trials of each in turn, again and again."""

    def rewards(episode: int, played: Array) -> Array:
        return worlds[(episode // every) % len(worlds)](episode, played)

    return rewards
