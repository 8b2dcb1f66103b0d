"""The scale on which people differ: linear, except near the lower end of a parameter's range."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bgmodel.fitting.parameters import ParameterSpace
from bgmodel.support.arrays import Array

LOWEST = -12.0
"""Lowest position on the scale: 6e-6 units above the lower end of the range."""
PARTS = 4
"""Typical value of a parameter above the lower end of its range, in units of the scale."""


@dataclass(frozen=True)
class Scale:
    """A parameter is ``low + unit log(1 + exp(x))``, at most ``high``, at x on the scale.

    Well above its lower bound it is linear in x, so that people are Gaussian in the parameter
    itself; near the bound, which it cannot cross, it is exponential.
    """

    low: Array
    high: Array
    unit: Array

    @classmethod
    def of(cls, space: ParameterSpace, typical: Array | None = None) -> Scale:
        """Return the scale for the free parameters of a fit, from ``typical`` values or starts.

        Where these are at the lower bound, a fifth of the range is used. The unit of a coefficient
        is that of the default value of its parameter, divided by its largest weight: far above the
        lower end, people are Gaussian in it. The unit of parameters that differ by factors is
        ``1 / PARTS`` of the range, so that their scale is nearly logarithmic.
        """
        width = space.high - space.low
        above = (space.start if typical is None else typical) - space.low
        above = np.where(above > 1e-3 * width, above, width / 5)
        heights = {each.name: each.start - each.low for each in space.parameters}
        for k, each in enumerate(space.moved):
            if each.effect:
                above[k] = heights[each.parameter.name] / np.abs(each.weights).max()
        return cls(space.low, space.high, np.where(space.by_factors, width, above) / PARTS)

    @property
    def heights(self) -> Array:
        """Ranges of the parameters, in units of the scale, (parameters,)."""
        return np.asarray((self.high - self.low) / self.unit)

    def to(self, natural: Array) -> Array:
        """Return parameters (..., parameters) on the scale."""
        height = (np.asarray(natural, float) - self.low) / self.unit
        with np.errstate(divide="ignore"):
            scaled = height + np.log(-np.expm1(-height))
        return np.asarray(np.maximum(scaled, LOWEST))

    def back(self, scaled: Array) -> Array:
        """Return parameters (..., parameters) in their own units."""
        return np.asarray(np.minimum(self.low + self.unit * np.logaddexp(0, scaled), self.high))

    def slope(self, scaled: Array) -> Array:
        """Return the derivative of a parameter by its position on the scale."""
        return np.asarray(self.unit * np.exp(log_uniform(scaled)))


def log_uniform(scaled: Array) -> Array:
    """Return the log density on the scale of a uniform distribution, up to a constant."""
    return np.asarray(-np.logaddexp(0, -np.asarray(scaled)))
