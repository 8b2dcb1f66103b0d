"""Models of decisions on known evidence: how they turn the readings so far into OUT.

A model has no noise here; that of a decision is added at each reading, the same for all models, see
``hazard``. The lowest OUT is the most favoured, as everywhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from bgmodel.evidence import minus_log_softmax
from bgmodel.fitting.known.accumulation import leaky_sums, runs_of_cues
from bgmodel.fitting.known.trials import KnownTrials
from bgmodel.fitting.parameters import Parameter
from bgmodel.support.arrays import Array

Values = Mapping[str, float]
GAIN = Parameter("gain", 0.0, 20.0, 1.0, "factor on the evidence")
LEAK = Parameter("leak_hz", 0.0, 20.0, 0.0, "rate at which sums of evidence decay", free=False)


class Outputs(Protocol):
    """OUT of a model on the readings of some trials."""

    def out(self, values: Values) -> Array:
        """Return OUT (runs, seen readings, alternatives) at values of the parameters.

        The readings of all trials that come before the response follow one another.
        """
        ...

    def parts(self) -> list[Outputs]:
        """Return the outputs without each simulated run in turn; empty without simulation."""
        ...


class KnownModel(Protocol):
    """A model of decisions on known evidence."""

    @property
    def name(self) -> str:
        """Its name."""
        ...

    @property
    def sign(self) -> int:
        """1 if thresholds are levels of OUT, -1 if they are levels of minus OUT."""
        ...

    def parameters(self, alternatives: int) -> tuple[Parameter, ...]:
        """Return its own parameters, the threshold and the noise among them."""
        ...

    def on(self, trials: KnownTrials, values: Values) -> Outputs:
        """Return its OUT on some trials; ``values`` are those of fixed parameters."""
        ...

    def identity(self) -> dict[str, Any]:
        """Return what it is, for provenance."""
        ...


@dataclass(frozen=True)
class Exact:
    """OUT computed from the readings of each trial, without simulation.

    Parameters
    ----------
    trials : KnownTrials
        The trials.
    model : Test, LeakySum or Runs
        The model.
    """

    trials: KnownTrials
    model: Test | LeakySum | Runs

    def out(self, values: Values) -> Array:
        """Return OUT (1, seen readings, alternatives)."""
        leak_hz = values.get(LEAK.name, 0.0) if self.model.sums else 0.0
        if leak_hz == 0:
            return self.model.of(self._without_leak, values)[None]
        sums = leaky_sums(*read(self.trials), leak_hz)
        return self.model.of(sums[self.trials.seen_places], values)[None]

    @cached_property
    def _without_leak(self) -> Array:
        """Sums without a leak, or lengths of runs, after each seen reading."""
        values, time_s = read(self.trials)
        found = leaky_sums(values, time_s) if self.model.sums else runs_of_cues(values)
        return np.asarray(found[self.trials.seen_places])

    def parts(self) -> list[Outputs]:
        """Return an empty list, since no run is simulated."""
        return []


def read(trials: KnownTrials) -> tuple[Array, Array]:
    """Return the readings before the response and their times; those after it are left out."""
    most = max(int(trials.seen.max()), 1)
    unread = np.arange(most) >= trials.seen[:, None]
    values = np.where(unread[:, :, None], 0.0, trials.log_likelihood[:, :most])
    return values, np.where(unread, np.inf, trials.time_s[:, :most])


@dataclass(frozen=True)
class Test:
    """The optimal test, MSPRT: OUT is minus the log posterior of each alternative.

    With two alternatives it stops at a difference of log-likelihoods, which only the ratio of
    threshold and gain determines: the gain is 1 unless it is freed.
    """

    name: str = "msprt"
    sign: int = 1
    sums: bool = True

    def parameters(self, alternatives: int) -> tuple[Parameter, ...]:
        """Return gain, leak (0 unless it is freed), threshold and noise."""
        top = float(np.log(alternatives))
        return (
            replace(GAIN, free=alternatives > 2),
            LEAK,
            Parameter("threshold", 1e-5, 1.5 * top, 0.3 * top, "OUT at a decision, nats"),
            Parameter("noise", 1e-5, 2 * top, 0.1 * top, "scale of the noise of OUT, nats"),
        )

    def of(self, sums: Array, values: Values) -> Array:
        """Return OUT, nats, from sums of readings (..., alternatives)."""
        return minus_log_softmax(values["gain"] * sums)

    def on(self, trials: KnownTrials, values: Values) -> Outputs:
        """Return its OUT on some trials."""
        return Exact(trials, self)

    def identity(self) -> dict[str, Any]:
        """Return its name."""
        return {"model": self.name}


@dataclass(frozen=True)
class LeakySum:
    """Leaky sums, compared with their mean: OUT is the mean of all sums minus that of each.

    The limit of strong, balanced leak and inhibition of the leaky competing accumulator
    (Bogacz & Gurney 2007), with a leak of the differences that remains. With two alternatives and
    no leak it decides as the MSPRT does, but for the noise. A factor on the evidence would only
    change the unit of threshold and noise, so there is no gain.
    """

    name: str = "leaky_sum"
    sign: int = -1
    sums: bool = True

    def parameters(self, alternatives: int) -> tuple[Parameter, ...]:
        """Return leak, threshold and noise."""
        return (
            Parameter("leak_hz", LEAK.low, LEAK.high, 0.5, LEAK.about),
            Parameter("threshold", 0.01, 100.0, 1.0, "lead over the mean at a decision, nats"),
            Parameter("noise", 0.001, 50.0, 0.3, "scale of the noise of the lead, nats"),
        )

    def of(self, sums: Array, values: Values) -> Array:
        """Return the mean minus each sum, nats, from sums of readings (..., alternatives)."""
        return np.asarray(sums.mean(axis=-1, keepdims=True) - sums)

    def on(self, trials: KnownTrials, values: Values) -> Outputs:
        """Return its OUT on some trials."""
        return Exact(trials, self)

    def identity(self) -> dict[str, Any]:
        """Return its name."""
        return {"model": self.name}


@dataclass(frozen=True)
class Runs:
    """A run of equal cues: OUT is minus the number of readings in a row that favour a side.

    Readings are not added up, and their strength has no effect.
    """

    name: str = "run"
    sign: int = -1
    sums: bool = False

    def parameters(self, alternatives: int) -> tuple[Parameter, ...]:
        """Return threshold and noise, in cues."""
        return (
            Parameter("threshold", 0.2, 50.0, 4.0, "length of the run at a decision, cues"),
            Parameter("noise", 0.02, 50.0, 0.5, "scale of the noise of that length, cues"),
        )

    def of(self, runs: Array, values: Values) -> Array:
        """Return minus the lengths of runs (..., alternatives)."""
        return -runs

    def on(self, trials: KnownTrials, values: Values) -> Outputs:
        """Return its OUT on some trials."""
        return Exact(trials, self)

    def identity(self) -> dict[str, Any]:
        """Return its name."""
        return {"model": self.name}


EXACT: dict[str, Test | LeakySum | Runs] = {
    each.name: each for each in (Test(), LeakySum(), Runs())
}
"""Models without simulation, by name."""
