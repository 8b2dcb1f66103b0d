"""Comparison of models on known evidence: Bayes factors, and the trials that they need."""

from __future__ import annotations

from collections.abc import Mapping
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bgmodel.support.arrays import Array

if TYPE_CHECKING:
    import pandas as pd

    from bgmodel.fitting.known.fit import KnownFit

STRONG_NATS = 3.0
"""Log Bayes factor, 20 to 1, from which a model is preferred (Kass & Raftery 1995)."""
SURE = NormalDist().inv_cdf(0.95)
UNKNOWN = "cannot tell"


def compared(fits: Mapping[str, KnownFit]) -> pd.DataFrame:
    """Return a table of models, the best first.

    Columns model, log_likelihood (corrected for the bias of simulated runs), simulation_error,
    parameters, bic, log_bayes_factor (of the best model over this one, -difference of BIC / 2),
    low (that minus 1.64 times the simulation error of both), nats_per_reading (log likelihood
    relative to the best model, per reading before the response).
    """
    from bgmodel.support.tables import Readable

    scores = {name: fit.score for name, fit in fits.items()}
    best = max(scores, key=lambda name: scores[name].log_evidence)
    rows = []
    for name in sorted(scores, key=lambda name: -scores[name].log_evidence):
        own, likelihood = scores[name], fits[name].optimum.likelihood
        factor = scores[best].log_evidence - own.log_evidence
        error = SURE * float(np.hypot(own.error, scores[best].error))
        apart = own.log_likelihood - scores[best].log_likelihood
        rows.append(
            {
                "model": name,
                "log_likelihood": own.log_likelihood,
                "simulation_error": own.error,
                "parameters": len(likelihood.freedom.names),
                "bic": own.bic,
                "log_bayes_factor": factor,
                "low": factor if name == best else factor - error,
                "nats_per_reading": apart / max(int(likelihood.trials.seen.sum()), 1),
            }
        )
    return Readable(rows)


def verdict(table: pd.DataFrame) -> str:
    """Return the preferred model of a table of ``compared``, or "cannot tell".

    A model is preferred if its log Bayes factor over every other exceeds 3 nats (20 to 1), the
    simulation error included.
    """
    others = table["low"].to_numpy()[1:]
    return str(table["model"].iloc[0]) if (others > STRONG_NATS).all() else UNKNOWN


def trials_needed(
    log_ratio: npt.ArrayLike, more_parameters: int = 0, *, least: float = STRONG_NATS
) -> float:
    """Return the number of trials at which a true model is preferred with probability 0.95.

    Parameters
    ----------
    log_ratio : array (trials,), nats
        Log likelihood of each trial under the true model minus that under a rival, both at the
        parameters that fit many trials best.
    more_parameters : int
        Parameters of the true model minus those of the rival.
    least : float, nats
        Log Bayes factor to be exceeded.

    Returns
    -------
    float
        Infinite if the mean is not above 0 by two standard errors: the two are not told apart.

    Notes
    -----
    The sum over n trials is about Gaussian with mean n m and standard deviation s sqrt(n); BIC
    subtracts k ln(n) / 2. The answer is the least n with
    ``n m - 1.64 s sqrt(n) - k ln(n) / 2 >= least``.
    """
    values = np.asarray(log_ratio, dtype=np.float64)
    mean, spread = float(values.mean()), float(values.std(ddof=1))
    if mean <= 2 * spread / np.sqrt(len(values)):
        return np.inf
    count: Array = np.unique(np.round(np.geomspace(10, 1e6, 4000)))
    sure = mean * count - SURE * spread * np.sqrt(count) - more_parameters * np.log(count) / 2
    enough = count[sure >= least]
    return float(enough[0]) if len(enough) else np.inf
