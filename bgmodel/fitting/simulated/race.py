"""Races between N alternatives: independent accumulators, exact, and leaky competing ones."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from bgmodel.fitting.algorithms import BOUND, SENSITIVITY, Model, distinct
from bgmodel.fitting.parameters import RESPONSE, Parameter
from bgmodel.fitting.responses import BIN_S, Grid
from bgmodel.fitting.simulated.circuit_model import SIMULATION_SEED, TRIALS
from bgmodel.fitting.simulated.error import PARTS, InParts
from bgmodel.integrators.sprt_theory import OVERSHOOT
from bgmodel.support.checks import whole
from bgmodel.support.compiling import compiled
from bgmodel.support.seeds import stream
from circuits.arrays import Array, Truths

INPUT = Parameter(
    "input", 0.0, 12.0, 1.0, "drift of every accumulator without evidence for it, 1/sqrt(s)"
)
FINE = 5
"""Parts of a bin, in each of which the survivors of the other accumulators are averaged."""


@dataclass(frozen=True)
class RaceModel(Model):
    """Independent accumulators of evidence; the first to reach the bound decides.

    Each has noise of variance 1/2 per second, so that differences have unit variance; first
    passages are inverse Gaussian (Wald 1947).
    """

    alternatives: int
    any_width: ClassVar = True
    threshold_name: ClassVar[str] = BOUND.name

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Sensitivity, common input, bound, and parameters of responses."""
        return (SENSITIVITY, INPUT, BOUND, *RESPONSE)

    def decided(self, values: Mapping[str, Array], strength: Array, grid: Grid) -> Array:
        """Return the probability of a wrong and of a correct decision; see ``algorithms.Model``."""
        ends_s = np.arange(FINE * grid.bins + 1) * grid.width_s / FINE
        bound, common = values[BOUND.name][:, None], values[INPUT.name][:, None]
        right = arrived(ends_s, common + (values[SENSITIVITY.name] * strength)[:, None], bound)
        wrong = arrived(ends_s, common, bound)
        others = self.alternatives - 1
        # By parts, the loss of a product of survivors is divided between its factors.
        correct = np.diff(right) * _middle((1 - wrong) ** others)
        errors = others * np.diff(wrong) * _middle((1 - right) * (1 - wrong) ** (others - 1))
        fine = np.stack([errors, correct], axis=1)
        return np.asarray(fine.reshape(len(strength), 2, grid.bins, FINE).sum(axis=3))

    def identity(self) -> dict[str, object]:
        """Return its name and the number of alternatives."""
        return {"model": "race", "alternatives": self.alternatives}


def _middle(survivors: Array) -> Array:
    """Return the survival probability of each part, the mean of its two ends, (cells, parts)."""
    return np.asarray((survivors[:, 1:] + survivors[:, :-1]) / 2)


def arrived(time_s: Array, drift: Array, bound: Array) -> Array:
    """Return the probability that an accumulator is at its bound by time_s, (cells, times)."""
    from scipy.special import log_ndtr, ndtr

    sd = np.sqrt(np.maximum(time_s, 1e-12) / 2)
    late = log_ndtr(-(bound + drift * time_s) / sd) + 4 * drift * bound
    return np.asarray(ndtr((drift * time_s - bound) / sd) + np.exp(late))


LEAK = Parameter("leak", 0.0, 15.0, 2.0, "rate at which accumulators leak, 1/s")
INHIBITION = Parameter("inhibition", 0.0, 15.0, 2.0, "inhibition by each other accumulator, 1/s")
HELD_INPUT = replace(INPUT, start=0.0, free=False)
"""Common input: fixed by default, since choices and times hardly distinguish it from the rates."""
FEWER = 4
"""Simulated trials of a circuit per trial of the accumulators, which are simulated anew for every
value of their parameters."""


