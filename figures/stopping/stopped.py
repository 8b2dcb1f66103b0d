"""Simulated participants of the stop-signal task, with staircases, and predictions of trials."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy import special, stats

from bgmodel import stream
from bgmodel.fitting.hierarchy.group_fit import GroupFit
from bgmodel.fitting.stop_process import StopData, laid
from bgmodel.fitting.stop_race import StopLikelihood
from bgmodel.stopping.task import walk
from bgmodel.stopping.trials import StopTrials
from circuits.arrays import Array, Integers, Truths

DELAYS = np.arange(0.0, 1201.0, 50.0)
"""Delays of staircases, ms."""
STARTS = (250.0, 350.0)
"""First delay of the two staircases, ms."""
BINS, QUANTILES = 10, (0.1, 0.3, 0.5, 0.7, 0.9)
"""Number of bins of delays; quantiles of the times of failed stops."""
DRAWS, PREDICTION_SEED = 100, 24_701
"""Draws of the posterior from which trials are predicted, and their seed."""


@dataclass(frozen=True)
class StopValues:
    """The stop processes of simulated participants.

    Parameters
    ----------
    ssrt_ms, ssrt_people_sd_ms, ssrt_trial_sd_ms : float
        Mean SSRT, and its standard deviations between participants and between trials.
    failures, failures_people_sd : float
        Probability of a trigger failure of the median participant, and the standard deviation of
        its logit between participants.
    """

    ssrt_ms: float
    ssrt_people_sd_ms: float
    ssrt_trial_sd_ms: float
    failures: float
    failures_people_sd: float


def raced(
    go_ms: Array, stop: Truths, ssrt_ms: Array, failure: Truths, rng: np.random.Generator
) -> StopTrials:
    """Return the trials of a race, with delays from two staircases in random order.

    Of each trial, the time at which a response would be made, ms (infinite for none), and whether
    it has a stop signal; of each stop trial, its stop-signal reaction time, ms, and whether the
    signal triggers nothing.
    """
    stops = np.flatnonzero(stop)
    failed = (go_ms[stops] <= DELAYS[:, None] + ssrt_ms) | (failure & np.isfinite(go_ms[stops]))
    of = rng.permutation(len(stops)) % len(STARTS)
    index = np.empty(len(stops), dtype=np.int64)
    for which, start in enumerate(STARTS):
        index[of == which] = walk(failed[:, of == which], DELAYS, start)
    ssd_ms = np.full(len(go_ms), np.nan)
    ssd_ms[stops] = DELAYS[index]
    rt_ms = np.where(np.isfinite(go_ms), go_ms, np.nan)
    rt_ms[stops[~failed[index, np.arange(len(stops))]]] = np.nan
    return StopTrials(rt_ms, ssd_ms)


def like(
    people: Mapping[str, StopTrials], data: Mapping[str, StopData], values: StopValues, seed: int
) -> dict[str, StopTrials]:
    """Return simulated participants who differ from real ones only in that the model is right.

    Each has the go times of a participant, drawn with replacement, the same stop trials, and the
    mean slowing after a stop trial.
    """
    slowed = np.concatenate([each.slower_ms for each in data.values()])
    slower = slowed[slowed > 0].mean() if (slowed > 0).any() else 0.0
    simulated = {}
    for who, each in data.items():
        rng, stop = stream(seed, "like", who), people[who].stop
        times = np.maximum(rng.choice(each.times_ms, len(stop)), 0)
        times += slower * np.append(False, stop[:-1])
        times[rng.random(len(stop)) > each.responded] = np.inf
        ssrt, failure = _stop_processes(values, int(stop.sum()), rng)
        simulated[who] = raced(times, stop, ssrt, failure, rng)
    return simulated


def _stop_processes(
    values: StopValues, stops: int, rng: np.random.Generator
) -> tuple[Array, Truths]:
    """Draw a participant, and the stop-signal reaction time and trigger failure of each trial."""
    mean = values.ssrt_ms + values.ssrt_people_sd_ms * rng.standard_normal()
    odds = values.failures_people_sd * rng.standard_normal()
    share = special.expit(special.logit(values.failures) + odds) if values.failures else 0.0
    ssrt = mean + values.ssrt_trial_sd_ms * rng.standard_normal(stops)
    return ssrt, rng.random(stops) < share


def mean_and_error(values: pd.Series | Array) -> tuple[float, float, int]:
    """Return mean, standard error and number of known values."""
    known = np.asarray(values, float)
    known = known[np.isfinite(known)]
    return float(known.mean()), float(known.std(ddof=1) / np.sqrt(len(known))), len(known)


def predictions(
    fit: GroupFit, likelihoods: Mapping[str, StopLikelihood], left: Mapping[str, Integers]
) -> dict[str, pd.DataFrame]:
    """Return a fit's predictions of stop trials, ``left`` out of it, of the same people.

    By decile of the delay, predicted and observed p(respond) with the standard error of their
    difference (``deciles``); and how far both and the times of failed stops differ (``halves``).
    """
    parts, times = [], []
    for k, (who, each) in enumerate(likelihoods.items()):
        vectors = fit.individual[:, :, k].reshape(-1, fit.individual.shape[-1])
        vectors = vectors[np.linspace(0, len(vectors) - 1, DRAWS).astype(int)]
        rng, trials = stream(PREDICTION_SEED, who), each.trials
        data = laid(trials, each.model.slowing_ms)
        here = np.isin(data.stop, left[who])
        every = [each.values(vector) for vector in vectors]
        p = [each.model.p_respond(trials, values)[here] for values in every]
        made = [each.model.simulate(trials, values, rng).rt_s[left[who]] for values in every]
        seen = {"ssd_ms": data.ssd_ms[here], "rt_ms": data.rt_ms[here]}
        parts.append(pd.DataFrame({**seen, "predicted": np.mean(p, axis=0)}))
        times.append(1000 * np.concatenate(made))
    table = pd.concat(parts, ignore_index=True)
    observed, predicted = (
        np.nanquantile(some, QUANTILES) for some in (table["rt_ms"], np.concatenate(times))
    )
    deciles, late = _deciles(table), predicted - observed
    apart = deciles["predicted"] - deciles["observed"]
    chi2 = float(((apart / deciles["error"]) ** 2).sum())
    summary = {
        "bias": (apart * deciles["trials"]).sum() / deciles["trials"].sum(), "chi2": chi2,
        "p": stats.chi2.sf(chi2, len(deciles)), "largest": apart.abs().max(),
        "late_ms": late[np.abs(late).argmax()],
    }  # fmt: skip
    return {"deciles": deciles, "halves": pd.DataFrame([summary])}


def _deciles(table: pd.DataFrame) -> pd.DataFrame:
    """Return predicted and observed probabilities by decile of the delay."""
    edges = np.quantile(table["ssd_ms"], np.linspace(0, 1, BINS + 1)[1:-1])
    p = table["predicted"]
    table = table.assign(
        decile=np.searchsorted(edges, table["ssd_ms"], side="right") + 1,
        observed=table["rt_ms"].notna().astype(float), variance=p * (1 - p),
    )  # fmt: skip
    by = table.groupby("decile")
    means = by[["ssd_ms", "observed", "predicted"]].mean()
    means["error"] = np.sqrt(by["variance"].sum()) / by.size()
    return means.assign(trials=by.size()).reset_index()
