"""Fits of stop-signal data to a stop process that participants share, and their results."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from bgmodel.fitting.stops.data import aligned, stop_data
from bgmodel.fitting.stops.likelihood import (
    BOUNDS,
    CHANGE,
    COORDINATES,
    StopLikelihood,
    StopValues,
    errors,
    maximum,
)
from bgmodel.fitting.stops.model import TEST, StopModel
from bgmodel.stopping.inputs import MOST_NATS
from bgmodel.stopping.trials import StopTrials
from bgmodel.support.arrays import Array
from bgmodel.support.reprs import Facts
from circuits.errors import FitWarning

FALL_NATS = 1.92
"""Fall of the log likelihood at the end of a 95 % interval (half of chi-squared, 1 d.f.)."""
ALIKE_NATS = 0.01
"""Strengths whose log likelihoods differ by less are alike; the strongest of them is reported."""
RESOLVED_NATS = 0.5
"""Change of the log likelihood with fine nodes up to which the others are enough."""
QUANTILES = (0.0, 0.25, 0.5, 0.75, 0.9, 1.0)
"""Quantiles of participants' thresholds that are tried as the strength of a stop signal."""
MULTIPLES = (1.0, 1.1, 1.25, 1.5, 2.0, 2.5, 3.0)
"""Multiples of the largest threshold that are tried for a circuit, whose latency depends on it."""


@dataclass(frozen=True, repr=False)
class StopFit(Facts):
    """A stop process fitted to several participants.

    Parameters
    ----------
    likelihood : StopLikelihood
        Data and model.
    spread : bool
        Whether participants differ in SSRT and trigger failures.
    values : StopValues
        The fitted values. The strength is the best of those tried; infinite if all that block
        responses are alike.
    errors : dict
        Standard errors.
    log_likelihood : float
        Nats.
    strengths : DataFrame
        Profile of the strength: strength_nats, log_likelihood (the greatest at this strength).
    """

    likelihood: StopLikelihood
    spread: bool
    values: StopValues
    errors: dict[str, float]
    log_likelihood: float
    strengths: pd.DataFrame

    @property
    def strength_nats(self) -> tuple[float, float]:
        """95 % interval of the strength, among those tried; infinite without an upper limit."""
        inside = self.strengths["log_likelihood"] > self.log_likelihood - FALL_NATS
        known = self.strengths.loc[inside, "strength_nats"]
        return float(known.min()), float(known.max())

    def facts(self) -> dict[str, str]:
        """Return the model, the numbers of participants and trials, and the parameters."""
        data = self.likelihood.data
        found = {"model": self.likelihood.model.name, "people": f"{len(data.names)}"}
        found["stop_trials"] = f"{len(data.ssd_ms)}"
        return found | {name: f"{getattr(self.values, name):.3g}" for name in self.errors}

    def parameters(self) -> pd.DataFrame:
        """Return the parameters: parameter, value, error (standard error), low, high (95 %).

        Intervals are symmetric in the coordinates of the search (logarithms, a logit), and
        therefore within the range of each parameter.
        """
        rows = []
        for name, error in self.errors.items():
            rows.append((name, getattr(self.values, name), error, *self._interval(name, error)))
        if self.known_thresholds:
            rows.append(("strength_nats", self.values.strength_nats, np.nan, *self.strength_nats))
        return pd.DataFrame(rows, columns=["parameter", "value", "error", "low", "high"])

    def _interval(self, name: str, error: float) -> tuple[float, float]:
        """Return the 95 % interval of a parameter from its standard error."""
        x = self.values.coordinates(self.spread)
        move = CHANGE * (np.arange(len(x)) == COORDINATES.index(name))
        at = [getattr(self.values.at(x + sign * move), name) for sign in (-1, 1)]
        far = 1.96 * error / ((at[1] - at[0]) / 2)
        low, high = (getattr(self.values.at(x + sign * far * move), name) for sign in (-1, 1))
        return low, high

    def notes(self) -> list[str]:
        """Return what these data cannot distinguish, one sentence each."""
        thresholds = self.likelihood.thresholds
        latency = np.median(self.likelihood.latency_ms(self.values.strength_nats))
        found = [
            "ssrt_ms includes afferent and motor delays, which these data cannot separate"
            + (f"; the circuit's median latency, {latency:.0f} ms, is added" if latency else "")
        ]
        if not self.known_thresholds:
            return [*found, "strength_nats is not fitted: no participant's threshold is known, "
                    "because it is not recorded which responses are correct"]  # fmt: skip
        low, high = self.strength_nats
        said = f"strength_nats is at least {low:.3g}"
        if np.isinf(high):
            said += " and has no upper limit: above the threshold all stop signals block alike"
        else:
            said += f" and at most {high:.3g}, which follows from the circuit's latency alone"
        middle, most = np.nanmedian(thresholds), np.nanmax(thresholds)
        return [*found, f"{said} (thresholds: median {middle:.3g}, largest {most:.3g} nats)"]

    @property
    def known_thresholds(self) -> bool:
        """Whether every participant's threshold is known, so that the strength is fitted."""
        return bool(np.isfinite(self.likelihood.thresholds).all())

    def summary(self) -> str:
        """Return the parameters and notes as text."""
        data = self.likelihood.data
        head = (
            f"{self.likelihood.model.name}: {len(data.names)} participants, {len(data.ssd_ms)} "
            f"stop trials, log likelihood {self.log_likelihood:.1f}"
        )
        table = self.parameters().round(4).to_string(index=False)
        return "\n".join([head, table, *self.notes()])


