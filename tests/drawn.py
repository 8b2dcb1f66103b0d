"""Choices and times: given, or drawn from a model's own densities; an ideal integrator."""

from dataclasses import replace

import numpy as np
import pandas as pd

from bgmodel.deciding.trace import Trace
from bgmodel.evidence import minus_log_softmax
from bgmodel.fitting.responses import BIN_S, Grid, responded
from bgmodel.support.seeds import stream
from bgmodel.trials.record import Trials

GAIN = 2.0
"""Nats of log odds per unit of evidence of the ideal integrator."""
TRUTH = {"t0_s": 0.3, "t0_sd_s": 0.05, "lapse": 0.01}


def drawn(
    model, strengths, trials, seed, *, seconds=4.0, deadline_s=None, alternatives=2, **values
):
    """Return a number of trials at each strength, from a seed.

    Of two alternatives, half of the strengths have the other sign.
    """
    strengths = np.asarray(strengths, float)
    grid = Grid(round((deadline_s or seconds) / BIN_S))
    every = {k: np.full(len(strengths), v) for k, v in {**TRUTH, **values}.items()}
    decided = model.decided(every, strengths, grid)
    response = {name: every[name] for name in TRUTH}
    density = responded(decided, grid, **response, alternatives=alternatives)
    rng = stream(seed, "drawn")
    rows = []
    for strength, one in zip(strengths, density, strict=True):
        below = one.ravel().cumsum() * BIN_S
        most = 1.0 if deadline_s else below[-1]
        place = np.searchsorted(below, most * rng.random(trials), side="right")
        none = place >= len(below)
        response, bins = np.divmod(np.where(none, 0, place), grid.bins)
        rt = (bins + rng.random(trials)) * BIN_S
        sign = np.where((alternatives == 2) & (np.arange(trials) % 2 == 1), -1, 1)
        rt, response = np.where(none, np.nan, rt), np.where(sign < 0, 1 - response, response)
        rows.append(np.stack([rt, np.where(none, -1, response), sign * strength]))
    rt, response, signed = np.concatenate(rows, axis=1)
    who, none = np.full(len(rt), "all"), pd.DataFrame(index=range(len(rt)))
    response = response.astype(np.int8)
    return Trials(who, rt, response, signed, none, deadline_s, alternatives=alternatives)


def rows_of(some, **columns):
    """Return trials as a user's table."""
    table = {"rt": some.rt_s, "response": some.response.astype(int), "strength": some.strength}
    return pd.DataFrame(table).assign(**columns)


def with_drift(at_rest, bound, time_s, drift, start=0.0, drift_sd=0.0):
    """Return the densities of both responses at drifts, (cells, 2, times); see ``binned``."""
    v, c = np.asarray(drift, float)[:, None, None], np.stack([-bound - start, bound - start])
    spread = 1 + drift_sd**2 * time_s
    weight = np.exp((2 * v * c + drift_sd**2 * c**2 - v**2 * time_s) / (2 * spread))
    return weight / np.sqrt(spread) * at_rest


def choices(strength, response, rt_s=None, deadline_s=None, **conditions):
    """Return choices of one participant; response -1 is a miss."""
    response = np.asarray(response, np.int8)
    rt = np.where(response < 0, np.nan, 0.5 if rt_s is None else rt_s)
    strength = None if strength is None else np.asarray(strength, float)
    more = pd.DataFrame(conditions, index=range(len(response)))
    return Trials(np.full(len(response), "a"), rt, response, strength, more, deadline_s)


def ideal(read, first):
    """Return OUT of an integrator without noise or delay, as ``crossings.Run`` asks for it."""
    time_ms = (np.arange(read.shape[1]) + 1) * 1000 * BIN_S
    return Trace(minus_log_softmax(GAIN * read), time_ms, step_ms=1000 * BIN_S)


def slowed(some, seed, share=0.05):
    """Return choices, some with a delay: exponential, its mean between 1 and 2 s by the seed."""
    rng = stream(seed, "slowed")
    delay_s = rng.exponential(rng.uniform(1, 2), some.trials)
    return replace(some, rt_s=some.rt_s + delay_s * (rng.random(some.trials) < share))
