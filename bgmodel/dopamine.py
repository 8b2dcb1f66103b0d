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

from bgmodel.comparison.circuits import CIRCUIT, sweeps
from bgmodel.comparison.compare import Sweep
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import (
    NOISE_SHARE,
    SPIKING,
    BasalGanglia,
    Circuit,
    run_engine,
    share_crossed,
)
from bgmodel.learning.reinforce import Environment, check_xi

Array = npt.NDArray[np.float64]
ALLOWED = (0.0, 2.0)
"""Levels that a circuit takes; 1 is normal."""
MARGIN = 0.02
"""Share of a level by which a learner keeps away from where the fixed point stops deciding."""


def decided_out(circuit: Circuit, level: float, log_odds: npt.ArrayLike) -> Array:
    """Return the leader's OUT at the fixed point, nats, in the shape of ``log_odds``.

    Parameters
    ----------
    circuit : Circuit
        The table.
    level : float
        Dopamine.
    log_odds : array (M,) or float
        Of the leader against each other alternative, in the circuit's nats.
    """
    circuit.check_nats("a drive of log odds")
    odds = np.asarray(log_odds, dtype=np.float64)
    drive = np.zeros((odds.size, 1, circuit.channels))
    drive[:, 0, 0] = odds.ravel()
    drive -= drive.mean(axis=2, keepdims=True)
    found = run_engine(circuit.dopamine(level), drive, engine="algebra", step_ms=1.0)
    return np.asarray(found.output_nats[:, 0, 0].reshape(odds.shape))


def _odds(circuit: Circuit) -> Array:
    """Return log odds from none to the most that the circuit takes: its reach, or its range."""
    circuit.check_nats("a criterion that dopamine sets")
    n = circuit.channels
    most = (circuit.range_nats[1] - circuit.reference_nats + np.log(n)) * n / (n - 1)
    return np.linspace(0.0, min(circuit.reach_nats, most), 201)


def working_range(circuit: Circuit, threshold_nats: float) -> tuple[float, float]:
    """Return the lowest and highest level at which the fixed point decides, and by evidence.

    Below, the leader's OUT stays above the threshold whatever the evidence: no decision. Above,
    OUT at rest is past it: decisions without evidence; or the highest is 2, the most that is
    allowed. Noise of spikes crosses at rest from lower levels on, and now and then where the fixed
    point never does.

    Raises
    ------
    ValueError
        If the circuit does not read the threshold, or no level in 0..2 serves.
    """
    odds = _odds(circuit)
    low_nats, high_nats = circuit.readable_nats
    if not low_nats < threshold_nats < high_nats:
        raise ValueError(
            f"{circuit.name} reads OUT between {low_nats:.3g} and {high_nats:.3g} nats, the "
            f"threshold is {threshold_nats:g}"
        )

    def turns(log_odds: Array) -> float:
        def past(level: float) -> float:
            return float(decided_out(circuit, level, log_odds).min()) - threshold_nats

        low, high = ALLOWED
        if past(low) <= 0:
            return low
        return high if past(high) > 0 else float(brentq(past, low, high, xtol=1e-4))

    low, high = turns(odds), turns(odds[:1])
    if not low < high:
        raise ValueError(
            f"no level of dopamine in {ALLOWED[0]:g}..{ALLOWED[1]:g} takes {circuit.name} to a "
            f"threshold of {threshold_nats:.2f} nats by evidence alone"
        )
    return low, high


