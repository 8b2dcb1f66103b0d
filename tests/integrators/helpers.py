"""Shifts of OUT by edits, in spikes and in theory."""

import numpy as np
import pandas as pd

from bgmodel.integrators.steady import out_shift, steady_out

LAWS = {"exact": "table", "own_laws": "cells", "finite": "finite"}


def shifts(circuit, edited, log_odds, *, seed, trials):
    """Return the shift of OUT by each edit, nats, one row per edit and log odds.

    Measured in spikes (``value``, with the standard error ``se`` of trials paired by their noise),
    and that of the fixed point: algebraic (``exact``), with the cells' f-I laws (``own_laws``), and
    also with the noise of their finite number (``finite``).
    """
    out = np.log1p((circuit.channels - 1) * np.exp(-np.asarray(log_odds)))
    before = steady_out(circuit, log_odds, seed=seed, trials=trials)
    parts = []
    for name, table in edited.items():
        shift = steady_out(table, log_odds, seed=seed, trials=trials) - before
        theory = {law: out_shift(circuit, table, out, laws=laws) for law, laws in LAWS.items()}
        measured = {"value": shift.mean(axis=1), "se": shift.std(axis=1, ddof=1) / trials**0.5}
        parts.append(pd.DataFrame({"variant": name, **measured, **theory}))
    return pd.concat(parts, ignore_index=True)