@compiled
def leaky(
    noise: Any, parts: Any, drift: Any, common: Any, bound: Any, leak: Any, inhibition: Any,
    step_s: Any, mass: Any,
) -> None:  # fmt: skip
    """Add the share of trials that decide in each bin to ``mass`` (2, bins): wrong, correct.

    ``dx_i = (input_i - leak x_i - inhibition sum_(j != i) x_j) dt + noise``, and ``x_i >= 0``
    (Usher & McClelland 2001), by Euler's method. Crossings are interpolated between steps and
    divided between two bins, so that the mass is continuous in all parameters.
    """
    trials, steps, channels = noise.shape
    sd, bins = math.sqrt(step_s / 2), mass.shape[1]
    x = np.zeros(channels)
    counted = 0
    for trial in range(trials):
        if not parts[trial % len(parts)]:
            continue
        counted += 1
        x[:] = 0.0
        for step in range(min(steps, bins)):
            total, most, who, share = x.sum(), bound, -1, 0.0
            for i in range(channels):
                before = x[i]
                rate = common - leak * before - inhibition * (total - before)
                if i == 0:
                    rate += drift
                now = before + rate * step_s + sd * noise[trial, step, i]
                x[i] = max(now, 0.0)
                if now >= most:
                    most, who, share = now, i, (bound - before) / (now - before)
            if who >= 0:
                side = 1 if who == 0 else 0
                # The crossing is at step + share, the middles of bins half a bin later.
                place = max(step + share - 0.5, 0.0)
                low = int(place)
                mass[side, low] += 1 - (place - low)
                if low + 1 < bins:
                    mass[side, low + 1] += place - low
                break
    mass /= counted


@lru_cache(maxsize=2)
def increments(alternatives: int, trials: int, steps: int, seed: int) -> npt.NDArray[np.float32]:
    """Return the noise of all trials, (trials, steps, N), of unit variance."""
    rng = stream(seed, "lca", alternatives)
    return rng.standard_normal((trials, steps, alternatives), np.float32)


@dataclass(frozen=True)
class LcaModel(InParts):
    """Leaky competing accumulators (Usher & McClelland 2001)."""

    alternatives: int
    trials: int = TRIALS  # as for a circuit
    seed: int = SIMULATION_SEED
    seconds: float = 3.0  # length of a trial, s
    _parts: Truths = field(default_factory=lambda: np.ones(PARTS, dtype=np.bool_), repr=False)
    threshold_name: ClassVar[str] = BOUND.name

    def __post_init__(self) -> None:
        whole("trials", self.trials, FEWER * PARTS)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Sensitivity, common input, bound, leak, inhibition, and parameters of responses."""
        return (SENSITIVITY, HELD_INPUT, BOUND, LEAK, INHIBITION, *RESPONSE)

    def decided(self, values: Mapping[str, Array], strength: Array, grid: Grid) -> Array:
        """Return the probability of a wrong and of a correct decision; see ``algorithms.Model``."""
        drift = values[SENSITIVITY.name] * strength
        names = (INPUT.name, BOUND.name, LEAK.name, INHIBITION.name)
        settings = np.stack([drift, *(values[name] for name in names)], axis=1)
        steps = math.ceil(self.seconds / BIN_S)
        noise = increments(self.alternatives, self.trials // FEWER, steps, self.seed)
        probability = np.zeros((len(strength), 2, grid.bins))
        for setting in distinct(settings):
            one = np.zeros((2, grid.bins))
            v, common, bound, leak, inhibition = map(float, setting)
            # Steps miss crossings within them: the bound of the walk is that much lower.
            lower = max(bound - OVERSHOOT * math.sqrt(BIN_S / 2), 1e-3)
            leaky(noise, self._parts, v, common, lower, leak, inhibition, BIN_S, one)
            probability[(settings == setting).all(axis=1)] = one
        return probability

    def _part(self, parts: Truths) -> Self:
        return replace(self, _parts=parts)

    def identity(self) -> dict[str, object]:
        """Return all that its predictions depend on."""
        names = ("alternatives", "trials", "seed", "seconds")
        return {"model": "lca"} | {name: getattr(self, name) for name in names}
