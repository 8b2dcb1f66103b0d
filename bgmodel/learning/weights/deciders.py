"""Deciders: how features and weights become choices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from bgmodel.evidence import minus_log_softmax
from bgmodel.learning.weights.features import Features
from bgmodel.support.arrays import Array, Integers
from bgmodel.support.checks import check_flag, check_positive, check_range, whole

TIE = 1e-9
"""Size of the noise that breaks ties of drives, nats."""


@dataclass(frozen=True)
class Trials:
    """Trials of every run in one trial."""

    last: Integers  # (runs,), index of the last reading before the choice
    choice: Integers  # (runs,)
    drive: Array  # (runs, hypotheses), nats, by the readings up to the last one
    read_out: Array  # (runs,), posterior of the choice as read from OUT


class Decider(Protocol):
    """Turns features and weights into choices, for several runs at once."""

    @property
    def criterion(self) -> float:
        """Posterior at which it decides."""
        ...

    @property
    def gain(self) -> float:
        """Nats of drive per nat of evidence, kappa."""
        ...

    def choose(
        self, part: Features, weights: Array, criterion: Array, noise: Array, number: int
    ) -> Trials:
        """Choose in trial ``number`` of every run; ``part`` holds one trial per run.

        ``weights`` is (runs, hypotheses, units), ``criterion`` a posterior, (runs,), and ``noise``
        standard normal, (runs, hypotheses + 1).
        """
        ...


@dataclass(frozen=True)
class FixedPoint:
    """The circuit's fixed point: ``OUT = -ln softmax(gain sum_t w . phi_t)``, without dynamics."""

    criterion: float = 0.9
    """Posterior at which a trial stops; otherwise it ends with its last reading."""
    gain: float = 1.0
    """Nats of drive per nat of evidence."""
    sampled: int | None = None
    """Number of readings, if this is fixed and there is no criterion."""
    drawn: bool = False
    """Whether the choice is drawn from the posterior, as REINFORCE assumes; otherwise it is the
    leader."""
    read_out_sd_nats: float = 0.0
    """Standard deviation of noise on the OUT that critics read, nats."""

    def __post_init__(self) -> None:
        check_range(0, 1, criterion=self.criterion)
        check_positive(gain=self.gain)
        check_range(0, np.inf, read_out_sd_nats=self.read_out_sd_nats)
        check_flag("drawn", self.drawn)
        if self.sampled is not None:
            whole("sampled", self.sampled, 1)

    def choose(
        self, part: Features, weights: Array, criterion: Array, noise: Array, number: int
    ) -> Trials:
        """Choose at the first reading at which a posterior reaches the criterion."""
        runs = np.arange(len(weights))
        drive = self.gain * np.cumsum(part.values @ weights.swapaxes(1, 2), axis=1)
        out = minus_log_softmax(drive)
        last = part.readings - 1
        if self.sampled is None:
            reached = out.min(axis=2) <= -np.log(criterion)[:, None]
            last = np.where(reached.any(axis=1), reached.argmax(axis=1), last)
        else:
            last = np.minimum(last, self.sampled - 1)
        heard, read = drive[runs, last], out[runs, last]
        choice = (heard + self._disturbance(noise[:, :-1])).argmax(axis=1)
        nats = read[runs, choice] + self.read_out_sd_nats * noise[:, -1]
        return Trials(last, choice, heard, np.exp(-nats))

    def _disturbance(self, noise: Array) -> Array:
        """Return noise on the drives (runs, hypotheses) whose leader is the choice, nats."""
        if not self.drawn:
            return TIE * noise
        from scipy.special import log_ndtr

        # The leader of drives with Gumbel noise is a draw from their softmax.
        return np.asarray(-np.log(-log_ndtr(noise)))
