"""Models of choices between any number of alternatives, by name, and a circuit of N channels.

By symmetry a response is correct or wrong: which of the wrong ones it is says nothing, since they
are equally likely.

As for two channels (``simulated.crossings``), a trial simulated at one drift represents trials of
any other. With drift v of the correct channel c minus the others, and noise of variance 1/2 per
second in each, the evidence z up to time t (sums minus their mean over channels) has the
likelihood ratio ``exp(2 v z_c - v^2 (1 - 1/N) t)``. Since channels are equal, a stored trial
counts N times, once with each channel as the correct one. Its density under all simulated drifts
and correct channels divides the weights (the balance heuristic, Veach & Guibas 1995). Trials are
counted on a grid of t and z_c, separately for correct and for wrong choices.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from bgmodel.fitting.algorithms import GAPS, SENSITIVITY
from bgmodel.fitting.parameters import Parameter
from bgmodel.fitting.responses import BIN_S, Grid
from bgmodel.fitting.simulated.circuit_model import LEVELS, THRESHOLD, CircuitModel
from bgmodel.fitting.simulated.crossings import (
    BATCH,
    LARGEST_EXPONENT,
    Run,
    crossed,
    interpolated,
    log_odds,
    sharpened,
)
from bgmodel.fitting.simulated.msprt import MsprtModel
from bgmodel.fitting.simulated.race import LcaModel, RaceModel
from bgmodel.support.compiling import compiled
from bgmodel.support.seeds import stream
from bgmodel.trials.alternatives import MOST
from circuits.arrays import Array, Integers, Truths
from circuits.errors import InputError

if TYPE_CHECKING:
    from bgmodel.fitting.algorithms import Model
    from circuits.circuit import Circuit

DRIFTS = (0.0, 1.0, 2.0, 4.0, 7.0, 11.0)
"""Drifts at which trials are simulated, 1/sqrt(s)."""
EVIDENCE_BIN = 0.025
"""Width of a bin of evidence, sqrt(s): half of that of the difference of two channels."""
UNIT = 1e-3
"""Resolution of stored evidence, sqrt(s)."""


@dataclass(frozen=True)
class ManyCrossings:
    """Times, choices and evidence of trials at each of several thresholds."""

    thresholds_nats: Array  # Increasing.
    # (thresholds, trials), of the decision and its last reading; the last bin if none
    bins: Integers
    choice: Integers  # (thresholds, trials); channel, or -1 without a decision
    evidence: Integers  # (thresholds, trials, N), 0.001 sqrt(s); sums up to then minus their mean
    # Trial k counts if ``parts[k % len(parts)]`` is true.
    parts: Truths = field(default_factory=lambda: np.ones(1, dtype=np.bool_))
    _counted: dict[int, tuple[Array, Array]] = field(
        default_factory=dict, compare=False, init=False
    )

    def part(self, parts: Truths) -> ManyCrossings:
        """Return the crossings of some parts of the trials."""
        return replace(self, parts=parts)

    @cached_property
    def _columns(self) -> tuple[int, int]:
        """First bin of evidence, and number of bins, with one to spare on either side."""
        ends = (UNIT * np.array([self.evidence.min(), self.evidence.max()]) / EVIDENCE_BIN).round()
        low, high = ends.astype(int) + np.array([-2, 3])
        return int(low), int(high - low)

    @property
    def readings(self) -> int:
        """Number of bins of a trial."""
        return int(self.bins.max()) + 1

    def counted(self, row: int) -> tuple[Array, Array]:
        """Return trials counted at one threshold, (2, bins, evidence), and undecided ones."""
        if row not in self._counted:
            low, columns = self._columns
            decided, never = np.zeros((2, self.readings, columns)), np.zeros(columns)
            count(
                self.bins[row], self.choice[row], self.evidence[row], self.parts,
                np.array(DRIFTS), low, decided, never,
            )  # fmt: skip
            self._counted[row] = sharpened(decided), sharpened(never)
        return self._counted[row]

    def decided(self, rows: list[tuple[int, float]], drift: float) -> Array:
        """Return the probability of a wrong and of a correct decision in each bin, (2, bins)."""
        seen = np.sum([weight * self.counted(row)[0] for row, weight in rows], axis=0)
        never = np.sum([weight * self.counted(row)[1] for row, weight in rows], axis=0)
        low, columns = self._columns
        z = (low + np.arange(columns)) * EVIDENCE_BIN
        last = np.flatnonzero(seen.any(axis=(0, 2)))
        few = int(last[-1]) + 1 if len(last) else 0
        read_s = (np.arange(self.readings) + 1) * BIN_S
        falls = drift**2 * (1 - 1 / self.evidence.shape[2])
        mass = np.zeros((2, self.readings))
        ratio = _ratio(2 * drift * z - falls * read_s[:few, None])
        mass[:, :few] = np.einsum("stz,tz->st", seen[:, :few], ratio)
        undecided = float(never @ _ratio(2 * drift * z - falls * read_s[-1]))
        return np.asarray(mass / (mass.sum() + undecided))


def _ratio(exponent: Array) -> Array:
    """Return likelihood ratios; evidence whose ratio would overflow does not occur that early."""
    return np.asarray(np.exp(np.minimum(exponent, LARGEST_EXPONENT)))


@compiled
def count(
    bins: Any, choice: Any, evidence: Any, parts: Any, drifts: Any, low: Any,
    decided: Any, never: Any,
) -> None:  # fmt: skip
    """Add trials at one threshold to grids of time and evidence, over the density of all drifts."""
    trials, channels = evidence.shape
    for trial in range(trials):
        if not parts[trial % len(parts)]:
            continue
        read_s = (bins[trial] + 1) * BIN_S
        density = 0.0
        for drift in drifts:
            for c in range(channels):
                z = UNIT * evidence[trial, c]
                density += math.exp(
                    min(2 * drift * z - drift**2 * (1 - 1 / channels) * read_s, LARGEST_EXPONENT)
                )
        weight = len(drifts) * channels / density
        for c in range(channels):
            place = UNIT * evidence[trial, c] / EVIDENCE_BIN - low
            left = int(place)
            right = weight * (place - left)
            if choice[trial] < 0:
                never[left] += weight - right
                never[left + 1] += right
            else:
                side = 1 if choice[trial] == c else 0
                decided[side, bins[trial], left] += weight - right
                decided[side, bins[trial], left + 1] += right


def simulated_many(
    run: Run, thresholds_nats: Array, channels: int, *, seconds: float, trials: int, seed: int
) -> ManyCrossings:
    """Simulate trials at each drift, which favours the first channel; return their crossings."""
    readings = math.ceil(seconds / BIN_S)
    parts: list[tuple[npt.NDArray[Any], ...]] = []
    for number, drift in enumerate(DRIFTS):
        rng = stream(seed, "evidence", channels, f"{drift:g}")
        for first in range(0, trials, BATCH):
            few = min(BATCH, trials - first)
            steps = rng.normal(0.0, math.sqrt(BIN_S / 2), (few, readings, channels))
            steps += drift * BIN_S * (np.arange(channels) == 0)
            sums = steps.cumsum(axis=1)
            sums -= sums.mean(axis=2, keepdims=True)
            bins, choice, sums = crossed(run(sums, number * trials + first), sums, thresholds_nats)
            evidence = np.clip(np.round(sums / UNIT), -32_000, 32_000).astype(np.int16)
            parts.append((bins.astype(np.int16), choice.astype(np.int8), evidence))
    bins, choice, evidence = (np.concatenate(part, axis=1) for part in zip(*parts, strict=True))
    return ManyCrossings(thresholds_nats, bins, choice, evidence)


@dataclass(frozen=True)
class ManyCircuitModel(CircuitModel):
    """A circuit of three or more channels: all wrong alternatives have the same evidence."""

    fewest_channels: ClassVar[int] = 3
    most_channels: ClassVar[int] = MOST

    @property
    def _more(self) -> tuple[Parameter, ...]:
        """None: mechanisms and biases are those of two channels."""
        return ()

    def identity(self) -> dict[str, object]:
        """Return all that its predictions depend on."""
        thresholds = self.thresholds_nats[[0, -1]].tolist()
        channels = {"alternatives": self.circuit.channels, "drifts": list(DRIFTS)}
        return {**super().identity(), **channels, "thresholds": [LEVELS, *thresholds]}

    def decided(self, values: Mapping[str, Array], strength: Array, grid: Grid) -> Array:
        """Return the probability of a wrong and of a correct decision; see ``algorithms.Model``."""
        drift = values[SENSITIVITY.name] * strength
        odds, levels = log_odds(values[THRESHOLD]), log_odds(self.thresholds_nats[::-1])
        places = LEVELS - 1 - np.interp(odds, levels, np.arange(LEVELS))
        probability = np.zeros((len(strength), 2, grid.bins))
        for cell, (place, v) in enumerate(zip(places, drift, strict=True)):
            mass = self._crossings.decided(interpolated(float(place), LEVELS), float(v))
            few = min(grid.bins, mass.shape[1])
            probability[cell, :, :few] = mass[:, :few]
        return probability

    @cached_property
    def _crossings(self) -> ManyCrossings:
        if self._part_of is not None:
            model, parts = self._part_of
            crossings: ManyCrossings = model._crossings.part(parts)  # type: ignore[attr-defined]
            return crossings
        entry = self._entry(partial(ManyCrossings, self.thresholds_nats), ())
        run = self.run((), float(self.thresholds_nats[0]))
        return entry.once(lambda: simulated_many(
            run, self.thresholds_nats, self.circuit.channels,
            seconds=self.seconds, trials=self.trials, seed=self.seed,
        ))  # fmt: skip


MODELS: dict[str, Callable[[int, int, int, float], Model]] = {
    "msprt": lambda number, trials, seed, seconds: MsprtModel(number, trials, seed),
    "race": lambda number, trials, seed, seconds: RaceModel(number),
    "lca": LcaModel,
}
"""Models by name, from a number of alternatives, simulated trials, their seed and length, s."""


def check_many(model: str | Path | Circuit, mechanism: str, alternatives: int) -> None:
    """Raise ValueError for models and mechanisms of two alternatives only."""
    if isinstance(model, str) and model in GAPS:
        allowed = ", ".join(MODELS)
        must = f"must be of {allowed} or a circuit with {alternatives} alternatives"
        raise InputError.of("models", must, model)
    if mechanism != "threshold":
        must = f"must be threshold with {alternatives} alternatives"
        raise InputError.of("mechanism", must, mechanism)
