"""Log likelihood and BIC of a fit on known evidence, corrected for simulated runs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bgmodel.fitting.known.optimum import KnownOptimum
from bgmodel.fitting.simulation import jackknifed


@dataclass(frozen=True)
class Score:
    """The log likelihood of a model, corrected for its simulated runs.

    Parameters
    ----------
    log_likelihood : float, nats
        Corrected for the bias due to a finite number of runs (jackknife; Quenouille 1956).
    error : float, nats
        Standard error due to the runs; 0 for models that are computed.
    bic : float
        Bayesian information criterion (Schwarz 1978): -2 log likelihood + parameters x ln trials.
    """

    log_likelihood: float
    error: float
    bic: float

    @property
    def log_evidence(self) -> float:
        """Approximate log marginal likelihood, -BIC / 2, nats."""
        return -self.bic / 2


def score_of(optimum: KnownOptimum) -> Score:
    """Return the score of the maximum of a likelihood."""
    found = optimum.log_likelihood
    parts = np.array([each(optimum.vector) for each in optimum.likelihood.without_parts()])
    if len(parts):
        found += (len(parts) - 1) * (found - float(parts.mean()))
    count, trials = len(optimum.vector), optimum.likelihood.trials.trials
    return Score(found, float(jackknifed(parts)), count * np.log(trials) - 2 * found)
