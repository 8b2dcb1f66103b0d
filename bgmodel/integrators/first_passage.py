"""First passage of a random walk through two bounds, in discrete time and without simulation.

The walk Z_0 = start, Z_t = Z_(t-1) + x_t responds R1 once Z <= lower and R2 once Z >= upper; if
both hold, half of the mass goes to each. It is an absorbing Markov chain whose state 0 is the
start, so that the first reading is always exact; a finite and an infinite horizon are then the same
computation for any x.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bgmodel.support.checks import check_finite, check_positive, whole
from circuits.arrays import Array, Truths
from circuits.errors import require

MAX_STATES = 6000  # a larger dense chain takes minutes and gigabytes
MAX_HEAVY = 32  # atoms of x whose sums are followed exactly,
MAX_PLACES = 128  # to this many places of Z
HEAVY = 2e-3  # two lighter atoms bring fewer than one walk in 250 000 to the same spot


def check_size(states: float, upper: float) -> None:
    """Raise ValueError if the bounds would need more than MAX_STATES states."""
    allowed = f"closer to lower, or t_max given and smaller, for at most {MAX_STATES} states"
    require(states <= MAX_STATES, "upper", f"must be {allowed}", upper)


@dataclass(frozen=True, eq=False)
class Empirical:
    """Increments that take finitely many values, kept sorted and merged where equal."""

    values: Array  # (n,), log-likelihood ratios, nats
    weights: Array  # (n,), probabilities; they sum to 1

    def __post_init__(self) -> None:
        points = np.atleast_1d(np.asarray(self.values, dtype=float))
        weights = np.atleast_1d(np.asarray(self.weights, dtype=float))
        require(points.ndim == 1 and points.size, "values", "must be (n,), n >= 1", points.shape)
        require(np.isfinite(points).all(), "values", "must be finite", points)
        require(weights.shape == points.shape, "weights", f"must be {points.shape}", weights.shape)
        require((weights >= 0).all(), "weights", "must be at least 0", weights)
        total = float(weights.sum())
        require(abs(total - 1) < 1e-9, "weights", "must be of sum 1", weights)
        # Values that differ only by rounding are merged; the walk resolves 1e-10.
        near = np.round(points[weights > 0], 12) + 0.0
        values, group = np.unique(near, return_inverse=True)
        merged = np.bincount(group, weights[weights > 0]) / total
        for name, array in (("values", values), ("weights", merged)):
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @classmethod
    def of_sample(cls, values: ArrayLike) -> Empirical:
        """Give each of the `values` (n,), in nats, the same weight."""
        array = np.atleast_1d(np.asarray(values, dtype=float))
        return cls(array, np.full(array.shape, 1 / max(array.size, 1)))

    @cached_property
    def sd(self) -> float:
        """Standard deviation in nats."""
        return float(np.sqrt(self.weights @ (self.values - self.weights @ self.values) ** 2))

    @cached_property
    def heavy(self) -> Truths:
        """Atoms (n,) heavy enough to bring two walks to exactly the same place."""
        floor = max(HEAVY, np.sort(self.weights)[-min(MAX_HEAVY, self.weights.size)])
        mask: Truths = self.weights >= floor
        return mask if mask.sum() <= MAX_HEAVY else np.asarray(self.weights > floor)

    @cached_property
    def cumulative(self) -> tuple[Array, Array]:
        """Weight below each value, of all atoms and of the light ones, each (n + 1,)."""
        light = np.where(self.heavy, 0.0, self.weights)
        both = [np.concatenate([[0.0], np.cumsum(w)]) for w in (self.weights, light)]
        return both[0], both[1]


def empirical_chain(
    x: Empirical, lower: float, upper: float, start: float, t_max: int | None, cells: int
) -> tuple[Array, ...]:
    """Arrays of a `first_passage.Chain`, whose states are places of Z and then cells.

    Each place reached by sums of heavy atoms is a state; cells hold the rest of the mass.
    """
    tol = 1e-10 * max(1.0, upper - lower, abs(start))
    places = _reachable(x, lower, upper, start, tol)
    bottom, top = lower, upper
    if t_max is not None:
        bottom = max(lower, start + (t_max + 1) * min(x.values[0], 0))
        top = min(upper, start + (t_max + 1) * max(x.values[-1], 0))
    # If one reading always decides, no mass is left for cells, however narrow x is.
    once = bool(np.all((x.values <= lower - start) | (x.values >= upper - start)))
    exact = once or (places.size < MAX_PLACES and bool(x.heavy.all()))
    n = 0
    if top > bottom and not exact:
        n = 2 * int(np.ceil(max(cells, 4 * (top - bottom) / x.sd) / 2))
        check_size(n, upper)
    edges = np.linspace(bottom, top, n + 1)
    rows = [_from_places(x, places, edges, (lower, upper), tol)]
    if n:
        rows.append(_from_cells(x, edges, places.size))
    return tuple(np.concatenate(parts) for parts in zip(*rows, strict=True))


def _reachable(x: Empirical, lower: float, upper: float, start: float, tol: float) -> Array:
    """Places (k,) between the bounds reached by sums of heavy atoms, the start first."""
    places = frontier = np.array([start])
    while frontier.size and places.size < MAX_PLACES:
        landing = (frontier[:, None] + x.values[x.heavy]).ravel()
        landing = landing[(landing > lower + tol) & (landing < upper - tol)]
        pool = np.concatenate([places, landing])
        first = np.sort(np.unique(np.round(pool / tol), return_index=True)[1])
        frontier = pool[first[first >= places.size]]
        places = np.concatenate([places, frontier])[:MAX_PLACES]
    return places


def _from_places(
    x: Empirical, places: Array, edges: Array, bounds: tuple[float, float], tol: float
) -> tuple[Array, ...]:
    """Rows (k, k + n) of the chain that start on exact places; light atoms end up in cells."""
    lower, upper = bounds
    total, light = x.cumulative
    low = np.searchsorted(x.values, lower - places + tol, "right")  # bounds count as crossed
    met = np.searchsorted(x.values, upper - places - tol)
    high = np.maximum(met, low)
    zero = np.clip(np.searchsorted(x.values, [-tol - places, tol - places], "right"), low, high)
    inner = np.searchsorted(x.values, edges[1:-1] - places[:, None])
    cuts = np.column_stack([low, np.clip(inner, low[:, None], high[:, None]), high])
    k = places.size
    onward = np.zeros((k, k + edges.size - 1))
    if edges.size > 1:
        onward[:, k:] = np.diff(light[cuts], axis=1)
    heavy = np.flatnonzero(x.heavy)
    row, column = np.nonzero((heavy >= low[:, None]) & (heavy < high[:, None]))
    landing, weight = places[row] + x.values[heavy[column]], x.weights[heavy[column]]
    order = np.argsort(places)
    near = order[np.minimum(np.searchsorted(places[order], landing - tol), k - 1)]
    hit = np.abs(places[near] - landing) <= tol
    np.add.at(onward, (row[hit], near[hit]), weight[hit])
    if not hit.all():
        _share(onward[:, k:], row[~hit], landing[~hit], weight[~hit], edges)
    # Both responses get half of the mass that lands on both bounds, or on 0 at the deadline.
    both, even = total[low] - total[np.minimum(met, low)], total[zero[1]] - total[zero[0]]
    upper_, lower_ = total[-1] - total[high] + both / 2, total[low] - both / 2
    above, below = total[high] - total[zero[1]], total[zero[0]] - total[low]
    return onward, upper_, lower_, above + even / 2, below + even / 2


def _share(
    onward: Array, row: NDArray[np.intp], landing: Array, weight: Array, edges: Array
) -> None:
    """Add places that are not followed to the two nearest cells, which preserves their mean."""
    last = edges.size - 2
    offset = np.clip((landing - edges[0]) / (edges[1] - edges[0]) - 0.5, 0, last)
    cell = offset.astype(int)
    np.add.at(onward, (row, cell), weight * (1 - offset + cell))
    np.add.at(onward, (row, np.minimum(cell + 1, last)), weight * (offset - cell))


def _from_cells(x: Empirical, edges: Array, k: int) -> tuple[Array, ...]:
    """Rows (n, k + n) of the chain that start in cells, where the density is piecewise linear.

    A cell shifted by an atom overlaps two cells, in shares that preserve its mean; its slope, from
    its neighbours, removes the spurious variance h^2/6 per step of flat cells.
    """
    n, width = edges.size - 1, edges[1] - edges[0]
    shift = np.clip(x.values / width, -n, n)
    cells = np.floor(shift).astype(int)
    part = shift - cells
    lag, size = cells + n, 2 * n + 2
    tilt = x.weights * part * (1 - part) / 2
    flat, slope = np.zeros(size), np.zeros(size)
    flat += np.bincount(lag, x.weights * (1 - part), size)
    flat += np.bincount(lag + 1, x.weights * part, size)
    slope += np.bincount(lag + 1, tilt, size) - np.bincount(lag, tilt, size)
    rows = _by_cell(flat, n) + _gradient_adjoint(_by_cell(slope, n))
    inside, upper, lower = rows[:, :n], rows[:, n], rows[:, n + 1]
    zero = np.clip(-edges[:-1] / width - 0.5, -0.5, 0.5)  # position of Z = 0 in each cell
    positive = 0.5 - zero + _gradient_adjoint((0.25 - zero**2) / 2)
    onward = np.concatenate([np.zeros((n, k)), inside], axis=1)
    return onward, upper, lower, inside @ positive, inside @ (1 - positive)


def _by_cell(share: Array, n: int) -> Array:
    """Lay shares by lag -n..n+1 out as (n, n + 2): to each cell, beyond the top, the bottom."""
    windows = np.lib.stride_tricks.sliding_window_view(share, n)[n:0:-1]
    below = np.concatenate([[0.0], np.cumsum(share)])
    first = n - np.arange(n)
    return np.column_stack([windows, below[-1] - below[first + n], below[first]])


def _gradient_adjoint(effect: Array) -> Array:
    """Turn the effect of each cell's slope (n, ...) into one of the masses it is taken from."""
    half = effect / 2
    half[0], half[-1] = effect[0], effect[-1]
    out = np.zeros_like(effect)
    out[1:] += half[:-1]
    out[:-1] -= half[1:]
    out[0] -= effect[0]
    out[-1] += effect[-1]
    return out


