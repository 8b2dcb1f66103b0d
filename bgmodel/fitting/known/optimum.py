"""Maximum of the likelihood of known evidence: a quasi-Newton search from several starts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bgmodel.fitting.known.likelihood import KnownLikelihood
from bgmodel.fitting.parameters import AT_BOUND
from bgmodel.fitting.simulated.error import jackknifed
from bgmodel.support.arrays import Array, Truths

STEP = 1e-4
"""Step of derivatives, as a share of a parameter's scale."""
T0_SHARES = (0.3, 0.7)
"""Starts have these shares of the fastest response time as non-decision time."""
NOISES = (0.1, 0.4)
"""Starts have these shares of the spread of OUT at decisions as noise."""
SHORT, LONG = 8, 200
"""Iterations of the search from each start, and from the best of the points reached."""
POLISHED, MOST_DAMPING, TOLERANCE_NATS = 20, 1e3, 1e-3
"""Most steps along the scores, their largest damping, and the gain below which they end."""
LOGARITHMIC = ("threshold", "noise")
"""Parameters that are searched by their logarithm: they may be small compared with their range."""
SINGULAR = 1e-10


@dataclass(frozen=True)
class KnownOptimum:
    """The maximum of the likelihood.

    Parameters
    ----------
    likelihood : KnownLikelihood
        The likelihood.
    vector : array (parameters,)
        The free parameters.
    log_likelihood : float, nats
        Its logarithm there.
    evaluations : int
        Number of evaluations of the search.
    """

    likelihood: KnownLikelihood
    vector: Array
    log_likelihood: float
    evaluations: int

    @cached_property
    def standard_errors(self) -> Array:
        """Standard error of each parameter, from the scores of all trials (Berndt et al. 1974).

        NaN at a bound of its range; infinite if the data do not identify it.
        """
        inside = ~self.at_bound
        scores = _scores(self.likelihood, self.vector, inside)
        information = scores.T @ scores
        length = np.sqrt(np.diag(information))
        found = np.full(len(self.vector), np.nan)
        found[inside] = np.inf
        some = np.flatnonzero(length > 0)
        cosines = information[np.ix_(some, some)] / np.outer(length[some], length[some])
        if len(some) and np.linalg.eigvalsh(cosines)[0] > SINGULAR:
            errors = np.sqrt(np.diag(np.linalg.inv(cosines))) / length[some]
            found[np.flatnonzero(inside)[some]] = errors
        return found

    @property
    def at_bound(self) -> Truths:
        """Which parameters are at a bound of their range."""
        return at_bound(self.likelihood, self.vector)


@dataclass(frozen=True)
class Score:
    """The log likelihood of a model, corrected for its simulated runs.

    Parameters
    ----------
    log_likelihood : float, nats
        Corrected for the bias due to a finite number of runs (jackknife; Quenouille 1956).
    error : float, nats
        Standard error due to the runs; 0 for models that are computed.
    bic : float
        Bayesian information criterion (Schwarz 1978): -2 log likelihood + parameters x ln trials.
    """

    log_likelihood: float
    error: float
    bic: float

    @property
    def log_evidence(self) -> float:
        """Approximate log marginal likelihood, -BIC / 2, nats."""
        return -self.bic / 2


def score_of(optimum: KnownOptimum) -> Score:
    """Return the score of the maximum of a likelihood."""
    found = optimum.log_likelihood
    parts = np.array([each(optimum.vector) for each in optimum.likelihood.without_parts()])
    if len(parts):
        found += (len(parts) - 1) * (found - float(parts.mean()))
    count, trials = len(optimum.vector), optimum.likelihood.trials.trials
    return Score(found, float(jackknifed(parts)), count * np.log(trials) - 2 * found)


def at_bound(likelihood: KnownLikelihood, vector: Array) -> Truths:
    """Return which parameters are at a bound, to a thousandth of the bound itself.

    Ranges are far wider than likely values: a share of the range would be no measure.
    """
    low, high = likelihood.freedom.low, likelihood.freedom.high
    least = 1e-6 * (high - low)
    lower = vector - low < AT_BOUND * np.abs(low) + least
    return np.asarray(lower | (high - vector < AT_BOUND * np.abs(high) + least))


def known_optimum(likelihood: KnownLikelihood) -> KnownOptimum:
    """Return the optimum, by L-BFGS-B (Byrd et al. 1995).

    A few iterations are made from each start that follows from the data, and the search continues
    from the best point. Steps along the scores of all trials end it, since ridges, such as that
    of threshold and non-decision time, slow a quasi-Newton search down.
    """
    tried = [_searched(likelihood, start, SHORT) for start in starts_of(likelihood)]
    vector, value, _ = max(tried, key=lambda each: each[1])
    vector, value, last = _searched(likelihood, vector, LONG)
    vector, value, more = _polished(likelihood, vector, value)
    count = last + more + sum(each[2] for each in tried)
    return KnownOptimum(likelihood, vector, value, count)


