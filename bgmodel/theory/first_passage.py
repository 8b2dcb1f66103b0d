"""First passage of a random walk through two bounds, in discrete time and without simulation.

The walk Z_0 = start, Z_t = Z_(t-1) + x_t responds R1 once Z <= lower and R2 once Z >= upper; if
both hold, half of the mass goes to each. It is an absorbing Markov chain whose state 0 is the
start, so that the first reading is always exact; a finite and an infinite horizon are then the same
computation for any x.
"""

from dataclasses import dataclass
from functools import lru_cache
from operator import index
from typing import NamedTuple

import numpy as np

from bgmodel.support.arrays import Array
from bgmodel.support.checks import check_finite, check_positive
from bgmodel.theory.empirical import Empirical, check_size, empirical_chain
from circuits.errors import require


@dataclass(frozen=True)
class Gaussian:
    """Increments x ~ N(mean, sd), both in nats."""

    mean: float
    sd: float

    def __post_init__(self) -> None:
        check_finite(mean=self.mean)
        check_positive(sd=self.sd)


Increments = Gaussian | Empirical


def gaussian_pair(d: float) -> tuple[Gaussian, Gaussian]:
    """Return x under S1 and S2 for readings of unit variance whose means lie `d` apart.

    x ~ N(-d^2/2, d) under S1 and N(d^2/2, d) under S2, in nats.
    """
    check_positive(d=d)
    return Gaussian(-(d**2) / 2, d), Gaussian(d**2 / 2, d)


@dataclass(frozen=True, eq=False)
class Walk:
    """How a walk between two bounds ends."""

    p_upper: float  # probability of R2, forced responses included
    p_lower: float  # of R1, likewise
    p_forced: float  # of a response at t_max, by the sign of Z
    mean_steps: float  # expected number of readings
    steps_pmf: Array | None  # (t_max + 1,), of 0, 1, ..., t_max readings; None without a deadline


class Chain(NamedTuple):
    """Absorbing chain of n states, the start first: where one reading leads from each.

    `onward` (n, n) stays between the bounds, `upper` and `lower` (n,) cross them, and `above` and
    `below` (n,) are the mass that stays, by the sign of Z (of 0 half goes to each).
    """

    onward: Array
    upper: Array
    lower: Array
    above: Array
    below: Array

    def run(self, t_max: int | None) -> Walk:
        """Follow the mass for `t_max` readings, or until none is left."""
        first = np.eye(1, len(self.onward))[0]
        if t_max is None:
            visits = np.linalg.solve((np.eye(first.size) - self.onward).T, first)
            ends = float(visits @ self.upper), float(visits @ self.lower)
            return Walk(*ends, 0.0, float(visits.sum()), None)
        masses = [first]
        for _ in range(t_max - 1):
            masses.append(masses[-1] @ self.onward)
        upper, lower, above, below = (np.array(masses) @ np.stack(self[1:], axis=1)).T
        pmf = np.concatenate([[0.0], upper + lower])
        forced = above[-1] + below[-1]
        pmf[-1] += forced
        ends = float(upper.sum() + above[-1]), float(lower.sum() + below[-1])
        return Walk(*ends, float(forced), float(pmf @ np.arange(t_max + 1)), pmf)


@lru_cache(maxsize=32)
def _legendre(count: int) -> tuple[Array, Array]:
    return np.polynomial.legendre.leggauss(count) if count else (np.empty(0), np.empty(0))


def gaussian_chain(
    x: Gaussian, lower: float, upper: float, start: float, t_max: int | None
) -> Chain:
    """Nystrom's discretisation, on Gauss-Legendre nodes, of the Fredholm equation of the walk."""
    from scipy.special import ndtr

    bottom, top = lower, upper
    if t_max is not None:  # no node where the density stays below 1e-20 up to the deadline
        reach = 10 * x.sd * np.sqrt(t_max)
        bottom = max(lower, start + min(x.mean, 0) * t_max - reach)
        top = min(upper, start + max(x.mean, 0) * t_max + reach)
    # Four nodes per sd resolve a Gaussian to rounding; multiples of 16 let widths share nodes.
    count = 16 * np.ceil((4 * (top - bottom) / x.sd + 32) / 16)
    check_size(count, lower, upper)
    unit, weights = _legendre(int(count) if top > bottom else 0)
    nodes = bottom + (top - bottom) * (unit + 1) / 2
    states = np.concatenate([[start], nodes])
    onward = np.zeros((states.size, states.size))
    offset = (nodes - states[:, None] - x.mean) / x.sd
    scale = (top - bottom) / (2 * x.sd * np.sqrt(2 * np.pi))
    onward[:, 1:] = weights * scale * np.exp(-(offset**2) / 2)
    zero = min(max(0.0, lower), upper)
    cuts = np.array([[lower], [zero], [upper]])
    low, middle, high = ndtr((cuts - states - x.mean) / x.sd)
    over = ndtr((states + x.mean - upper) / x.sd)  # 1 - high would lose small tails
    return Chain(onward, over, low, high - middle, middle - low)


def walk(
    increments: Increments,
    lower: float,
    upper: float,
    *,
    start: float = 0.0,
    t_max: int | None = None,
    cells: int = 256,
) -> Walk:
    """Solve the walk of independent `increments` between two bounds, from `start`, all in nats.

    Gaussian increments are solved to about 1e-11. Of empirical ones the first reading is exact;
    later ones treat the density of Z as piecewise linear on `cells` cells, except that sums of the
    up to 32 heaviest atoms (weight at least 0.002) keep their exact place, bounds included (within
    1e-10). A few atoms alone are exact; 256 cells err by about 1e-5 in probability and 1e-4 of the
    mean number of readings, and twice as many by at most about half of that. A walk that never ends
    or spans too many sd raises. Kemp (1958), the Fredholm equation; Brook and Evans (1972), the
    Markov chain.
    """
    for name, value in (("lower", lower), ("upper", upper), ("start", start)):
        require(np.isfinite(value), name, "must be finite", value)
    require(lower <= upper, "lower", f"must be at most upper = {upper}", lower)
    t_max = None if t_max is None else _whole("t_max", t_max, 1)
    cells = _whole("cells", cells, 4)
    if start > upper or start < lower:
        pmf = None if t_max is None else np.eye(1, t_max + 1)[0]
        return Walk(float(start > upper), float(start < lower), 0.0, 0.0, pmf)
    if isinstance(increments, Gaussian):
        return gaussian_chain(increments, lower, upper, start, t_max).run(t_max)
    moving = t_max is not None or lower == upper or bool(np.any(increments.values != 0))
    require(moving, "increments", "must be other than 0 somewhere, or t_max given", "only 0")
    return Chain(*empirical_chain(increments, lower, upper, start, t_max, cells)).run(t_max)


def _whole(name: str, value: int, least: int) -> int:
    try:
        number = index(value)
    except TypeError:
        number = least - 1
    require(number >= least, name, f"must be a whole number, at least {least}", value)
    return number
