"""Models of decisions on known evidence: how they turn the readings so far into OUT.

A model has no noise here; that of a decision is added at each reading, the same for all models, see
``hazard``. The lowest OUT is the most favoured, as everywhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from bgmodel.evidence import minus_log_softmax
from bgmodel.fitting.known.trials import KnownTrials
from bgmodel.fitting.parameters import Parameter
from circuits.arrays import Array

Values = Mapping[str, Array | float]
"""Parameters by name: a number, or one for each trial."""
GAIN = Parameter("gain", 0.0, 20.0, 1.0, "factor on the evidence")
LEAK = Parameter("leak_hz", 0.0, 20.0, 0.0, "rate at which sums of evidence decay", free=False)


def sizes(
    threshold: tuple[float, float, float], noise: tuple[float, float, float], what: str
) -> tuple[Parameter, Parameter]:
    """Return threshold and noise from their bounds and starts; they differ by factors."""
    return (
        Parameter("threshold", *threshold, f"{what}, at a decision", scale="log"),
        Parameter("noise", *noise, f"scale of the noise of {what}", scale="log"),
    )


def read(trials: KnownTrials) -> tuple[Array, Array]:
    """Return the readings before the response and their times; those after it are left out."""
    most = max(int(trials.seen.max()), 1)
    unread = np.arange(most) >= trials.seen[:, None]
    values = np.where(unread[:, :, None], 0.0, trials.log_likelihood[:, :most])
    return values, np.where(unread, np.inf, trials.time_s[:, :most])


def leaky_sums(log_likelihood: Array, time_s: Array, leak_hz: Array | float = 0.0) -> Array:
    """Return sums of readings that decay at ``leak_hz``, (trials, readings, alternatives), nats."""
    leak_hz = np.reshape(leak_hz, (-1, 1))
    if not leak_hz.any():
        return np.cumsum(log_likelihood, axis=1)
    known = np.where(np.isfinite(time_s), time_s, 0.0)
    kept = np.exp(-leak_hz * np.maximum(np.diff(known, axis=1, prepend=0.0), 0.0))
    sums = np.empty_like(log_likelihood)
    total = np.zeros(log_likelihood[:, 0].shape)
    for k in range(log_likelihood.shape[1]):
        total = total * kept[:, k, None] + log_likelihood[:, k]
        sums[:, k] = total
    return sums


def runs_of_cues(log_likelihood: Array) -> Array:
    """Return the number of readings in a row, up to each, that favour each alternative."""
    ordered = np.sort(log_likelihood, axis=2)
    clear = ordered[:, :, -1] > ordered[:, :, -2]
    favoured = (log_likelihood == ordered[:, :, -1:]) & clear[:, :, None]
    runs = np.zeros(log_likelihood.shape)
    length = np.zeros(log_likelihood[:, 0].shape)
    for k in range(log_likelihood.shape[1]):
        length = np.where(favoured[:, k], length + 1, 0.0)
        runs[:, k] = length
    return runs


@dataclass(frozen=True)
class ExactModel:
    """A model whose OUT is computed from the readings of each trial, without simulation."""

    name: ClassVar[str]
    sign: ClassVar[int] = -1
    """1 if thresholds are levels of OUT, -1 if they are levels of minus OUT."""
    sums: ClassVar[bool] = True
    """Whether readings are added up; otherwise runs of them are counted."""

    def parameters(self, alternatives: int) -> tuple[Parameter, ...]:
        """Return its own parameters, the threshold and the noise among them."""
        raise NotImplementedError

    def of(self, state: Array, gain: Array) -> Array:
        """Return OUT from sums of readings, or from lengths of runs, (..., alternatives)."""
        raise NotImplementedError

    def on(self, trials: KnownTrials, values: Mapping[str, float]) -> Exact:
        """Return its OUT on some trials."""
        return Exact(trials, self)


@dataclass(frozen=True)
class Exact:
    """OUT computed from the readings of each trial."""

    trials: KnownTrials
    model: ExactModel

    def out(self, values: Values) -> Array:
        """Return OUT (1, seen readings, alternatives), all trials' readings concatenated."""
        leak_hz = values.get(LEAK.name, 0.0) if self.model.sums else 0.0
        state = self._without_leak
        if np.any(leak_hz):
            state = leaky_sums(*read(self.trials), leak_hz)[self.trials.seen_places]
        gain = values.get(GAIN.name, 1.0) + np.zeros(self.trials.trials)
        return self.model.of(state, gain[self.trials.seen_places[0], None])[None]

    @cached_property
    def _without_leak(self) -> Array:
        """Sums without a leak, or lengths of runs, after each seen reading."""
        values, time_s = read(self.trials)
        states = leaky_sums(values, time_s) if self.model.sums else runs_of_cues(values)
        return np.asarray(states[self.trials.seen_places])

    def parts(self) -> list[Self]:
        """Return an empty list, since no run is simulated."""
        return []


@dataclass(frozen=True)
class Test(ExactModel):
    """The optimal test, MSPRT: OUT is minus the log posterior of each alternative.

    With two alternatives and no noise the gain only moves the threshold: it is 1 by default.
    """

    name: ClassVar[str] = "msprt"
    sign: ClassVar[int] = 1

    def parameters(self, alternatives: int) -> tuple[Parameter, ...]:
        """Return gain, leak (0 unless it is freed), threshold and noise."""
        top = float(np.log(alternatives))
        return (
            replace(GAIN, free=alternatives > 2),
            LEAK,
            *sizes((1e-5, 1.5 * top, 0.3 * top), (1e-5, 2 * top, 0.1 * top), "OUT, nats"),
        )

    def of(self, state: Array, gain: Array) -> Array:
        """Return OUT, nats, from sums of readings (..., alternatives)."""
        return minus_log_softmax(gain * state)


@dataclass(frozen=True)
class LeakySum(ExactModel):
    """Leaky sums, compared with their mean: OUT is the mean of all sums minus that of each.

    The limit of strong, balanced leak and inhibition (Bogacz & Gurney 2007).
    """

    name: ClassVar[str] = "leaky_sum"

    def parameters(self, alternatives: int) -> tuple[Parameter, ...]:
        """Return leak, threshold and noise."""
        leak = replace(LEAK, start=0.5, free=True)
        return leak, *sizes((0.01, 100.0, 1.0), (0.001, 50.0, 0.3), "the lead over the mean, nats")

    def of(self, state: Array, gain: Array) -> Array:
        """Return the mean minus each sum, nats, from sums of readings (..., alternatives)."""
        return np.asarray(state.mean(axis=-1, keepdims=True) - state)


@dataclass(frozen=True)
class Runs(ExactModel):
    """A run of equal cues: OUT is minus the number of readings in a row that favour a side."""

    name: ClassVar[str] = "run"
    sums: ClassVar[bool] = False

    def parameters(self, alternatives: int) -> tuple[Parameter, ...]:
        """Return threshold and noise, in cues."""
        return sizes((0.2, 50.0, 4.0), (0.02, 50.0, 0.5), "the length of the run, cues")

    def of(self, state: Array, gain: Array) -> Array:
        """Return minus the lengths of runs (..., alternatives)."""
        return -state


EXACT: dict[str, ExactModel] = {each.name: each for each in (Test(), LeakySum(), Runs())}
"""Models without simulation, by name."""
