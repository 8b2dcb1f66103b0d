"""OUT under steady evidence, at the fixed point and in spikes, and resting activity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.integrators.basal_ganglia import BasalGanglia
from circuits.arrays import Array
from circuits.circuit import Circuit
from circuits.engines import Algebra, Spikes

SETTLE_MS = 1500
"""Time for the slow common mode of a lesioned circuit to settle to within 1e-4 nats, ms."""


def leader_drive(log_odds: npt.ArrayLike, channels: int) -> Array:
    """Return a steady drive that favours the first channel, (log odds, 1, channels) nats."""
    odds = np.ravel(np.asarray(log_odds, dtype=np.float64))
    drive = np.zeros((odds.size, 1, channels))
    drive[:, 0, 0] = odds
    return np.asarray(drive - drive.mean(axis=2, keepdims=True))


def leader_out(circuit: Circuit, log_odds: npt.ArrayLike, *, laws: str = "table") -> Array:
    """Return the favoured channel's OUT at the fixed point, nats, in the shape of ``log_odds``.

    Log odds are those against each competitor, nats; ``laws`` is that of
    ``circuits.engines.Algebra``.
    """
    odds = np.asarray(log_odds, dtype=np.float64)
    # Drop the record of edits: those that the fixed point ignores should not warn here.
    model = BasalGanglia(replace(circuit, unedited=None), Algebra(laws=laws), gain=1.0)
    out_nats = model.run_drive(leader_drive(odds, circuit.channels), step_ms=1.0).output_nats
    return np.asarray(out_nats[:, 0, 0].reshape(odds.shape))


def out_shift(
    circuit: Circuit, edited: Circuit, out_nats: npt.ArrayLike, *, laws: str = "table"
) -> Array:
    """Return the shift of the winner's OUT by an edit at the fixed point, nats.

    ``out_nats`` is OUT (``-ln P``) before the edit; the result has its shape. All are NaN if the
    fixed point of any OUT does not exist or is not known.
    """
    circuit.check_nats("an OUT of -ln P")
    n = circuit.channels
    out = np.asarray(out_nats, dtype=np.float64)
    odds = np.log(n - 1) - np.log(np.expm1(out))
    try:
        before, after = (leader_out(c, odds, laws=laws) for c in (circuit, edited))
    except ValueError:
        return np.full_like(out, np.nan)
    return after - before


def steady_out(
    circuit: Circuit, log_odds: npt.ArrayLike, *, seed: int, trials: int, mean_ms: int = 1000
) -> Array:
    """Return the favoured channel's OUT under constant evidence, (log odds, trials) nats.

    OUT is averaged over ``mean_ms`` after ``SETTLE_MS``; trial t has the same noise in every
    circuit.
    """
    circuit.check_nats("a drive of log odds")
    odds = np.asarray(log_odds, dtype=np.float64)
    drive = leader_drive(np.repeat(odds, trials), circuit.channels)
    model = BasalGanglia(circuit, Spikes(rates=False, sample_ms=5.0), seed=seed)
    out = model.run_drive(drive, step_ms=float(SETTLE_MS + mean_ms)).output_nats
    means = out[:, SETTLE_MS // 5 :, 0].mean(axis=1)
    return np.asarray(means.reshape(len(odds), trials))


def resting_activity(
    circuit: Circuit, *, seed: int, trials: int = 4, seconds: int = 5
) -> pd.DataFrame:
    """Measure the resting activity of a spiking circuit, one row per nucleus.

    interval_cv is the coefficient of variation of inter-spike intervals, mean over cells with ten
    or more in a trial (NaN if none).
    """
    names = circuit.spiking()
    model = BasalGanglia(circuit, Spikes(spikes=names), seed=seed)
    # The first second is left out: the circuit settles.
    activity = model.run_drive(np.zeros((trials, seconds + 1, circuit.channels)), step_ms=1000.0)
    rows = []
    for name, spikes in (activity.spikes or {}).items():
        late = spikes.query("time_ms >= 1000")
        size = trials * circuit.population(name).neurons * activity.rates_hz[name].shape[2]
        ordered = late.sort_values(["trial", "channel", "neuron", "time_ms"])
        cells = ordered.groupby(["trial", "channel", "neuron"])["time_ms"]
        intervals = cells.diff().groupby([ordered[k] for k in ("trial", "channel", "neuron")])
        known = intervals.agg(["count", "mean", "std"]).query("count >= 10")
        cv = float((known["std"] / known["mean"]).mean())
        rows.append({"nucleus": name, "rate_hz": len(late) / (size * seconds), "interval_cv": cv})
    return pd.DataFrame(rows)
