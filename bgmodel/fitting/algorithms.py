"""The sequential test as a model of choices and times, its gap constant or falling.

The bounds of the evidence are at ``+-a(t)`` with ``a(t) = A (f + (1 - f) g(r t))``: A is ``bound``,
f the share that remains at late times (``floor``), r the rate of the fall (``fall_per_s``), and g
the shape, 1 at 0 and falling to 0. At a rate of 0 every gap is constant.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Protocol

import numpy as np

from bgmodel.fitting import passage
from bgmodel.fitting.parameters import RESPONSE, Parameter
from bgmodel.fitting.responses import Grid
from circuits.arrays import Array, Integers, Truths

FALL = Parameter("fall_per_s", 0.0, 10.0, 1.0, "rate at which the gap falls, 1/s; 0 is constant")
STEEPNESS = Parameter(
    "fall_shape", 1.0, 6.0, 3.0,
    "exponent of a Weibull function: 1 falls at once, as exponentially, 6 late and steeply",
)  # fmt: skip
FLOOR = Parameter(
    "floor", 0.0, 0.95, 0.0, "share of the bound that remains at late times", free=False
)


@dataclass(frozen=True)
class Gap:
    """A shape of the gap over time."""

    name: str  # Name of the model that has this gap.
    about: str  # Equation and source.
    parameters: tuple[Parameter, ...] = ()  # Without the bound; further ones follow the rate.

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its parameters."""
        return tuple(each.name for each in self.parameters)

    def at(self, bound: float, values: Mapping[str, float], time_s: Array) -> tuple[Array, Array]:
        """Return the bound a(t) at some times, s, in sqrt(s), and its derivative, 1/sqrt(s)."""
        rate, floor = values.get(FALL.name, 0.0), values.get(FLOOR.name, 0.0)
        more = [values[name] for name in self.names if name not in (FALL.name, FLOOR.name)]
        x = rate * np.asarray(time_s, float)
        falls = bound * (1 - floor)
        left, slope = SHAPES[self.name]
        return bound * floor + falls * left(x, *more), falls * rate * slope(x, *more)


CONSTANT = Gap("constant_gap", "a(t) = A")
EXPONENTIAL = Gap("falling_gap", "exponential, g(x) = exp(-x)", (FALL, FLOOR))
HYPERBOLIC = Gap(
    "hyperbolic_gap",
    "hyperbolic, g(x) = 1 / (1 + x) (Voskuilen, Ratcliff & Smith 2016)",
    (FALL, FLOOR),
)
WEIBULL = Gap(
    "weibull_gap",
    "Weibull, g(x) = exp(-x^k), with k the shape (Hawkins et al. 2015)",
    (FALL, STEEPNESS, FLOOR),
)
GAPS = {each.name: each for each in (CONSTANT, EXPONENTIAL, HYPERBOLIC, WEIBULL)}
"""The shapes by the name of the model."""
SHAPES: dict[str, tuple[Callable[..., Array], Callable[..., Array]]] = {
    CONSTANT.name: (np.ones_like, np.zeros_like),
    EXPONENTIAL.name: (lambda x: np.exp(-x), lambda x: -np.exp(-x)),
    HYPERBOLIC.name: (lambda x: 1 / (1 + x), lambda x: -1 / (1 + x) ** 2),
    WEIBULL.name: (
        lambda x, k: np.exp(-(x**k)),
        lambda x, k: np.asarray(-k * x ** (k - 1) * np.exp(-(x**k))),
    ),
}
"""g and its derivative, of ``x = r t`` and of further parameters: apart from the records, which
are saved."""


SENSITIVITY = Parameter(
    "sensitivity", 0.02, 18.0, 4.0, "drift per unit of strength, 1/sqrt(s), of unit noise"
)
"""Bounds and start for a largest strength of 1; ``likelihood_of`` divides them by the largest."""
BOUND = Parameter("bound", 0.1, 8.0, 0.7, "half of the gap in units of the noise, sqrt(s)")
START = Parameter(
    "start", -0.9, 0.9, 0.0,
    "start of the evidence as a share of the bound: 1 is that of response 1, -1 that of response 0",
    free=False,
)  # fmt: skip
BIAS = Parameter(
    "bias_nats", -1.2, 1.2, 0.0,
    "constant input of the channel of response 1, or if negative of response 0, in the circuit's "
    "nats", free=False,
)  # fmt: skip
"""Biases of the test and of a circuit to one response; none by default."""
SIDED = (START.name, BIAS.name)
"""Parameters that depend on which response is called 1."""
SPREAD = Parameter(
    "start_spread", 0.0, 0.9, 0.0,
    "half of the range from which the start is drawn uniformly in each trial, as a share of the "
    "distance between its mean and the nearer bound", free=False,
)  # fmt: skip
DRIFT_SD = Parameter(
    "drift_sd", 0.0, 5.0, 0.0, "standard deviation of the drift across trials, 1/sqrt(s)",
    free=False,
)  # fmt: skip
STARTS = 12
"""Number of starts, in Gauss-Legendre quadrature, over which densities are averaged."""

