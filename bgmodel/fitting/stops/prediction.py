"""Predictions of stop trials that were not fitted: probabilities of responding, and times."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy import special, stats

from bgmodel.fitting.stops.data import StopData, aligned, stop_data
from bgmodel.fitting.stops.fit import StopFit, fit_likelihood
from bgmodel.fitting.stops.likelihood import StopLikelihood
from bgmodel.fitting.stops.model import TEST, StopModel
from bgmodel.stopping.trials import StopTrials
from bgmodel.support.arrays import Array
from bgmodel.support.reprs import Facts

BINS = 10
"""Number of bins of delays, with about equally many trials: deciles."""
QUANTILES = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Quantiles of the times of failed stops."""
HALVES = {"odd": 0, "even": 1}
"""Remainder of a stop trial's number, counted from 0: the first, third, ... are odd."""


@dataclass(frozen=True, repr=False)
class Prediction(Facts):
    """Predicted and observed stop trials.

    Parameters
    ----------
    deciles : DataFrame
        By decile of the stop-signal delay: ssd_ms (its mean), trials, observed and predicted
        p(respond), and error (standard error of the difference, if the prediction is right).
    times : DataFrame
        quantile, observed_ms and predicted_ms: times of failed stops, participants pooled.
    """

    deciles: pd.DataFrame
    times: pd.DataFrame

    @property
    def bias(self) -> float:
        """Predicted minus observed p(respond), all trials."""
        table = self.deciles
        apart = (table["predicted"] - table["observed"]) * table["trials"]
        return float(apart.sum() / table["trials"].sum())

    @property
    def largest(self) -> float:
        """Largest absolute difference between predicted and observed p(respond) of a decile."""
        return float((self.deciles["predicted"] - self.deciles["observed"]).abs().max())

    @property
    def chi2(self) -> float:
        """Sum over deciles of squared differences, in units of their standard errors."""
        table = self.deciles
        return float((((table["predicted"] - table["observed"]) / table["error"]) ** 2).sum())

    @property
    def p(self) -> float:
        """Probability of a larger ``chi2`` if the predictions are right."""
        return float(stats.chi2.sf(self.chi2, len(self.deciles)))

    @property
    def late_ms(self) -> float:
        """Largest difference of a quantile, predicted minus observed, ms, with its sign."""
        apart = (self.times["predicted_ms"] - self.times["observed_ms"]).to_numpy()
        return float(apart[np.abs(apart).argmax()])

    def facts(self) -> dict[str, str]:
        """Return bias, chi2 and the largest differences."""
        names = ("bias", "chi2", "p", "largest", "late_ms")
        return {name: f"{getattr(self, name):.3g}" for name in names}


def predict(fit: StopFit, data: StopData) -> Prediction:
    """Predict stop trials from a fit to other trials of the same participants.

    Each participant's stop-signal reaction time and trigger failures have the posterior
    distribution that follows from the fitted trials.

    Parameters
    ----------
    fit : StopFit
        Fit to some trials.
    data : StopData
        Other trials of the same participants.
    """
    log = fit.likelihood.by_node(fit.values)
    weights = np.exp(log - special.logsumexp(log, axis=(1, 2), keepdims=True))
    other = replace(fit.likelihood, data=data)
    predicted = (other.p_respond(fit.values) * weights[data.person]).sum(axis=(1, 2))
    return Prediction(_deciles(data, predicted), _times(other, fit, weights))


def _deciles(data: StopData, predicted: Array) -> pd.DataFrame:
    """Return predicted and observed probabilities by decile of the delay."""
    edges = np.quantile(data.ssd_ms, np.linspace(0, 1, BINS + 1)[1:-1])
    variance = predicted * (1 - predicted)
    table = pd.DataFrame(
        {"decile": np.searchsorted(edges, data.ssd_ms, side="right") + 1, "ssd_ms": data.ssd_ms,
         "observed": data.failed.astype(float), "predicted": predicted, "variance": variance}
    )  # fmt: skip
    by = table.groupby("decile")
    found = by[["ssd_ms", "observed", "predicted"]].mean()
    found["error"] = np.sqrt(by["variance"].sum()) / by.size()
    return found.assign(trials=by.size()).reset_index()


def _times(likelihood: StopLikelihood, fit: StopFit, weights: Array) -> pd.DataFrame:
    """Return predicted and observed quantiles of the times of failed stops.

    A go time g is that of a failed stop with probability f, or if the stop takes effect after it.
    """
    data, sd_ms = likelihood.data, fit.values.ssrt_trial_sd_ms
    effect = likelihood.effect_ms(fit.values) - data.slower_ms[:, None]
    node = weights.sum(axis=2)
    failures = (weights * likelihood.failures(fit.values)).sum(axis=2) / np.maximum(node, 1e-300)
    times, shares = [], []
    for number, go in enumerate(data.go_ms):
        trials = data.person == number
        if not trials.any():
            continue
        share = np.zeros((trials.sum(), len(go)))
        for k in range(node.shape[1]):
            late = special.ndtr((effect[trials, k][:, None] - go) / sd_ms)
            f = failures[number, k]
            share += node[number, k] * (f + (1 - f) * late)
        times.append((go + data.slower_ms[trials][:, None]).ravel())
        shares.append((share * data.responded[number] / len(go)).ravel())
    observed = np.quantile(data.rt_ms[data.failed], QUANTILES)
    predicted = _weighted(np.concatenate(times), np.concatenate(shares))
    return pd.DataFrame({"quantile": QUANTILES, "observed_ms": observed, "predicted_ms": predicted})


def _weighted(times_ms: Array, weights: Array) -> Array:
    """Return quantiles of weighted times."""
    order = np.argsort(times_ms)
    below = np.cumsum(weights[order]) / weights.sum()
    return np.asarray(times_ms[order][np.searchsorted(below, QUANTILES)])


def halves(
    people: Mapping[str, StopTrials],
    model: StopModel = TEST,
    *,
    spread: bool = True,
    slowed: bool = True,
    times: bool = False,
    go: pd.DataFrame | None = None,
) -> dict[str, tuple[StopFit, Prediction]]:
    """Fit one half of the stop trials and predict the other, both ways.

    Arguments are those of ``fit_stops``. Go trials of both halves are used.

    Returns
    -------
    dict
        For "odd" and "even", the fit to these stop trials and its prediction of the others.
    """
    data = stop_data(people, slowed=slowed)
    known = aligned(data, people, go)
    found = {}
    for name, remainder in HALVES.items():
        fitted = data.number % 2 == remainder
        likelihood = StopLikelihood(data.where(fitted), model, known, times)
        fit = fit_likelihood(likelihood, spread=spread)
        found[name] = (fit, predict(fit, data.where(~fitted)))
    return found
