"""The multihypothesis test (MSPRT) as a model of choices between N alternatives.

Evidence for each alternative is Gaussian, and the test decides when the largest posterior reaches a
threshold (Baum & Veeravalli 1994); it is correct at the mean strength of the design. If sums are
multiplied by the gain g, twice the drift there, and times by g^2, the threshold is the only other
parameter: paths are simulated once for each relative strength, whatever the sensitivity.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from bgmodel.fitting.algorithms import SENSITIVITY
from bgmodel.fitting.parameters import RESPONSE, Parameter
from bgmodel.fitting.responses import Grid
from bgmodel.fitting.simulated.circuit_model import SIMULATION_SEED, THRESHOLD, TRIALS
from bgmodel.fitting.simulated.crossings import interpolated, log_odds
from bgmodel.fitting.simulated.error import PARTS, InParts
from bgmodel.support.checks import whole
from bgmodel.support.compiling import compiled, inlined
from bgmodel.support.seeds import stream
from circuits.arrays import Array, Truths

FARTHEST = 6.0
"""Standard deviations of a step within which its largest log odds are drawn."""
TINY = 1e-300


@compiled
def walk(
    rng: Any, channels: Any, drift: Any, odds: Any, widths: Any, trials: Any, counts: Any
) -> None:
    """Add first passages to ``counts`` (parts, thresholds, 2, steps): wrong, correct decisions.

    Noise has variance 1/2 per unit of time, and the first, correct channel the drift too. Within a
    step the log odds of a channel are a Brownian bridge, whose maximum is drawn exactly for two
    channels; with more, their variance within a step is that at its end.
    """
    sums, before, after, share = (
        np.zeros(channels), np.zeros(channels), np.zeros(channels), np.zeros(channels),
    )  # fmt: skip
    for trial in range(trials):
        part, row, top = trial % counts.shape[0], 0, -math.log(channels - 1.0)
        sums[:], before[:] = 0.0, top
        for step in range(len(widths)):
            width = widths[step]
            for i in range(channels):
                sums[i] += math.sqrt(width / 2) * rng.standard_normal()
            sums[0] += drift * width
            _log_odds(sums, share, after)
            chosen = -1
            for i in range(channels):
                near = top - FARTHEST * math.sqrt(width)
                if before[i] > near or after[i] > near:
                    peak = _peak(rng, before[i], after[i], _variance(share, i) * width)
                    if peak > top:
                        chosen, top = i, peak
            before[:] = after
            while row < len(odds) and top >= odds[row]:
                counts[part, row, 1 if chosen == 0 else 0, step] += 1
                row += 1
            if row == len(odds):
                break


@inlined
def _log_odds(sums: Any, share: Any, after: Any) -> None:
    """Write the posterior and its log odds for each channel."""
    largest, total = sums.max(), 0.0
    for i in range(len(sums)):
        share[i] = math.exp(sums[i] - largest)
        total += share[i]
    for i in range(len(sums)):
        after[i] = sums[i] - largest - math.log(max(total - share[i], TINY))


@inlined
def _variance(share: Any, i: Any) -> Any:
    """Return the variance of a channel's log odds per unit of time."""
    rest, squares = 0.0, 0.0
    for j in range(len(share)):
        if j != i:
            rest += share[j]
            squares += share[j] ** 2
    return 0.5 * (1.0 + squares / max(rest, 1e-150) ** 2)


@inlined
def _peak(rng: Any, start: Any, end: Any, variance: Any) -> Any:
    spread = -2 * variance * math.log(1.0 - rng.random())
    return (start + end + math.sqrt((end - start) ** 2 + spread)) / 2


LEVELS, HIGHEST_LOG_ODDS, NEAREST = 80, 5.0, 0.05
"""Number of thresholds of the stored paths, their largest log odds, and the distance of the
smallest from those of the prior."""
PATHS = 4
"""Paths of a relative strength per simulated trial of a circuit: they take less time."""
FIRST, GROWTH, LARGEST, END = 0.004, 0.02, 0.5, 400.0
"""First step of a path; growth of steps as a share of the time; largest step; end of a path."""


