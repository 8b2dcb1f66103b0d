"""Shapes of a gap over time: one record each, by the name of the model that has it.

The bounds of the evidence are at ``+-a(t)`` with ``a(t) = A (f + (1 - f) g(r t))``: A is ``bound``,
f the share that remains at late times (``floor``), r the rate of the fall (``fall_per_s``), and g
the shape, 1 at 0 and falling to 0. At a rate of 0 every gap is constant.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from bgmodel.fitting.parameters import Parameter
from bgmodel.support.arrays import Array

FALL = Parameter("fall_per_s", 0.0, 10.0, 1.0, "rate at which the gap falls, 1/s; 0 is constant")
STEEPNESS = Parameter(
    "fall_shape",
    1.0,
    6.0,
    3.0,
    "exponent of a Weibull function: 1 falls at once, as exponentially, 6 late and steeply",
)
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


def _exponential(x: Array) -> Array:
    return np.exp(-x)


def _exponential_slope(x: Array) -> Array:
    return -np.exp(-x)


def _hyperbolic(x: Array) -> Array:
    return 1 / (1 + x)


def _hyperbolic_slope(x: Array) -> Array:
    return -1 / (1 + x) ** 2


def _weibull(x: Array, k: float) -> Array:
    return np.exp(-(x**k))


def _weibull_slope(x: Array, k: float) -> Array:
    return np.asarray(-k * x ** (k - 1) * np.exp(-(x**k)))


CONSTANT = Gap("constant_gap", "a(t) = A")
EXPONENTIAL = Gap(
    "falling_gap",
    "exponential, g(x) = exp(-x)",
    (FALL, FLOOR),
)
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
    EXPONENTIAL.name: (_exponential, _exponential_slope),
    HYPERBOLIC.name: (_hyperbolic, _hyperbolic_slope),
    WEIBULL.name: (_weibull, _weibull_slope),
}
"""g and its derivative, of ``x = r t`` and of further parameters: apart from the records, which
are saved."""
