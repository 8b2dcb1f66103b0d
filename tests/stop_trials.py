"""Stop-signal trials: the table of a user, and a race of known times."""

import numpy as np
import pandas as pd

from bgmodel.stopping.task import walk
from bgmodel.stopping.trials import StopTrials


def table_of(people=4, trials=120):
    """Return a user's table of stop-signal trials, in seconds; SSRT is 0.2 s."""
    rng = np.random.default_rng(1)
    parts = []
    for who in range(people):
        go = 0.3 + rng.gamma(3.0, 0.05, trials)
        ssd = np.where(rng.random(trials) < 0.4, rng.choice([0.1, 0.2, 0.3], trials), np.nan)
        rt = np.where(go < np.nan_to_num(ssd + 0.2, nan=9), go, np.nan)
        right = np.where(rng.random(trials) < 0.95, "left", "right").astype(object)
        right[np.isnan(rt)] = None
        parts.append(pd.DataFrame({"participant_id": f"p{who}", "rt": rt, "ssd": ssd,
                                   "stimulus": "left", "response": right}))  # fmt: skip
    return pd.concat(parts, ignore_index=True)


def walked(seed, go=300, stops=100, ssrt_ms=220.0, sd_ms=20.0, scale_ms=50.0, jitter_ms=0.0):
    """Return an independent race with two staircases; delays may be late as a screen's are."""
    rng = np.random.default_rng(seed)
    times = 380 + rng.gamma(2.0, scale_ms, go + stops)
    ssd, steps = np.full(go + stops, np.nan), np.arange(0.0, 1001.0, 50.0)
    stop = np.sort(rng.choice(go + stops, stops, replace=False))
    responded = times[stop] <= steps[:, None] + rng.normal(ssrt_ms, sd_ms, stops)
    index = walk(responded, steps, [200.0, 300.0])
    ssd[stop] = steps[index] + jitter_ms * rng.uniform(0.02, 1, stops)
    times[stop[~responded[index, np.arange(stops)]]] = np.nan
    return StopTrials(times, ssd)
