"""People in the stop-signal task: trials, estimates, violations of an independent race, slowing.

In an independent race (Logan & Cowan 1984) the times of failed stops are the go times truncated at
SSD + SSRT. Slower ones violate independence, as they do at short delays (Bissett et al. 2021). A
race has no memory either; people respond more slowly after stop trials.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np
import pandas as pd

from bgmodel.stopping.estimates import estimate_ssrt, estimated, integrated, of_few
from bgmodel.stopping.trials import StopTrials, of_trend
from bgmodel.trials.files import STOP_SET
from bgmodel.trials.reader import OURS, Columns, read_trials
from circuits.arrays import Array
from circuits.errors import DataWarning, InputError, quiet, within

SHIPPED = STOP_SET
"""126 healthy adults, UCLA Consortium for Neuropsychiatric Phenomics (Poldrack et al. 2016)."""


def read_people(
    source: pd.DataFrame | str | Path = SHIPPED, *, columns: Columns = OURS
) -> dict[str, StopTrials]:
    """Return the stop-signal trials of each participant, read by ``read_trials``."""
    people = {}
    for who, trials in read_trials(source, columns=columns).by_participant().items():
        try:
            people[who] = StopTrials.of(trials)
        except InputError as error:
            raise within(f"participant {who}", error, "source") from None
    return people


def estimates_of(people: dict[str, StopTrials]) -> pd.DataFrame:
    """Return the fields of ``StopEstimate`` of every participant, one row each.

    ``refusal`` says why there is no accepted estimate. Warns once of too few stop trials, and of
    go responses with a trend.
    """
    rows, few, trends = [], 0, []
    for who, trials in people.items():
        try:
            row = vars(estimated(trials, checked=False))
            few += len(of_few(trials))
            trends += [f"{who}, {text}" for text in of_trend(trials, integrated)]
        except InputError as error:
            kind = "no responses on go trials" if error.field == "rt_ms" else "no stop trials"
            row = {"refusal": kind}
        rows.append({"participant_id": who, **row})
    if few:
        share = f"{few} of {len(people)} participants have too few stop trials"
        DataWarning.warn(f"{share}: their estimates are unreliable, their mean is less so")
    if trends:
        share = f"{len(trends)} of {len(people)} participants have a trend in their go times"
        DataWarning.warn(f"{share}: in {trends[0]}")
    return pd.DataFrame(rows)


WIDTH_MS = 50.0
"""Width of the bins of delays; each is centred at a multiple of it."""
AFTER = ("failed stop", "successful stop")
"""Outcomes after which go responses are compared with those after a go response."""


def violations(trials: StopTrials, ssrt_ms: float) -> pd.DataFrame:
    """Return how much slower failed stops are than an independent race predicts, by delay.

    ``race_ms`` is the mean of go times truncated at SSD + SSRT; ``impossible`` counts failed stops
    that no go time explains.
    """
    go = trials.rt_ms[~trials.stop & trials.responded]
    ssd, rt = trials.ssd_ms[trials.stop], trials.rt_ms[trials.stop]
    race = truncated_means(go, ssd + ssrt_ms)
    centre = WIDTH_MS * np.floor(ssd / WIDTH_MS + 0.5)
    rows = []
    for each in np.unique(centre):
        here = (centre == each) & ~np.isnan(rt)
        used = here & ~np.isnan(race)
        means = (rt[used].mean(), race[used].mean()) if used.any() else (np.nan, np.nan)
        counts = (int((centre == each).sum()), int(here.sum()))
        rows.append((each, *counts, *means, means[0] - means[1], int((here & ~used).sum())))
    names = ["ssd_ms", "trials", "failed", "failed_ms", "race_ms", "violation_ms", "impossible"]
    return pd.DataFrame(rows, columns=names)


def truncated_means(times_ms: Array, limits_ms: Array) -> Array:
    """Return the mean of the times up to each limit; NaN for a limit below all of them."""
    ordered = np.sort(times_ms)
    sums = np.cumsum(ordered)
    count = np.searchsorted(ordered, limits_ms, side="right")
    return np.where(count > 0, sums[np.maximum(count, 1) - 1] / np.maximum(count, 1), np.nan)


def violations_of(people: Mapping[str, StopTrials]) -> pd.DataFrame:
    """Return violations of independence by delay, over participants with an accepted SSRT."""
    accepted = []
    for trials in people.values():
        with quiet(), suppress(InputError):
            accepted.append((trials, estimate_ssrt(trials).ssrt_ms))
    tables = [violations(trials, ssrt_ms) for trials, ssrt_ms in accepted]
    if not tables:
        raise InputError("no participant has an accepted stop-signal reaction time", "people")
    rows = []
    for ssd, table in pd.concat(tables).groupby("ssd_ms"):
        known = table["violation_ms"].dropna()
        counts = table[["trials", "failed", "impossible"]].sum()
        means = table[["failed_ms", "race_ms", "violation_ms"]].mean()
        rows.append({"ssd_ms": ssd, "people": len(known), **counts,
                     "p_respond": counts["failed"] / counts["trials"], **means,
                     "violation_se_ms": standard_error(known.to_numpy())})  # fmt: skip
    return pd.DataFrame(rows)


def slowing(trials: StopTrials) -> dict[str, float]:
    """Return how much slower go responses are after stop trials than after go trials, ms."""
    before, response = trials.outcome[:-1], trials.rt_ms[1:]
    go = ~trials.stop[1:] & ~np.isnan(response)

    def mean(outcome: str) -> float:
        chosen = go & (before == outcome)
        return float(response[chosen].mean()) if chosen.any() else np.nan

    base = mean("response")
    slowed_ms = {f"after_{name.replace(' ', '_')}_ms": mean(name) - base for name in AFTER}
    return {"after_go_ms": base, **slowed_ms}


def standard_error(values: Array) -> float:
    """Return the standard error of a mean; NaN for fewer than two values."""
    return float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else np.nan


def slowing_of(people: Mapping[str, StopTrials]) -> pd.DataFrame:
    """Return the mean slowing after stop trials: measure, value, se and people (their number)."""
    table = pd.DataFrame([slowing(trials) for trials in people.values()])
    rows = [
        (name, known.mean(), standard_error(known.to_numpy()), len(known))
        for name, known in ((name, table[name].dropna()) for name in table)
    ]
    return pd.DataFrame(rows, columns=["measure", "value", "se", "people"])