def usable_range(model: BasalGanglia, threshold_nats: float) -> tuple[float, float]:
    """Return the lowest and highest level that a learner should play.

    Where the fixed point decides by evidence, ``MARGIN`` away from where it stops to (no margin is
    left where the most that is allowed ends it). With spikes
    it also ends where noise decides: where OUT at rest meets the threshold in more than
    ``NOISE_SHARE`` of 200 trials of half a second, in the compiled engine.

    Raises
    ------
    ValueError
        As ``working_range``, or if that leaves no level.
    """
    low, high = working_range(model.circuit, threshold_nats)
    low = low * (1 + MARGIN)
    high = high * (1 - MARGIN) if high < ALLOWED[1] else high

    def noisy(level: float) -> bool:
        edited = replace(model, circuit=model.circuit.dopamine(level))
        return share_crossed(edited.out_at_rest(200), threshold_nats) > NOISE_SHARE

    if model.engine in SPIKING and noisy(high):
        quiet = low
        while high - quiet > 0.01:
            middle = (quiet + high) / 2
            quiet, high = (quiet, middle) if noisy(middle) else (middle, high)
        high = quiet
    if not 0 < low < high:
        raise ValueError(
            f"no level of dopamine takes {model.circuit.name} to a threshold of "
            f"{threshold_nats:.2f} nats by evidence and not by noise"
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

    Raises
    ------
    ValueError
        If the level lies outside the working range.
    """
    odds = _odds(circuit)
    past = decided_out(circuit, level, odds) - threshold_nats
    if not past[0] > 0 >= past.min():
        low, high = working_range(circuit, threshold_nats)
        raise ValueError(
            f"at a threshold of {threshold_nats:g} nats {circuit.name} decides by evidence at "
            f"levels {low:.2f} to {high:.2f}, got {level:g}"
        )
    first = int(np.argmax(past <= 0))
    found = brentq(
        lambda o: float(decided_out(circuit, level, o)) - threshold_nats,
        odds[first - 1],
        odds[first],
        xtol=1e-7,
    )
    return float(1 / (1 + (circuit.channels - 1) * np.exp(-found / gain)))


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
    low, high = ALLOWED
    if falling.ndim != 1 or not len(falling) or not np.all(np.diff(falling) < 0):
        raise ValueError(f"levels must be one or more numbers, each once, got {levels!r}")
    if not (falling[-1] >= low and falling[0] <= high):
        raise ValueError(f"levels must lie in {low:g}..{high:g}, got {levels!r}")
    rows = [
        sweeps(
            replace(model, circuit=model.circuit.dopamine(float(level))),
            evidence,
            [threshold_nats],
            decoder_tau_ms=None,
        )[CIRCUIT]
        for level in falling
    ]
    names = ("choice", "time_ms", "forced", "premature", "posterior")
    return Sweep(falling, *(np.concatenate([getattr(r, n) for r in rows]) for n in names))


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
    forced : array (K,)
        Share of trials that the deadline decided.
    """

    levels: Array
    correct: npt.NDArray[np.bool_]
    steps: Array
    forced: Array

    def __post_init__(self) -> None:
        shape = (len(self.levels), self.correct.shape[-1])
        if self.correct.shape != shape or self.steps.shape != shape:
            raise ValueError(
                f"correct and steps must be (levels, trials) = {shape}, got {self.correct.shape} "
                f"and {self.steps.shape}"
            )
        if not np.all(np.diff(self.levels) > 0):
            raise ValueError(f"levels must rise, got {self.levels}")

    @classmethod
    def of(cls, found: Sweep, evidence: Evidence) -> Body:
        """Build from decisions and the truth."""
        if evidence.truth is None:
            raise ValueError("reward needs the truth of each trial")
        if evidence.trials != found.trials:
            raise ValueError(f"decisions of {found.trials} trials, evidence of {evidence.trials}")
        steps = np.maximum(found.time_ms, 0.0) / evidence.step_ms
        correct = found.choice == evidence.truth
        forced = found.forced.mean(axis=1)
        return cls(found.thresholds[::-1], correct[::-1], steps[::-1], forced[::-1])

    def rewards(self, xi: float) -> Array:
        """Return ``r = xi W - T`` of each level and trial, (K, trials)."""
        check_xi(xi)
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
    if not worlds or every < 1:
        raise ValueError(f"worlds must hold one or more, every >= 1, got {len(worlds)}, {every}")

    def rewards(episode: int, played: Array) -> Array:
        return worlds[(episode // every) % len(worlds)](episode, played)

    return rewards
