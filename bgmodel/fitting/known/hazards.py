"""The fit per reading: how many of the trials still running end after each reading."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from bgmodel.fitting.known.trials import intervals
from bgmodel.support.arrays import Array

if TYPE_CHECKING:
    import pandas as pd

FEWEST = 10
"""Readings that fewer trials reach are left out."""


def hazards(likelihood: Any, vector: Array) -> pd.DataFrame:
    """Return the share of running trials that respond after each reading and before the next.

    Each interval between readings is shifted by the mean non-decision time. The model's share is
    the mean of its probabilities in the same trials, each given that it has not responded before;
    ``standard_error`` is that of the observed share under the model. Empty without times.
    """
    import pandas as pd

    values, trials = likelihood.values(vector), likelihood.trials
    starts, ends = (each + values["t0_s"] for each in intervals(trials))
    before, after = (likelihood.answered(values, each).sum(axis=2) for each in (starts, ends))
    every = np.clip((after - before) / np.maximum(1 - before, 1e-12), 0.0, 1.0)
    rows = []
    for k in range(starts.shape[1] if trials.timed else 0):
        running = (k < trials.seen) & (trials.until_s >= starts[:, k])
        if running.sum() < FEWEST:
            continue
        share, ended = every[running, k], (trials.until_s < ends[:, k])[running]
        error = float(np.sqrt((share * (1 - share)).sum())) / int(running.sum())
        rows.append((k + 1, int(running.sum()), ended.mean(), share.mean(), error))
    names = ["reading", "running", "observed", "predicted", "standard_error"]
    return pd.DataFrame(rows, columns=names)
