"""Errors of simulated likelihoods: reduced by an ideal integrator, and how far they move a fit.

``Control`` is a control variate of densities from stored crossings. First-passage times of a walk
between two bounds are known exactly. Walks on the evidence of the stored trials differ from them by
chance, and the circuit, which decides on the same evidence, shares much of this difference: it is
subtracted (Glasserman 2003, chapter 4). The estimate is unbiased for any bound; a bound and a delay
like those of the circuit make it precise.

``simulation_error`` is how far a fit would move with other simulated trials: by the jackknife
(Efron & Tibshirani 1993, chapter 11) over independent parts of a circuit's stored trials; the fit
without a part follows from one Newton step from the optimum.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Self

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.trace import Trace
from bgmodel.fitting.likelihood import STEP, Likelihood
from bgmodel.fitting.posterior import Directions
from bgmodel.fitting.responses import BIN_S, Grid
from bgmodel.fitting.simulated.crossings import FirstPassageTimes, interpolated, log_odds, read
from circuits.arrays import Array, Truths

BOUNDS = 31
"""Bounds at which walks are stored."""
SHARE = 0.9
"""Share of the chance difference of walks to subtract; 0.7 to 1 do about equally well."""
LEVELS, SLOW = 20, 3
"""Numbers of thresholds at which walks are matched to the circuit, and of drifts used."""


@dataclass(frozen=True)
class Control:
    """Walks on the evidence of stored trials, and those matched to a circuit."""

    # Walks of the ideal integrator; the "thresholds" are minus the bounds, sqrt(s).
    walks: FirstPassageTimes
    bound_of_odds: Array  # Polynomial (3,) of the bound, sqrt(s), in a threshold's log odds.
    lag: float  # Delay of the circuit relative to the walks, bins.

    def part(self, parts: Truths) -> Control:
        """Return the walks of some parts of the trials."""
        return replace(self, walks=self.walks.part(parts))

    def excess(self, odds: float, drift: Array, bins: int) -> Array:
        """Return the walks' estimated minus exact probability of decisions, (bins, 2, drifts)."""
        levels = self.walks.thresholds_nats
        bound = np.polyval(self.bound_of_odds, odds)
        place = float(np.interp(-bound, levels, np.arange(len(levels))))
        rows = interpolated(place, len(levels))
        excess = read([(self.walks, 1.0)], rows, drift)[: self.walks.ends]
        for row, weight in rows:
            excess -= weight * exact(-float(levels[row]), self.walks.ends, tuple(drift.tolist()))
        late = np.zeros((bins, *excess.shape[1:]))
        whole_bins, part = divmod(max(self.lag, 0.0), 1.0)
        for shift, weight in ((int(whole_bins), 1 - part), (int(whole_bins) + 1, part)):
            few = max(min(bins - shift, len(excess)), 0)
            late[shift : shift + few] += weight * excess[:few]
        return SHARE * late


def decided(
    settings: Sequence[tuple[FirstPassageTimes, float]],
    threshold_nats: float,
    drift: npt.ArrayLike,
    grid: Grid,
) -> Array:
    """Return the probability of a decision for 0 and 1 in each bin, (drifts, 2, bins).

    ``settings`` are the same trials at settings of a circuit around the requested one, with
    weights. The estimate is unbiased: with a control it may be negative, by less than its error.
    """
    first, v = settings[0][0], np.asarray(drift, float)
    levels = first.thresholds_nats
    odds = log_odds(threshold_nats)
    place = len(levels) - 1 - float(np.interp(odds, log_odds(levels[::-1]), np.arange(len(levels))))
    mass = read(settings, interpolated(place, len(levels)), v)
    controls = [
        (each.control, share) for each, share in settings if isinstance(each.control, Control)
    ]
    if controls:
        mass = mass - joined(controls).excess(odds, v, len(mass))
    probability = np.zeros((len(v), 2, grid.bins))
    few = min(grid.bins, len(mass))
    probability[:, :, :few] = mass[:few].transpose(2, 1, 0)
    return probability


def joined(settings: Sequence[tuple[Control, float]]) -> Control:
    """Return the control interpolated between those of several settings."""
    line = np.sum([share * each.bound_of_odds for each, share in settings], axis=0)
    lag = sum(share * each.lag for each, share in settings)
    return Control(settings[0][0].walks, line, lag)