@dataclass(frozen=True)
class GaussianIncrements:
    """Increments x ~ N(mean, sd), both in nats."""

    mean: float
    sd: float

    def __post_init__(self) -> None:
        check_finite(mean=self.mean)
        check_positive(sd=self.sd)


Increments = GaussianIncrements | Empirical


def gaussian_pair(d: float) -> tuple[GaussianIncrements, GaussianIncrements]:
    """Return x under S1 and S2 for readings of unit variance whose means lie `d` apart.

    x ~ N(-d^2/2, d) under S1 and N(d^2/2, d) under S2, in nats.
    """
    check_positive(d=d)
    return GaussianIncrements(-(d**2) / 2, d), GaussianIncrements(d**2 / 2, d)


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
    x: GaussianIncrements, lower: float, upper: float, start: float, t_max: int | None
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
    check_size(count, upper)
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
    t_max = None if t_max is None else whole("t_max", t_max, 1)
    cells = whole("cells", cells, 4)
    if start > upper or start < lower:
        pmf = None if t_max is None else np.eye(1, t_max + 1)[0]
        return Walk(float(start > upper), float(start < lower), 0.0, 0.0, pmf)
    if isinstance(increments, GaussianIncrements):
        return gaussian_chain(increments, lower, upper, start, t_max).run(t_max)
    moving = t_max is not None or lower == upper or bool(np.any(increments.values != 0))
    require(moving, "increments", "must be other than 0 somewhere, or t_max given", "only 0")
    return Chain(*empirical_chain(increments, lower, upper, start, t_max, cells)).run(t_max)
