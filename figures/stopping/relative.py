"""Inhibition function and failed stops of the people of the shipped set, next to a race.

Delays of a staircase follow the person, so they are expressed relative to each person's go times:
``z = (SSD + SSRT - median go time) / sd of go times`` (Logan & Cowan 1984). In an independent race
with a constant stop-signal reaction time, p(respond) at a z is then the share of faster go times.
"""

from __future__ import annotations

import warnings

import numpy as np
import pandas as pd

from bgmodel import stream
from bgmodel.bootstrap import RESAMPLES, resampled
from bgmodel.stopping.estimates import estimate_ssrt
from bgmodel.stopping.people import read_people
from bgmodel.stopping.trials import StopTrials
from bgmodel.trials.reader import Columns
from circuits.arrays import Array
from circuits.errors import DataWarning
from figures.stopping.runs import SCORING_SEED

BINS = 10


def people() -> pd.DataFrame:
    """Return p(respond) and times of failed stops in tenths of z, with 95 % intervals over people.

    Recorded delays of 0 (the response came before the signal) are restored. Left
    out are people for whom the consensus guide accepts no estimate (Verbruggen et al. 2019).
    """
    restored = read_people(columns=Columns(restore_delays=True))
    parts = [_relative(who, one) for who, one in restored.items()]
    trials = pd.concat([part for part in parts if len(part)], ignore_index=True)
    rng = stream(SCORING_SEED, "people")
    weights = resampled(len(trials), RESAMPLES, rng, trials["who"])
    place = pd.qcut(trials["z"], BINS, labels=False)
    rows = []
    for k in range(BINS):
        here = (place == k).to_numpy()
        rows.append(_bin(trials[here], weights[:, here]))
    return pd.DataFrame(rows)


def _relative(who: str, trials: StopTrials) -> pd.DataFrame:
    """Return the stop trials of one person, relative to the go times; none if refused."""
    with warnings.catch_warnings():
        # 32 stop trials each: the intervals are over people.
        warnings.simplefilter("ignore", DataWarning)
        try:
            estimate = estimate_ssrt(trials)
        except ValueError:
            return pd.DataFrame()
    go = trials.rt_ms[~trials.stop]
    go = go[~np.isnan(go)]
    ends = trials.ssd_ms[trials.stop] + estimate.ssrt_ms
    rt = trials.rt_ms[trials.stop]
    faster = [go[go < end] for end in ends]
    return pd.DataFrame(
        {"who": who, "z": (ends - np.median(go)) / go.std(), "responded": ~np.isnan(rt),
         "race": [len(each) / len(go) for each in faster], "late_ms": rt - go.mean(),
         "race_late_ms": [each.mean() - go.mean() if len(each) else np.nan for each in faster]}
    )  # fmt: skip


def _bin(rows: pd.DataFrame, weights: Array) -> dict[str, float]:
    failed = rows["responded"].to_numpy()
    both = failed & rows["race_late_ms"].notna().to_numpy()
    row = {"z": rows["z"].mean(), "people": rows["who"].nunique()}
    row |= {"stop_trials": len(rows), "failed_trials": int(failed.sum())}
    row |= _mean("p_respond", rows["responded"].to_numpy(float), weights)
    row |= {"p_race": rows["race"].mean()}
    row |= _mean("failed_minus_go_ms", rows["late_ms"].to_numpy()[both], weights[:, both])
    return row | {"race_minus_go_ms": rows["race_late_ms"].to_numpy()[both].mean()}


def _mean(name: str, values: Array, weights: Array) -> dict[str, float]:
    """Return a mean with its bootstrap interval over people."""
    drawn = weights @ values / weights.sum(axis=1)
    low, high = np.quantile(drawn[1:], [0.025, 0.975])
    return {name: drawn[0], f"{name}_low": low, f"{name}_high": high}
