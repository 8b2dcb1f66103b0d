"""Baseline models: integrators that combine the same evidence in other ways than the MSPRT.

Each is a linear integrator of the summed log-likelihoods ``Y_i`` with its own stopping rule; OUT
is minus the quantity that is compared with the threshold, so the lowest OUT is the most favoured.
A baseline model is a class with ``run`` and ``needs_zero``, and one line in ``BASELINES``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from bgmodel.deciding.trace import Trace
from bgmodel.evidence import Evidence, check_evidence
from bgmodel.integrators.sprt import at_readings
from bgmodel.support.checks import check_positive, check_range
from circuits.arrays import Array


class Baseline(Protocol):
    """An integrator that is compared with the MSPRT on the same evidence."""

    needs_zero: ClassVar[bool]
    """Whether a zero of its evidence must mean "no information": true of a model that adds up
    terms common to the hypotheses of a reading."""

    def run(self, evidence: Evidence) -> Trace:
        """Return OUT as a trace (trials, 1 + steps, hypotheses); tick 0 is the prior."""
        ...


@dataclass(frozen=True)
class Race:
    """Independent accumulators: stop when one total is high enough (Vickers 1970).

    ``OUT_i = -Y_i``. A constant common to the hypotheses of a reading cancels in rules that
    compare accumulators, but not here: a zero must mean no evidence, as
    in ``separated_evidence``.
    """

    needs_zero: ClassVar[bool] = True

    def run(self, evidence: Evidence) -> Trace:
        """Return -Y as a trace (trials, 1 + steps, hypotheses)."""
        totals = check_evidence(evidence).totals
        return at_readings(-totals - np.log(evidence.hypotheses), evidence)


@dataclass(frozen=True)
class MaxVsAverage:
    """Stop when one total is far enough above the mean of all.

    ``OUT_i = mean_j Y_j - Y_i``: the limit of balanced, strong leak and inhibition
    (Bogacz & Gurney 2007).
    """

    needs_zero: ClassVar[bool] = False

    def run(self, evidence: Evidence) -> Trace:
        """Return mean Y - Y as a trace (trials, 1 + steps, hypotheses)."""
        total = check_evidence(evidence).totals
        return at_readings(total.mean(axis=2, keepdims=True) - total, evidence)


@dataclass(frozen=True)
class MaxVsNext:
    """Stop when the highest total is far enough above the second (McMillen & Holmes 2006).

    ``OUT_i = max_{j != i} Y_j - Y_i``: the limit of the MSPRT at high gain.
    """

    needs_zero: ClassVar[bool] = False

    def run(self, evidence: Evidence) -> Trace:
        """Return the highest other total minus Y as a trace (trials, 1 + steps, hypotheses)."""
        total = check_evidence(evidence).totals
        top = np.sort(total, axis=2)[:, :, -2:]
        leads = total == top[:, :, 1:]
        return at_readings(np.where(leads, top[:, :, :1], top[:, :, 1:]) - total, evidence)


@dataclass(frozen=True)
class Lca:
    """Leaky competing accumulators without a floor (Usher & McClelland 2001), solved exactly.

    ``dx_i/dt = input_i - leak x_i - inhibition sum_{j != i} x_j``, with each reading held as input
    until the next, and ``OUT_i = -x_i``. It starts at 0, whatever the prior. If leak and inhibition
    are equal (100 and 100 per second in Bogacz & Gurney 2007), differences between the accumulators
    do not leak; their common part leaks fast but does not cancel.
    """

    needs_zero: ClassVar[bool] = True
    leak_hz: float = 100.0
    inhibition_hz: float = 100.0

    def __post_init__(self) -> None:
        check_range(0, np.inf, leak_hz=self.leak_hz, inhibition_hz=self.inhibition_hz)

    def run(self, evidence: Evidence) -> Trace:
        """Return -x as a trace (trials, 1 + steps, hypotheses)."""
        n, step_s = check_evidence(evidence).hypotheses, evidence.step_ms / 1000
        readings = np.asarray(evidence.log_likelihood, dtype=np.float64)
        common = readings.mean(axis=2, keepdims=True)
        # The mean and the differences from it are the two modes of the matrix.
        together = _leaky(common, (self.leak_hz + (n - 1) * self.inhibition_hz) * step_s)
        apart = _leaky(readings - common, (self.leak_hz - self.inhibition_hz) * step_s)
        return at_readings(-(together + apart), evidence)


@dataclass(frozen=True)
class LinearGpe:
    """The MSPRT circuit with a GPe that is linear in STN output (Bogacz & Gurney 2007).

    GPe is ``a Sigma`` where the MSPRT requires ``Sigma - ln Sigma``; the STN output Sigma then
    solves ``a Sigma + ln Sigma = ln sum_j exp y_j``, by Wright's omega function, and
    ``OUT_i = Sigma - y_i``. Terms common to all channels do not cancel. In their figure 3 the slope
    a is 1, or 0.84 if evidence is scaled by 0.4.
    """

    needs_zero: ClassVar[bool] = True
    gain: float = 1.0
    slope: float = 1.0

    def __post_init__(self) -> None:
        check_positive(gain=self.gain, slope=self.slope)

    def run(self, evidence: Evidence) -> Trace:
        """Return Sigma - y as a trace (trials, 1 + steps, hypotheses)."""
        from scipy.special import logsumexp, wrightomega

        y = self.gain * (check_evidence(evidence).totals + np.log(evidence.hypotheses))
        sigma = wrightomega(logsumexp(y, axis=2) + np.log(self.slope)) / self.slope
        return at_readings(sigma[:, :, None] - y, evidence)


BASELINES: dict[str, type[Baseline]] = {
    "race": Race,
    "LCA": Lca,
    "max vs average": MaxVsAverage,
    "max vs next": MaxVsNext,
}
"""The baseline models by name."""


def baselines_on(zero_is_nothing: bool) -> list[str]:
    """Return the baseline models that apply: some need a zero to mean no evidence."""
    return [name for name, model in BASELINES.items() if zero_is_nothing or not model.needs_zero]


def _leaky(readings: Array, decay: float) -> Array:
    """Return ``dx/dt = input - decay x`` after each reading, time in readings; first tick 0."""
    # Importing scipy.signal takes a third of a second: only when it is used.
    from scipy.signal import lfilter

    share = 1.0 if decay == 0 else -np.expm1(-decay) / decay
    x = lfilter([share], [1.0, -np.exp(-decay)], readings, axis=1)
    return np.concatenate([np.zeros_like(x[:, :1]), x], axis=1)