def _searched(
    likelihood: KnownLikelihood, start: Array, iterations: int
) -> tuple[Array, float, int]:
    """Return the best point, its log likelihood and the number of evaluations of a search."""
    from scipy.optimize import minimize

    low, high = likelihood.freedom.low, likelihood.freedom.high
    scale, logs = _scale(likelihood, start), _logarithmic(likelihood)

    def inner(vector: Array) -> Array:
        return np.where(logs, np.log(np.where(logs, vector, 1.0)), vector / scale)

    def outer(x: Array) -> Array:
        vector = np.where(logs, np.exp(np.where(logs, x, 0.0)), x * scale)
        return np.asarray(np.clip(vector, low, high))

    def cost(x: Array) -> float:
        return -float(likelihood.each(outer(x)).sum())

    bounds = list(zip(inner(low), inner(high), strict=True))
    options = {"eps": STEP, "maxiter": iterations, "ftol": 1e-9}
    found = minimize(cost, inner(start), method="L-BFGS-B", bounds=bounds, options=options)
    return outer(found.x), -float(found.fun), int(found.nfev)


def _polished(likelihood: KnownLikelihood, vector: Array, value: float) -> tuple[Array, float, int]:
    """Return the end of steps by the outer product of scores, damped until they lead uphill."""
    low, high = likelihood.freedom.low, likelihood.freedom.high
    evaluations, damping = 0, 1e-3
    for _ in range(POLISHED):
        inside = ~at_bound(likelihood, vector)
        scores = _scores(likelihood, vector, inside)
        information, slope = scores.T @ scores, scores.sum(axis=0)
        evaluations += 2 * len(slope)
        gained = 0.0
        while gained <= 0 and damping < MOST_DAMPING:
            damped = information + damping * np.diag(np.diag(information) + SINGULAR)
            step = np.zeros(len(vector))
            step[inside] = np.linalg.solve(damped, slope)
            there = np.clip(vector + step, low, high)
            gained = float(likelihood.each(there).sum()) - value
            evaluations += 1
            damping *= 10 if gained <= 0 else 0.1
        if gained > 0:
            vector, value = there, value + gained
        if gained < TOLERANCE_NATS:
            break
    return vector, value, evaluations


def starts_of(likelihood: KnownLikelihood) -> list[Array]:
    """Return the starts of a search.

    For two values of the non-decision time, the threshold is the median OUT of the chosen
    alternative at the reading of the decision, and the noise a large or a small share of the
    spread of that OUT.
    """
    trials, freed = likelihood.trials, likelihood.freedom
    fastest = float(np.nanquantile(trials.rt_s, 0.05))
    place = {name: k for k, name in enumerate(freed.names)}
    found = []
    for share in T0_SHARES:
        values = likelihood.values(freed.start) | {"t0_s": share * fastest}
        out = likelihood.outputs.out(values).mean(axis=0)
        level, spread = _at_decisions(likelihood, out, values["t0_s"])
        for noise in NOISES:
            given = {
                "t0_s": values["t0_s"],
                "threshold": likelihood.model.sign * level,
                "noise": noise * spread,
            }
            start = freed.start
            for name, value in given.items():
                if name in place:
                    start[place[name]] = value
            found.append(_within(start, freed.low, freed.high))
    return found


def _at_decisions(likelihood: KnownLikelihood, out: Array, t0_s: float) -> tuple[float, float]:
    """Return the median OUT of chosen alternatives when they decided, and half its spread."""
    trials = likelihood.trials
    some = np.flatnonzero((trials.choice >= 0) & (trials.seen > 0))
    before = trials.time_s[some] <= (trials.rt_s[some] - t0_s)[:, None]
    at = np.clip(before.sum(axis=1), 1, trials.seen[some]) - 1
    chosen = out[trials.offsets[some] + at, trials.choice[some]]
    lower, middle, upper = np.quantile(chosen, [0.25, 0.5, 0.75])
    return float(middle), max(float(upper - lower) / 2, 1e-3)


def _within(start: Array, low: Array, high: Array) -> Array:
    """Return a start that is a little inside its bounds, where derivatives exist."""
    margin = np.minimum(0.001 * (high - low), 0.1 * np.abs(low) + 1e-6)
    return np.asarray(np.clip(start, low + margin, high - margin))


def _logarithmic(likelihood: KnownLikelihood) -> Truths:
    """Return which parameters are searched on a logarithmic scale."""
    return np.isin(likelihood.freedom.names, LOGARITHMIC)


def _scale(likelihood: KnownLikelihood, start: Array) -> Array:
    """Return the scale of each parameter in the search."""
    width = likelihood.freedom.high - likelihood.freedom.low
    return np.asarray(np.clip(np.abs(start), 0.02 * width, width))


def _scores(likelihood: KnownLikelihood, vector: Array, inside: Truths) -> Array:
    """Return the derivative of each trial's log likelihood, (trials, parameters inside)."""
    low, high = likelihood.freedom.low, likelihood.freedom.high
    found, logs = [], _logarithmic(likelihood)
    for k in np.flatnonzero(inside):
        least = 0.0 if logs[k] else 0.01 * (high[k] - low[k])
        step = 1e-3 * max(abs(vector[k]), least)
        above, below = vector.copy(), vector.copy()
        above[k], below[k] = min(vector[k] + step, high[k]), max(vector[k] - step, low[k])
        apart = likelihood.each(above) - likelihood.each(below)
        found.append(apart / (above[k] - below[k]))
    return np.array(found).T.reshape(likelihood.trials.trials, len(found))
