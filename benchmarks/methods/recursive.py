"""The recursive MSPRT: evidence recirculates through cortex, basal ganglia and thalamus."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from bgmodel.deciding.readout import ReadOut
from bgmodel.deciding.trace import Trace
from bgmodel.evidence import Evidence, check_evidence
from bgmodel.integrators.sprt import at_readings
from bgmodel.support.checks import whole

LOOP_READINGS = 3
"""Delay of the loop, readings: one each to basal ganglia, thalamus and cortex."""


@dataclass(frozen=True)
class RecursiveMsprt:
    """The rMSPRT of Caballero, Humphries & Gurney (2018), in readings.

    Cortex sums the log likelihoods of its last readings and adds the feedback from thalamus; basal
    ganglia subtract from cortex's mean, which gives thalamus; each step takes one reading::

        cortex_i(t)   = y_i(the last readings) + thalamus_i(t - 1) + baseline
        OUT_i(t)      = -cortex_i(t - 1) + ln sum_j exp cortex_j(t - 1)
        thalamus_i(t) = feedback mean_j cortex_j(t - 1) - OUT_i(t - 1)

    Input common to all channels cancels in OUT, and cortex's own activity returns after three
    readings. If cortex sums three readings, each counts once, and OUT is the MSPRT's delayed by one
    reading; if it sums more or fewer, readings count more than once or are lost.

    Parameters
    ----------
    window : int, optional
        Readings that cortex sums; all of them if None.
    loop : bool
        Whether there is feedback from thalamus.
    baseline : float, nats
        Drive of cortex; OUT does not depend on it.
    feedback : float
        Weight of cortex's mean in thalamus; nor on it.
    """

    window: int | None = LOOP_READINGS
    loop: bool = True
    baseline: float = 15.0
    feedback: float = 0.4

    def __post_init__(self) -> None:
        if self.window is not None:
            whole("window", self.window, 1)

    def run(self, evidence: Evidence) -> Trace:
        """Return OUT as a trace (trials, 1 + steps, hypotheses); the prior is its first reading."""
        summed = total = check_evidence(evidence).totals
        if self.window is not None and self.window < total.shape[1]:
            summed = total.copy()
            summed[:, self.window :] -= total[:, : -self.window]
        out = np.empty_like(total)
        # What each part said a reading ago; at first nothing.
        cortex = thalamus = said = np.zeros_like(total[:, 0])
        for t in range(total.shape[1]):
            out[:, t] = logsumexp(cortex, axis=1, keepdims=True) - cortex
            back = thalamus if self.loop else 0.0
            thalamus = self.feedback * cortex.mean(axis=1, keepdims=True) - said
            cortex, said = summed[:, t] + back + self.baseline, out[:, t]
        return at_readings(out, evidence, ReadOut("the recursive MSPRT", lowest=0.0))
