"""Choices and times from a circuit whose evidence is proportional to the difference of values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.decision import Decision
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.support.arrays import Array, Integers
from bgmodel.support.checks import check_positive, reals, whole
from bgmodel.support.seeds import stream
from circuits.errors import require


@dataclass(frozen=True)
class ValueCircuit:
    """A circuit of two channels that receives noisy readings of two values.

    A reading of channel i is ``x_i = d' V_i / difference`` plus normal noise of unit variance, and
    its evidence ``d' x_i``: the exact log-likelihood if values differ by ``difference``. The drift
    of the evidence is proportional to the difference of values, and its noise constant.
    """

    model: BasalGanglia  # any engine that has times
    posterior: float = 0.85
    difference: float = 0.6  # of values, at which readings are scaled correctly: 0.8 - 0.2
    d_prime: float = 0.5  # of one reading at that difference
    step_ms: float = 40.0  # between readings
    t_max: int = 120  # readings, after which the response is forced
    seed: int = 0

    def __post_init__(self) -> None:
        must = "must have times: population, rate or a spiking engine"
        require(self.model.engine.timed, "model", must, self.model.engine.id)
        two = "must be a circuit of two channels"
        require(self.model.circuit.channels == 2, "model", two, self.model.circuit.channels)
        check_positive(difference=self.difference, d_prime=self.d_prime, step_ms=self.step_ms)
        whole("t_max", self.t_max, 1)
        self.model.warn_of_noise(self.model.threshold(None, self.posterior))

    def evidence(self, values: npt.ArrayLike, number: int = 0) -> Evidence:
        """Return the evidence of trials with values (trials, 2).

        Each block ``number`` has its own noise. The truth is the larger value, action 1 if they are
        equal.
        """
        pairs = np.asarray(reals("values", values), dtype=np.float64)
        require(
            pairs.ndim == 2 and pairs.shape[1] == 2, "values", "must be (trials, 2)", pairs.shape
        )
        rng = stream(self.seed, "values", number)
        noise = rng.standard_normal((len(pairs), self.t_max, 2))
        mean = self.d_prime * (pairs - pairs.mean(axis=1, keepdims=True)) / self.difference
        nats = self.d_prime * (mean[:, None, :] + noise)
        return Evidence(
            nats,
            (pairs[:, 1] >= pairs[:, 0]).astype(np.intp),
            step_ms=self.step_ms,
            numbers=number * len(pairs) + np.arange(len(pairs)),
            baseline=0.0,
        )

    def decide(self, values: npt.ArrayLike, number: int = 0) -> Decision:
        """Return the decisions of the circuit; each block has its own noise in the circuit as well.

        Posteriors are not compared with the proportion correct: readings are likelihoods only if
        values differ by ``difference``.
        """
        evidence = self.evidence(values, number)
        level = self.model.threshold(None, self.posterior)
        return self.model.unadapted.decided(evidence, level, first_trial=number * evidence.trials)

    def __call__(self, values: Array, number: int) -> tuple[Integers, Array]:
        """Choose in one trial of every run of ``play``; return choices and times, ms."""
        decision = self.decide(values, number)
        return decision.choice, np.asarray(decision.time_ms, dtype=np.float64)
