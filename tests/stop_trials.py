"""Stop-signal trials of a user."""

import numpy as np
import pandas as pd


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
