"""The fit per reading: how many of the trials still running end after each reading."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bgmodel.fitting.known.models import Values
from bgmodel.fitting.known.trials import intervals
from bgmodel.support.arrays import Array, Truths

if TYPE_CHECKING:
    import pandas as pd

    from bgmodel.fitting.known.likelihood import KnownLikelihood

FEWEST = 10
"""Readings that fewer trials reach are left out."""


def hazards(likelihood: KnownLikelihood, vector: Array) -> pd.DataFrame:
    """Return the share of running trials that respond after each reading and before the next.

    Each interval between readings is shifted by the mean non-decision time. The model's share is
    the mean of its probabilities in the same trials, each given that it has not responded before.

    Parameters
    ----------
    likelihood : KnownLikelihood
        Model and data.
    vector : array (parameters,)
        Free parameters.

    Returns
    -------
    DataFrame
        Columns reading (from 1), running (number of trials), observed, predicted, and
        standard_error of the observed share under the model.
    """
    import pandas as pd

    values, trials = likelihood.values(vector), likelihood.trials
    rt_s = np.where(np.isfinite(trials.rt_s), trials.rt_s, np.inf)
    starts, ends = (each + values["t0_s"] for each in intervals(trials))
    by = _Answered(likelihood, values)
    rows = []
    for k in range(starts.shape[1]):
        running = (k < trials.seen) & (rt_s >= starts[:, k])
        if running.sum() < FEWEST:
            continue
        before, after = by(starts[:, k], running), by(ends[:, k], running)
        share = np.clip((after - before) / np.maximum(1 - before, 1e-12), 0.0, 1.0)
        ended = (rt_s < ends[:, k])[running]
        error = float(np.sqrt((share * (1 - share)).sum())) / int(running.sum())
        rows.append((k + 1, int(running.sum()), ended.mean(), share.mean(), error))
    names = ["reading", "running", "observed", "predicted", "standard_error"]
    return pd.DataFrame(rows, columns=names)


class _Answered:
    """The probability of a response by a time in each trial, under a model."""

    def __init__(self, likelihood: KnownLikelihood, values: Values) -> None:
        self.values, self.span_s = values, likelihood.trials.span_s
        trials = likelihood.trials
        shape = (trials.trials, max(int(trials.seen.max()), 1))
        self.mass, self.at_s = np.zeros(shape), np.zeros(shape)
        self.mass[trials.seen_places] = likelihood.decisions(values)[0].sum(axis=1)
        self.at_s[trials.seen_places] = trials.seen_s

    def __call__(self, by_s: Array, chosen: Truths) -> Array:
        """Return the probability by a time (trials,) in some trials."""
        from scipy.special import ndtr

        lag = by_s[chosen, None] - self.at_s[chosen] - self.values["t0_s"]
        decided = (self.mass[chosen] * ndtr(lag / self.values["t0_sd_s"])).sum(axis=1)
        lapsed = np.clip(by_s[chosen] / self.span_s, 0.0, 1.0)
        share = self.values["lapse"]
        return np.asarray((1 - share) * decided + share * lapsed)
