"""Parameters of maximum likelihood, or of maximum posterior density where they have priors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bgmodel.fitting.likelihood import Likelihood
from circuits.arrays import Array, Truths

OPTIMUM_SEED = 24_101
"""Seed of the stochastic search."""
TOLERANCE_NATS = 0.01
"""Change of the log likelihood below which the stochastic search ends."""
POPULATION = 16
"""Number of points in a generation of that search."""
STEP = 1e-4
"""Step of derivatives, as a share of a parameter's scale."""
SHORT, LONG = 30, 200
"""Iterations along slopes from each start, and from the best of the points reached."""
POLISHED, MOST_DAMPING, GAINED_NATS, SCORED_SHARE = 20, 1e3, 1e-3, 3e-8
"""Most steps along the scores, their largest damping, and the gain below which they end: a larger
one if the search is along scores alone, of hundreds of numbers."""
SINGULAR, FAR = 1e-10, 50.0
"""Least precision; distance of a bound, in standard errors, that a search along scores ignores."""
Tell = Callable[[int, float], None] | None


@dataclass(frozen=True)
class Optimum:
    """The maximum of the likelihood (or posterior density) at ``vector``, (parameters,); nats."""

    likelihood: Likelihood
    vector: Array
    log_likelihood: float
    evaluations: int

    @cached_property
    def density(self) -> Array:
        """Density of responses at the maximum, (cells, 2, bins), 1/s."""
        return self.likelihood.density(self.vector)

    @cached_property
    def complete(self) -> Optimum:
        """The same optimum on a grid for predictions; see ``Likelihood.complete``."""
        return replace(self, likelihood=self.likelihood.complete(self.vector))

    @property
    def values(self) -> dict[str, float]:
        """The numbers of the fit by name."""
        return dict(zip(self.likelihood.freedom.names, self.vector.tolist(), strict=True))

    @property
    def at_bound(self) -> Truths:
        """Which numbers are at a bound of their range."""
        return self.likelihood.freedom.at_bound(self.vector)


def optimum(
    likelihood: Likelihood,
    *,
    starts: Sequence[Array] | None = None,
    tell: Tell = None,
) -> Optimum:
    """Return the optimum; by default from ``likelihood.starts``.

    A smooth likelihood is climbed along its slope (L-BFGS-B), and in the end by steps along the
    scores of all trials; one with steps, as from simulated trials, is searched by CMA-ES (Hansen
    2016). ``tell`` is called with evaluations and best height.
    """
    begin = likelihood.starts() if starts is None else list(starts)
    if likelihood.rough:
        vector, evaluations = _stochastic(likelihood, begin, tell)
    else:
        vector, evaluations = _along_slopes(likelihood, begin, tell)
    return Optimum(likelihood, vector, likelihood(vector), evaluations)


def _stochastic(likelihood: Likelihood, starts: Sequence[Array], tell: Tell) -> tuple[Array, int]:
    import cma

    low, high = likelihood.freedom.low, likelihood.freedom.high
    evaluations, best, value = 0, likelihood.freedom.start, -np.inf
    for number, first in enumerate(starts):
        first = np.clip(first, low, high)
        scale = _scales(likelihood, first)
        options = {
            "bounds": [(low / scale).tolist(), (high / scale).tolist()],
            # Its own numbers: those of numpy's global generator are shared by all threads.
            "randn": np.random.RandomState(OPTIMUM_SEED + number).randn,
            "seed": np.nan,
            "popsize": POPULATION,
            "tolfun": TOLERANCE_NATS,
            "tolfunhist": TOLERANCE_NATS,
            "verbose": -9,
        }
        search = cma.CMAEvolutionStrategy((first / scale).tolist(), 1.0, options)
        while not search.stop():
            asked = search.ask()
            heights = [likelihood.height(np.clip(x * scale, low, high)) for x in asked]
            search.tell(asked, [-each for each in heights])
            evaluations += len(asked)
            if tell is not None:
                tell(evaluations, max(value, -float(search.result.fbest)))
        if -search.result.fbest > value:
            value = -float(search.result.fbest)
            best = np.clip(np.asarray(search.result.xbest) * scale, low, high)
    return best, evaluations


def _scales(likelihood: Likelihood, first: Array) -> Array:
    """Return the initial step of the search in each direction: about a sixth of the start."""
    width = likelihood.freedom.high - likelihood.freedom.low
    return np.asarray(np.clip(0.15 * np.abs(first), 0.02 * width, 0.2 * width))


def _along_slopes(likelihood: Likelihood, starts: Sequence[Array], tell: Tell) -> tuple[Array, int]:
    if likelihood.scored:
        tried = [_slid(likelihood, _within(likelihood, start)) for start in starts]
        vector, value, _ = max(tried, key=lambda each: each[1])
        count = sum(each[2] for each in tried)
        if tell is not None:
            tell(count, value)
        return vector, count
    tried = [_climbed(likelihood, _within(likelihood, start), SHORT) for start in starts]
    vector, value, _ = max(tried, key=lambda each: each[1])
    vector, value, last = _climbed(likelihood, vector, LONG)
    vector, value, more = _polished(likelihood, vector, value)
    count = last + more + sum(each[2] for each in tried)
    if tell is not None:
        tell(count, value)
    return vector, count