def fit_stops(
    people: Mapping[str, StopTrials],
    model: StopModel = TEST,
    *,
    spread: bool = True,
    slowed: bool = True,
    times: bool = False,
    go: pd.DataFrame | None = None,
) -> StopFit:
    """Fit a stop process that participants share.

    Parameters
    ----------
    people : mapping from names to StopTrials
        Trials of each participant, in the order in which they were run.
    model : StopModel
        ``TEST`` or ``circuit_stop()``.
    spread : bool
        Whether SSRT and trigger failures differ between participants.
    slowed : bool
        Whether go processes are slower after stop trials (``stop_data``).
    times : bool
        Whether the times of failed stops are fitted in addition to the outcomes.
    go : DataFrame, optional
        ``go_processes(people)``, if computed before.

    Raises
    ------
    ValueError
        As for ``stop_data``.

    Warns
    -----
    UserWarning
        If a parameter ends at a bound of its range.
    """
    data = stop_data(people, slowed=slowed)
    known = aligned(data, people, go)
    return fit_likelihood(StopLikelihood(data, model, known, times), spread=spread)


def fit_likelihood(likelihood: StopLikelihood, *, spread: bool = True) -> StopFit:
    """Return the fit of a likelihood; see ``fit_stops``."""
    spread = spread and len(likelihood.data.names) > 1  # one participant does not differ from any
    found = _fitted(likelihood, spread)
    finer = replace(likelihood, fine=True)
    if spread and abs(finer.each(found.values).sum() - found.log_likelihood) > RESOLVED_NATS:
        found = _fitted(finer, spread)
    _warn_of_bounds(found.values, spread)
    return found


def _fitted(likelihood: StopLikelihood, spread: bool) -> StopFit:
    start = StopValues() if spread else StopValues(ssrt_people_sd_ms=0, failures_people_sd=0)
    tried = []
    for strength in _strengths(likelihood):
        start, log = maximum(likelihood, replace(start, strength_nats=strength), spread)
        tried.append((start, log))
    best = max(log for _, log in tried)
    values = next(each for each, log in tried if log > best - ALIKE_NATS)
    rows = [(each.strength_nats, log) for each, log in tried]
    profile = pd.DataFrame(rows, columns=["strength_nats", "log_likelihood"])
    found = errors(likelihood, values, spread)
    return StopFit(likelihood, spread, values, found, best, profile)


def _strengths(likelihood: StopLikelihood) -> Array:
    """Return the strengths to try, the strongest first."""
    thresholds = likelihood.thresholds
    if not np.isfinite(thresholds).all():
        return np.array([np.inf])
    weak = np.quantile(thresholds, QUANTILES)
    strong = np.array([])
    if likelihood.model.time_ms is not None:
        strong = np.array(MULTIPLES) * weak[-1]
    tried = np.unique([0.0, *weak, *strong[strong < MOST_NATS], np.inf])[::-1]
    return tried[tried >= weak[-1]] if likelihood.times else tried


def _warn_of_bounds(values: StopValues, spread: bool) -> None:
    """Warn of parameters at a bound of their range."""
    x = values.coordinates(spread)
    stuck = [
        name for name, value, (low, high) in zip(COORDINATES, x, BOUNDS, strict=False)
        if min(value - low, high - value) < CHANGE
    ]  # fmt: skip
    if stuck:
        FitWarning.warn(f"{', '.join(stuck)} ended at a bound: its standard error is meaningless")