EARLY, PARTS, FIRST, LATE = 20, 8, 32, 200
"""Number of early bins, in which densities may change fast, and of the parts of each; number of
parts of the first bin; first of the late bins, which have one part each. Bins between have two."""


class Model(Protocol):
    """Interface of a model for fits: its parameters, and the distribution of its decisions."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters, those of responses last."""

    @property
    def threshold_name(self) -> str:
        """The parameter that sets how much evidence a decision requires."""

    def decided(self, values: Mapping[str, Array], strength: Array, grid: Grid) -> Array:
        """Return the probability of a decision for response 0 and 1 in each bin, (cells, 2, bins).

        ``values`` has each parameter in every cell, (cells,); ``strength`` (cells,) is the evidence
        for response 1.
        """

    def halves(self) -> tuple[Model, Model]:
        """Return two copies of the model whose simulation errors, if any, are independent."""
        return self, self

    def left_out(self) -> tuple[Model, ...]:
        """Return the model without each part of its simulated trials in turn; empty if exact."""
        return ()

    def identity(self) -> dict[str, object]:
        """Return all that its predictions depend on, for provenance."""


@dataclass(frozen=True)
class GapModel(Model):
    """The sequential test in continuous time, computed exactly."""

    gap: Gap = CONSTANT
    any_width: ClassVar = True
    threshold_name: ClassVar[str] = BOUND.name

    @property
    def name(self) -> str:
        """Name of its gap, such as ``constant_gap``."""
        return self.gap.name

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Sensitivity, bound and its fall, start, variability, and parameters of responses."""
        return (SENSITIVITY, BOUND, *self.gap.parameters, START, SPREAD, DRIFT_SD, *RESPONSE)

    def decided(self, values: Mapping[str, Array], strength: Array, grid: Grid) -> Array:
        """Return the probability of a decision in each bin; see ``Model``."""
        none = np.zeros(len(strength))
        start, drift_sd = values.get(START.name, none), values.get(DRIFT_SD.name, none)
        # A start on the other side is the mirror image: densities are computed once for both.
        mirrored = start < 0
        drift = values[SENSITIVITY.name] * np.where(mirrored, -strength, strength)
        names = (BOUND.name, SPREAD.name, *self.gap.names)
        settings = np.stack([np.abs(start), *(values.get(name, none) for name in names)], axis=1)
        probability = np.zeros((len(strength), 2, grid.bins))
        time_s, width_s, bins = _parts(grid.bins, grid.width_s)
        every = distinct(settings)
        for setting in every:
            cells: slice | Truths = (
                slice(None) if len(every) == 1 else (settings == setting).all(axis=1)
            )
            share, bound, spread, *falls = map(float, setting)
            starts, weights = _starts(bound * share, spread * bound * (1 - share))
            shape = dict(zip(self.gap.names, falls, strict=True))
            at_rest, gap = self._at_rest(bound, shape, starts, time_s, width_s)
            for one, z, weight in zip(at_rest, starts, weights, strict=True):
                here = (drift[cells], float(z), drift_sd[cells])
                probability[cells] += weight * passage.binned(
                    one, gap, time_s, *here, width_s=width_s, bins=bins
                )
        probability[mirrored] = probability[mirrored, ::-1]
        return probability

    def _at_rest(
        self, bound: float, shape: Mapping[str, float], starts: Array, time_s: Array, width_s: Array
    ) -> tuple[Array, Array]:
        """Return densities without drift (starts, 2, times), and the bound at these times."""
        if shape.get(FALL.name, 0.0) == 0:
            at_rest = passage.constant_at_rest(bound, time_s, starts)
            return at_rest, np.full(len(time_s), bound)
        gap, slope = self.gap.at(bound, shape, time_s)
        return passage.falling_at_rest(gap, slope, time_s, width_s, starts), gap

    def identity(self) -> dict[str, object]:
        """Return its name, which is all that it depends on."""
        return {"model": self.name}


def distinct(settings: Array) -> Array:
    """Return the distinct rows; cells mostly have one setting, and sorting rows is slow."""
    same = (settings == settings[0]).all()
    return settings[:1] if same else np.unique(settings, axis=0)


def _starts(mean: float, half: float) -> tuple[Array, Array]:
    """Return starts in the range of some half width around a mean, sqrt(s), and their weights."""
    if half == 0:
        return np.array([mean]), np.ones(1)
    nodes, weights = np.polynomial.legendre.leggauss(STARTS)
    return mean + half * nodes, weights / 2


@lru_cache(maxsize=64)
def _parts(bins: int, bin_s: float) -> tuple[Array, Array, Integers]:
    """Return middles and widths of the parts of all bins, s, and the bin of each part."""
    parts = np.select([np.arange(bins) < EARLY, np.arange(bins) < LATE], [PARTS, 2], 1)
    parts[0] = FIRST
    width_s = np.repeat(bin_s / parts, parts)
    # Narrow at first: from a start near a bound, densities have their peak within a millisecond.
    width_s[:FIRST] = np.diff(bin_s * np.linspace(0, 1, FIRST + 1) ** 2)
    return width_s.cumsum() - width_s / 2, width_s, np.repeat(np.arange(bins), parts)
