"""The sequential test as a model of choices and times: with a constant gap, or one that falls."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from bgmodel.arrays import Array
from bgmodel.fitting import passage
from bgmodel.fitting.parameters import RESPONSE, Parameter
from bgmodel.fitting.responses import BIN_S, Grid

SENSITIVITY = Parameter(
    "sensitivity", 0.1, 100.0, 10.0, "drift per unit of strength, 1/sqrt(s), of unit noise"
)
BOUND = Parameter("bound", 0.1, 8.0, 0.7, "half of the gap in units of the noise, sqrt(s)")
FALL = Parameter("fall_s", 0.1, 20.0, 1.0, "time in which the gap falls by a factor e, s")


class Model(Protocol):
    """What a fit asks of a model: its parameters, and when it decides."""

    @property
    def name(self) -> str:
        """What it is called."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All that can be moved, those of responses last."""

    @property
    def criterion_name(self) -> str:
        """The parameter that says how much evidence a decision takes."""

    def decided(self, values: Mapping[str, Array], strength: Array, grid: Grid) -> Array:
        """Return the probability of a decision for response 0 and 1 in each bin, (cells, 2, bins).

        Parameters
        ----------
        values : dict of str to array (cells,)
            Its parameters in every cell.
        strength : array (cells,)
            Evidence for response 1.
        grid : Grid
            Bins.
        """

    def identity(self) -> dict[str, object]:
        """Return all that its numbers depend on, for provenance."""


@dataclass(frozen=True)
class GapModel:
    """The sequential test in continuous time, exactly.

    Parameters
    ----------
    falls : bool
        Whether the gap falls, by a factor e in every ``fall_s``.
    """

    falls: bool = False

    @property
    def name(self) -> str:
        """``constant_gap`` or ``falling_gap``."""
        return "falling_gap" if self.falls else "constant_gap"

    @property
    def criterion_name(self) -> str:
        """``bound``."""
        return BOUND.name

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Sensitivity, bound, its fall, and those of responses."""
        return (SENSITIVITY, BOUND, *((FALL,) if self.falls else ()), *RESPONSE)

    def decided(self, values: Mapping[str, Array], strength: Array, grid: Grid) -> Array:
        """Return the probability of a decision in each bin; see ``Model``."""
        drift = values["sensitivity"] * strength
        bound = values["bound"]
        falls = values["fall_s"] if self.falls else np.full(len(bound), np.inf)
        found = np.empty((len(strength), 2, grid.bins))
        shapes = np.stack([bound, falls], axis=1)
        for shape in np.unique(shapes, axis=0):
            cells = (shapes == shape).all(axis=1)
            at_rest, gap = self._at_rest(float(shape[0]), float(shape[1]), grid)
            density = passage.with_drift(at_rest, gap, grid.middles_s, drift[cells])
            found[cells] = density * BIN_S
        return found

    def _at_rest(self, bound: float, fall_s: float, grid: Grid) -> tuple[Array, Array]:
        """Return the density without drift in the middles of the bins, and the bound there."""
        if not self.falls:
            return passage.constant_at_rest(bound, grid.middles_s), np.full(grid.bins, bound)
        gap, slope = passage.exponential(bound, fall_s)
        halves = np.arange(1, 2 * grid.bins) * BIN_S / 2
        return passage.falling_at_rest(gap, slope, halves)[::2], gap(grid.middles_s)

    def identity(self) -> dict[str, object]:
        """Return its name: there is nothing else to it."""
        return {"model": self.name}