def _within(likelihood: Likelihood, start: Array) -> Array:
    """Return a start that is a little inside its bounds, where derivatives exist."""
    low, high = likelihood.freedom.low, likelihood.freedom.high
    margin = np.minimum(0.001 * (high - low), 0.1 * np.abs(low) + 1e-6)
    return np.asarray(np.clip(start, low + margin, high - margin))


def _climbed(likelihood: Likelihood, start: Array, iterations: int) -> tuple[Array, float, int]:
    from scipy.optimize import minimize

    freed = likelihood.freedom
    width = freed.high - freed.low
    unit = np.where(freed.rescaled, 1.0, np.clip(np.abs(start), 0.02 * width, width))
    low, high = freed.to_scale(freed.low) / unit, freed.to_scale(freed.high) / unit
    steps = np.diag(np.full(len(start), STEP))

    def outer(x: Array) -> Array:
        return np.asarray(np.clip(freed.from_scale(x * unit), freed.low, freed.high))

    def falling(x: Array) -> tuple[float, Array]:
        ahead = np.where(x + STEP <= high, x + steps, x - steps)
        sets = np.array([outer(each) for each in [x, *ahead]])
        prior = np.array([freed.log_prior(each) for each in sets])
        heights = likelihood.many(sets).sum(axis=1) + prior
        return -float(heights[0]), -(heights[1:] - heights[0]) / np.diag(ahead - x)

    bounds = list(zip(low, high, strict=True))
    options = {"maxiter": iterations, "ftol": 1e-9}
    first = np.clip(freed.to_scale(start) / unit, low, high)
    minimum = minimize(falling, first, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
    return outer(minimum.x), -float(minimum.fun), int(minimum.nfev) * (len(start) + 1)


def _slid(likelihood: Likelihood, start: Array) -> tuple[Array, float, int]:
    """Return the best point, its height and the number of evaluations of a search along scores.

    Directions are those in which the scores are uncorrelated, apart from numbers near bounds.
    """
    from scipy.optimize import minimize

    freed, evaluations = likelihood.freedom, 0
    low, high = freed.to_scale(freed.low), freed.to_scale(freed.high)
    for iterations in (SHORT, LONG):
        first, rate = freed.to_scale(start), freed.scale_rate(start)
        scores = likelihood.scores(start) * rate
        precision = scores.T @ scores + np.diag(freed.prior_slope(start)[1] * rate**2)
        # Where the likelihood is flat, a number has no scores at all.
        curvature = np.maximum(np.diag(precision), SINGULAR)
        axes = np.diag(1 / np.sqrt(curvature))
        below, above = ((end - first) / np.diag(axes) for end in (low, high))
        inner = np.flatnonzero(np.minimum(-below, above) > FAR)
        below[inner], above[inner] = -np.inf, np.inf
        some = np.ix_(inner, inner)
        # The diagonal is a little larger because the data may determine only a sum of some numbers.
        damped = precision + SINGULAR * np.diag(curvature)
        axes[some] = np.linalg.inv(np.linalg.cholesky(damped[some])).T

        def outer(x: Array, first: Array = first, axes: Array = axes) -> Array:
            return np.asarray(np.clip(freed.from_scale(first + axes @ x), freed.low, freed.high))

        def falling(x: Array, axes: Array = axes) -> tuple[float, Array]:
            vector = outer(x)
            each, scores = likelihood.with_scores(vector)
            slope = scores.sum(axis=0) + freed.prior_slope(vector)[0]
            height = float(each.sum()) + freed.log_prior(vector)
            return -height, -(slope * freed.scale_rate(vector)) @ axes

        minimum = minimize(
            falling, np.zeros(len(start)), jac=True, method="L-BFGS-B",
            bounds=list(zip(below, above, strict=True)),
            options={"maxiter": iterations, "ftol": SCORED_SHARE, "maxcor": 30},
        )  # fmt: skip
        start, evaluations = outer(minimum.x), evaluations + int(minimum.nfev)
        if minimum.success:
            break
    return start, -float(minimum.fun), evaluations * (len(start) + 1)


def _polished(likelihood: Likelihood, vector: Array, value: float) -> tuple[Array, float, int]:
    """Return the end of steps by the outer product of scores, damped until they lead uphill."""
    freed = likelihood.freedom
    low, high = freed.low, freed.high
    evaluations, damping = 0, 1e-3
    for _ in range(POLISHED):
        inside = ~freed.at_bound(vector)
        scores = likelihood.scores(vector)[:, inside]
        pull, precision = (each[inside] for each in freed.prior_slope(vector))
        information, slope = scores.T @ scores + np.diag(precision), scores.sum(axis=0) + pull
        evaluations += 2 * len(slope)
        gained = 0.0
        while gained <= 0 and damping < MOST_DAMPING:
            damped = information + damping * np.diag(np.diag(information) + SINGULAR)
            step = np.zeros(len(vector))
            step[inside] = np.linalg.solve(damped, slope)
            there = np.clip(vector + step, low, high)
            gained = likelihood.height(there) - value
            evaluations += 1
            damping *= 10 if gained <= 0 else 0.1
        if gained > 0:
            vector, value = there, value + gained
        if gained < GAINED_NATS:
            break
    return vector, value, evaluations
