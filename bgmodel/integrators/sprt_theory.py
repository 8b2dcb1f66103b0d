"""Exact theory of the SPRT: error rates, decision times, optimal thresholds.

Z_0 is the log prior odds and Z_t = Z_(t-1) + x_t, with x = log p(reading|S2) / p(reading|S1) in
nats. After a reading the test responds R1 if Z <= lower and R2 if Z >= upper; before the first one
only if Z_0 is strictly beyond a bound. At t_max it must respond: R2 if Z > 0, R1 if Z < 0. Ties
(Z = 0 then, or Z on both bounds) are broken with probability 1/2 each. The symmetric test has its
bounds at -delta/2 and delta/2, so delta = 0 decides by the sign of one reading. Times are numbers
of readings ("steps").
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from bgmodel.deciding.reward import reward_of
from bgmodel.integrators.first_passage import Increments, walk
from bgmodel.support.checks import check_positive
from circuits.arrays import Array
from circuits.errors import require

WIDTH = 8.0
"""Greatest gap that is searched first, nats: that of the exhaustive search of Burguete et al."""
FLAT = 1e-9
"""Costs are equal if their relative difference is smaller."""
OVERSHOOT = 0.5825971579390107  # -zeta(1/2) / sqrt(2 pi), in sd of an increment (Siegmund, 1979)


class Performance(NamedTuple):
    """Probability of a wrong response and expected number of readings, of one shape."""

    error_rate: Array
    mean_steps: Array


class OptimalThreshold(NamedTuple):
    """Threshold `boundary_separation` in nats, and its cost in readings."""

    boundary_separation: float
    cost: float


def sprt(
    increments_s1: Increments,
    increments_s2: Increments,
    boundary_separation: ArrayLike,
    *,
    prior_s2: float = 0.5,
    t_max: int | None = None,
    cells: int = 256,
) -> Performance:
    """Error rate and mean number of readings of the symmetric test, averaged over the prior.

    The bounds are `boundary_separation` (...) nats apart; the test starts at the log odds of S2.
    `t_max` and `cells` are those of `first_passage.walk`.
    """
    separations = np.asarray(boundary_separation, dtype=float)
    require(
        np.all(np.isfinite(separations) & (separations >= 0)),
        "boundary_separation",
        "must be finite and >= 0",
        boundary_separation,
    )
    require(0 < prior_s2 < 1, "prior_s2", "must be above 0 and below 1", prior_s2)
    start = float(np.log(prior_s2) - np.log1p(-prior_s2))
    out = np.empty((2, separations.size))
    for i, bound in enumerate(separations.ravel() / 2):
        s1, s2 = (
            walk(x, -bound, bound, start=start, t_max=t_max, cells=cells)
            for x in (increments_s1, increments_s2)
        )
        out[0, i] = (1 - prior_s2) * s1.p_upper + prior_s2 * s2.p_lower
        out[1, i] = (1 - prior_s2) * s1.mean_steps + prior_s2 * s2.mean_steps
    return Performance(out[0].reshape(separations.shape)[()], out[1].reshape(separations.shape)[()])


def reward_curve(
    increments_s1: Increments,
    increments_s2: Increments,
    boundary_separation: ArrayLike,
    xi: float,
    *,
    prior_s2: float = 0.5,
    t_max: int | None = None,
    cells: int = 256,
) -> Array:
    """Return the expected reward -xi ER - E[T], in readings, at each separation; see `sprt`."""
    check_positive(xi=xi)
    test = sprt(
        increments_s1,
        increments_s2,
        boundary_separation,
        prior_s2=prior_s2,
        t_max=t_max,
        cells=cells,
    )
    return reward_of(test.error_rate, test.mean_steps, xi)


def widened(cost: Callable[[Array], Array], grid: Array) -> tuple[Array, Array]:
    """Double the range of a grid of gaps (K,) until the best is not in its last quarter.

    Returns the grid and the costs. The best gap grows like 2 ln(xi): doubling finds it soon.
    """
    costs = np.asarray(cost(grid))
    while grid[least(costs)] > 0.75 * grid[-1]:
        more = grid[-1] + (grid[-1] - grid[0]) * np.arange(1, 33) / 32
        grid, costs = np.append(grid, more), np.append(costs, cost(more))
    return grid, costs


def least(costs: Array) -> int:
    """Return the index of the least cost, the first of those that differ by rounding alone."""
    return int(np.argmax(costs <= costs.min() * (1 + FLAT)))


def optimal_separation(
    increments_s1: Increments,
    increments_s2: Increments,
    xi: float,
    *,
    t_max: int | None,
    bounds: tuple[float, float] | None = None,
    prior_s2: float = 0.5,
    cells: int = 256,
) -> OptimalThreshold:
    """Find the threshold that minimises the exact cost xi ER + E[T], in readings.

    A grid of 33 thresholds is searched within `bounds`, nats, by default 0 and as much as it takes
    (`widened`), then the interval around the best of them. The curve is flat near its minimum, so
    ``cost`` is determined far more precisely than its place.
    """
    from scipy.optimize import minimize_scalar

    low, high = bounds or (0.0, WIDTH)
    require(0 <= low < high < np.inf, "bounds", "must be finite, rising and at least 0", bounds)
    pair = increments_s1, increments_s2

    def cost(boundary_separation: ArrayLike) -> Array:
        return -reward_curve(
            *pair, boundary_separation, xi, prior_s2=prior_s2, t_max=t_max, cells=cells
        )

    grid = np.linspace(low, high, 33)
    grid, costs = widened(cost, grid) if bounds is None else (grid, cost(grid))
    best = least(costs)
    around = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    refined = minimize_scalar(cost, bounds=around, method="bounded", options={"xatol": 1e-5})
    if refined.fun < costs[best]:
        return OptimalThreshold(float(refined.x), float(refined.fun))
    return OptimalThreshold(float(grid[best]), float(costs[best]))