@lru_cache(maxsize=1)
def ends() -> Array:
    """Return the ends of the steps of a path, from 0 on, in units of scaled time."""
    times = [0.0]
    while times[-1] < END:
        times.append(times[-1] + float(np.clip(GROWTH * times[-1], FIRST, LARGEST)))
    return np.array(times)


def odds_of(alternatives: int) -> Array:
    """Return the log odds of the stored thresholds, increasing, denser near those of the prior."""
    prior = -np.log(alternatives - 1.0)
    share = np.linspace(0, 1, LEVELS) ** 1.5
    return np.asarray(prior + NEAREST + share * (HIGHEST_LOG_ODDS - prior - NEAREST))


@lru_cache(maxsize=32)
def passages(alternatives: int, drift: float, trials: int, seed: int) -> npt.NDArray[np.int32]:
    """Return counts of first passages of paths with unit gain, (parts, thresholds, 2, steps)."""
    odds = odds_of(alternatives)
    counts = np.zeros((PARTS, len(odds), 2, len(ends()) - 1), np.int32)
    rng = stream(seed, "msprt", alternatives, f"{drift:.6g}")
    walk(rng, alternatives, drift, odds, np.diff(ends()), trials, counts)
    return counts


@lru_cache(maxsize=128)
def below(
    alternatives: int, drift: float, trials: int, seed: int, parts: tuple[bool, ...]
) -> Array:
    """Return the probability of both decisions by the ends of steps, (thresholds, 2, steps + 1)."""
    counts = passages(alternatives, drift, trials, seed)[list(parts)].sum(axis=0)
    # Trial k belongs to part k % PARTS: the first ones may have one more.
    share = np.bincount(np.arange(trials) % PARTS)[list(parts)].sum()
    return np.pad(counts.cumsum(axis=2) / share, ((0, 0), (0, 0), (1, 0)))


@dataclass(frozen=True)
class MsprtModel(InParts):
    """The multihypothesis sequential probability ratio test in continuous time, simulated."""

    any_width: ClassVar = True
    threshold_name: ClassVar[str] = THRESHOLD
    alternatives: int
    trials: int = TRIALS  # as for a circuit
    seed: int = SIMULATION_SEED
    _parts: Truths = field(default_factory=lambda: np.ones(PARTS, dtype=np.bool_), repr=False)

    def __post_init__(self) -> None:
        whole("trials", self.trials, PARTS)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Sensitivity, threshold, and parameters of responses."""
        odds = odds_of(self.alternatives)
        low, high = (float(np.log1p(np.exp(-end))) for end in (odds[-1], odds[0]))
        about = "minus the log posterior at which it decides"
        return (SENSITIVITY, Parameter(THRESHOLD, low, high, 0.25, about), *RESPONSE)

    def decided(self, values: Mapping[str, Array], strength: Array, grid: Grid) -> Array:
        """Return the probability of a wrong and of a correct decision; see ``algorithms.Model``."""
        mean = np.unique(strength[strength > 0]).mean()
        gain = 2 * values[SENSITIVITY.name] * mean
        probability = np.zeros((len(strength), 2, grid.bins))
        for cell, nats in enumerate(values[THRESHOLD]):
            below = self._below(float(strength[cell] / mean) / 2, float(nats))
            edges = gain[cell] ** 2 * grid.width_s * np.arange(grid.bins + 1)
            probability[cell] = np.diff([np.interp(edges, ends(), side) for side in below], axis=1)
        return probability

    def _below(self, drift: float, nats: float) -> Array:
        """Return the probability of both decisions by the ends of steps, (2, steps + 1)."""
        parts = tuple(self._parts.tolist())
        known = below(self.alternatives, drift, PATHS * self.trials, self.seed, parts)
        odds = odds_of(self.alternatives)
        place = float(np.interp(log_odds(nats), odds, np.arange(LEVELS)))
        rows = interpolated(place, LEVELS)
        return np.asarray(np.sum([weight * known[row] for row, weight in rows], axis=0))

    def _part(self, parts: Truths) -> Self:
        return replace(self, _parts=parts)

    def identity(self) -> dict[str, object]:
        """Return all that its predictions depend on."""
        names = ("alternatives", "trials", "seed")
        return {"model": "msprt"} | {name: getattr(self, name) for name in names}
