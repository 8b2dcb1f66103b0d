"""The scale on which people differ: parameters with a range become numbers without one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bgmodel.support.arrays import Array

FURTHEST = 12.0
"""Largest distance from the middle of a range on the scale: 6e-6 of the range from its end."""


@dataclass(frozen=True)
class Scale:
    """The log odds of the position of each parameter within its range.

    For a parameter far below its upper bound this is nearly its logarithm. A logistic
    distribution on the scale is a uniform one over the range.

    Parameters
    ----------
    low, high : array (parameters,)
        Bounds of the parameters.
    """

    low: Array
    high: Array

    def to(self, natural: Array) -> Array:
        """Return parameters (..., parameters) on the scale."""
        place = (np.asarray(natural, float) - self.low) / (self.high - self.low)
        with np.errstate(divide="ignore"):
            odds = np.log(place) - np.log1p(-place)
        return np.asarray(np.clip(odds, -FURTHEST, FURTHEST))

    def back(self, scaled: Array) -> Array:
        """Return parameters (..., parameters) in their own units."""
        from scipy.special import expit

        return np.asarray(self.low + (self.high - self.low) * expit(scaled))

    def slope(self, scaled: Array) -> Array:
        """Return the derivative of a parameter by its position on the scale."""
        from scipy.special import expit

        share = expit(scaled)
        return np.asarray((self.high - self.low) * share * (1 - share))


def log_logistic(scaled: Array) -> Array:
    """Return the log density of the standard logistic distribution."""
    size = np.abs(scaled)
    return np.asarray(-size - 2 * np.log1p(np.exp(-size)))