def matched(crossings: FirstPassageTimes, walks: FirstPassageTimes) -> Control:
    """Return the walks that match a circuit best: at each threshold, those with similar times."""
    rows = np.linspace(0, len(crossings.thresholds_nats) - 1, LEVELS).astype(int)
    likeness, lag = np.array([_likeness(crossings, int(row), walks) for row in rows]).swapaxes(0, 1)
    best = likeness.argmax(axis=1)
    odds = -np.log(np.expm1(crossings.thresholds_nats[rows]))
    line = np.polyfit(odds, -walks.thresholds_nats[best], 2)
    return Control(walks, line, float(np.median(lag[np.arange(LEVELS), best])))


def _likeness(
    crossings: FirstPassageTimes, row: int, walks: FirstPassageTimes
) -> tuple[list[float], list[float]]:
    """Return similarity in time of the walks at each bound, and their lead, bins."""
    slow = slice(0, SLOW * crossings.bins.shape[1] // len(crossings.drifts))
    choice, bins = crossings.choice[row, slow], crossings.bins[row, slow].astype(float)
    likeness, lag = [], []
    for chosen, times in zip(walks.choice[:, slow], walks.bins[:, slow], strict=True):
        same = (choice >= 0) & (choice == chosen)
        late, early = bins[same], times[same]
        some = same.any() and late.std() > 0 and early.std() > 0
        likeness.append(np.corrcoef(late, early)[0, 1] * same.mean() if some else -1.0)
        lag.append((late - early).mean() if some else 0.0)
    return likeness, lag


def ideal(read: Array, first: int) -> Trace:
    """Return the sums of the evidence as OUT; see ``crossings.Run``."""
    apart = read[:, :, 0] - read[:, :, 1]
    time_ms = np.arange(1.0, read.shape[1] + 1) * 1000 * BIN_S
    return Trace(np.stack([-apart, apart], axis=2), time_ms, step_ms=1000 * BIN_S)


@lru_cache(maxsize=256)
def _walk(bound: float, bins: int) -> tuple[Array, Array]:
    """Return nodes between the bounds, and the mass at each after k readings without drift."""
    from bgmodel.integrators.first_passage import GaussianIncrements, gaussian_chain

    sd = np.sqrt(BIN_S)
    chain = gaussian_chain(GaussianIncrements(0.0, sd), -bound, bound, 0.0, bins)
    unit = np.polynomial.legendre.leggauss(len(chain.onward) - 1)[0]
    masses = np.zeros((bins, len(chain.onward)))
    masses[0, 0] = 1.0
    for k in range(1, bins):
        masses[k] = masses[k - 1] @ chain.onward
    return np.concatenate([[0.0], bound * unit]), masses


def exact(bound: float, bins: int, drift: tuple[float, ...]) -> Array:
    """Return the exact probability that a walk ends in each bin, (bins, 2, drifts).

    Mass at x after k readings is that without drift times ``exp(v x - v^2 t / 2)``.
    """
    from scipy.special import ndtr

    nodes, masses = _walk(bound, bins)
    v = np.asarray(drift)
    step, sd = v * BIN_S, np.sqrt(BIN_S)
    sides = np.array([-1.0, 1.0])[:, None]
    over = ndtr((sides * (nodes[:, None] + step)[:, None] - bound) / sd)
    over *= np.exp(nodes[:, None] * v)[:, None]
    spent = np.exp(-(v**2) / 2 * BIN_S * np.arange(bins)[:, None])
    ends = (masses @ over.reshape(len(nodes), -1)).reshape(bins, 2, len(v))
    ends *= spent[:, None]
    return np.asarray(ends)


HALVED = 8
"""Number of times a step that leads downhill is halved before it is skipped."""


@dataclass(frozen=True)
class SimulationErrors:
    """Standard errors due to the simulated trials alone, 0 without simulation."""

    log_likelihood: float  # error of the largest log likelihood, nats
    parameters: Array  # (parameters,); NaN at a bound, where a Newton step is not informative


def jackknifed(values: npt.ArrayLike) -> Array:
    """Return the standard error of an estimate from its values without each part, (parts, ...)."""
    estimates = np.asarray(values, float)
    parts = len(estimates)
    if not parts:
        return np.zeros(estimates.shape[1:])
    return np.asarray(
        np.sqrt((parts - 1) / parts * ((estimates - estimates.mean(axis=0)) ** 2).sum(axis=0))
    )


def simulation_error(
    likelihood: Likelihood,
    there: Directions,
    left: Sequence[tuple[Likelihood, Array]] | None = None,
) -> SimulationErrors:
    """Return the standard errors due to simulated trials; ``left`` is as from ``without_parts``."""
    left = without_parts(likelihood, there) if left is None else left
    vectors = np.array([vector for _, vector in left]).reshape(len(left), len(there.vector))
    values = np.array([each(there.vector) for each, _ in left])
    errors = jackknifed(vectors)
    if left:
        errors[likelihood.freedom.at_bound(there.vector)] = np.nan
    return SimulationErrors(float(jackknifed(values)), errors)


def without_parts(likelihood: Likelihood, there: Directions) -> list[tuple[Likelihood, Array]]:
    """Return the likelihood without each part of simulated trials, and its optimum."""
    left = likelihood.without_parts()
    if not left:
        return []
    inside = ~likelihood.freedom.at_bound(there.vector)
    slopes = np.array([_slopes(each, there.vector, inside) for each in left])
    common = slopes.mean(axis=0)
    steps = np.zeros(slopes.shape)
    curvature = _curvature(likelihood, there.vector, inside)
    steps[:, inside] = (slopes - common)[:, inside] @ np.linalg.pinv(curvature)
    return [
        (each, _uphill(each, there.vector, step, common))
        for each, step in zip(left, steps, strict=True)
    ]


def _uphill(likelihood: Likelihood, vector: Array, step: Array, common: Array) -> Array:
    """Return the end of a step, halved until it leads uphill; ``common`` is all parts' slope."""
    low, high = likelihood.freedom.low, likelihood.freedom.high
    start = likelihood(vector)
    for halved in range(HALVED):
        at: Array = np.clip(vector + step / 2**halved, low, high)
        if likelihood(at) - common @ (at - vector) >= start:
            return at
    return vector


def _slopes(likelihood: Likelihood, vector: Array, inside: Truths) -> Array:
    slopes = np.zeros(len(vector))
    for k, step in zip(np.flatnonzero(inside), _steps(likelihood, vector, inside), strict=True):
        above, below = _beside(vector, k, step)
        slopes[k] = (likelihood(above) - likelihood(below)) / (2 * step)
    return slopes


def _beside(vector: Array, k: int, step: float) -> tuple[Array, Array]:
    above, below = vector.copy(), vector.copy()
    above[k], below[k] = vector[k] + step, vector[k] - step
    return above, below


def _curvature(likelihood: Likelihood, vector: Array, inside: Truths) -> Array:
    """Return minus the second derivatives for the data, by the numbers inside."""
    steps = _steps(likelihood, vector, inside)
    slopes = []
    for k, step in zip(np.flatnonzero(inside), steps, strict=True):
        above, below = _beside(vector, k, step)
        change = _slopes(likelihood, above, inside) - _slopes(likelihood, below, inside)
        slopes.append(change[inside] / (2 * step))
    curvature = -np.array(slopes).reshape(inside.sum(), inside.sum())
    return np.asarray((curvature + curvature.T) / 2)


def _steps(likelihood: Likelihood, vector: Array, inside: Truths) -> Array:
    """Return step sizes of derivatives; two steps stay within the range."""
    low, high = likelihood.freedom.low, likelihood.freedom.high
    steps = STEP * np.maximum(np.abs(vector), 0.1 * (high - low))
    room = np.minimum(vector - low, high - vector) / 2
    return np.asarray(np.minimum(steps, room)[inside])


PARTS = 16
"""Parts of the simulated trials; trial k belongs to part ``k % PARTS``."""


class InParts(ABC):
    """A model of which some parts of the simulated trials can be used alone."""

    @abstractmethod
    def _part(self, parts: Truths) -> Self:
        """Return the model with the parts that are true, (PARTS,)."""

    def halves(self) -> tuple[Self, Self]:
        """Return the model with one half of its simulated trials, and with the other half."""
        even = np.arange(PARTS) % 2 == 0
        return self._part(even), self._part(~even)

    def left_out(self) -> tuple[Self, ...]:
        """Return the model without each part of its simulated trials in turn."""
        return tuple(self._part(~left) for left in np.eye(PARTS, dtype=np.bool_))
