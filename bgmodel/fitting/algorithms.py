"""The sequential test as a model of choices and times, with a constant or a falling gap."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from bgmodel.fitting import passage
from bgmodel.fitting.parameters import RESPONSE, Parameter
from bgmodel.fitting.responses import BIN_S, Grid
from bgmodel.support.arrays import Array, Integers

SENSITIVITY = Parameter(
    "sensitivity", 0.02, 18.0, 4.0, "drift per unit of strength, 1/sqrt(s), of unit noise"
)
"""Bounds and start for a largest strength of 1; ``likelihood_of`` divides them by the largest."""
BOUND = Parameter("bound", 0.1, 8.0, 0.7, "half of the gap in units of the noise, sqrt(s)")
FALL = Parameter(
    "fall_per_s", 0.0, 10.0, 1.0, "rate at which the gap falls exponentially, 1/s; 0 is constant"
)
START = Parameter(
    "start",
    -0.9,
    0.9,
    0.0,
    "start of the evidence as a share of the bound: 1 is that of response 1, -1 that of response 0",
    free=False,
)
"""A bias to one response; none by default."""


EARLY, PARTS = 20, 8
"""Number of early bins, in which densities may change fast, and the number of their parts."""


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

        Parameters
        ----------
        values : dict of str to array (cells,)
            The parameters in every cell.
        strength : array (cells,)
            Evidence for response 1.
        grid : Grid
            Bins.
        """

    def halves(self) -> tuple[Model, Model]:
        """Return two copies of the model whose simulation errors, if any, are independent."""

    def left_out(self) -> tuple[Model, ...]:
        """Return the model without each part of its simulated trials in turn; empty if exact."""

    def identity(self) -> dict[str, object]:
        """Return all that its predictions depend on, for provenance."""


@dataclass(frozen=True)
class GapModel:
    """The sequential test in continuous time, computed exactly.

    Parameters
    ----------
    falls : bool
        Whether the gap falls, as ``exp(-fall_per_s t)``. At a rate of 0 it is the constant gap.
    """

    falls: bool = False

    @property
    def name(self) -> str:
        """``constant_gap`` or ``falling_gap``."""
        return "falling_gap" if self.falls else "constant_gap"

    @property
    def threshold_name(self) -> str:
        """``bound``."""
        return BOUND.name

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Sensitivity, bound, its rate of fall, start, and parameters of responses."""
        return (SENSITIVITY, BOUND, *((FALL,) if self.falls else ()), START, *RESPONSE)

    def decided(self, values: Mapping[str, Array], strength: Array, grid: Grid) -> Array:
        """Return the probability of a decision in each bin; see ``Model``."""
        bound = values["bound"]
        start = bound * values.get("start", np.zeros(len(bound)))
        # A start on the other side is the mirror image: densities are computed once for both.
        mirrored = start < 0
        start, drift = (
            np.abs(start),
            values["sensitivity"] * np.where(mirrored, -strength, strength),
        )
        falls = values["fall_per_s"] if self.falls else np.zeros(len(bound))
        found = np.empty((len(strength), 2, grid.bins))
        time_s, width_s, first = _parts(grid.bins)
        shapes = np.stack([bound, falls, start], axis=1)
        for shape in np.unique(shapes, axis=0):
            cells = (shapes == shape).all(axis=1)
            a, fall, z = map(float, shape)
            at_rest, gap = self._at_rest(a, fall, z, time_s, width_s)
            mass = passage.with_drift(at_rest, gap, time_s, drift[cells], z) * width_s
            found[cells] = np.add.reduceat(mass, first, axis=2)
        found[mirrored] = found[mirrored, ::-1]
        return found

    def _at_rest(
        self, bound: float, fall_per_s: float, start: float, time_s: Array, width_s: Array
    ) -> tuple[Array, Array]:
        """Return the densities without drift at times, and the bound at these times."""
        if fall_per_s == 0:
            at_rest = passage.constant_at_rest(bound, time_s, start)
            return at_rest, np.full(len(time_s), bound)
        gap, slope = passage.exponential(bound, 1 / fall_per_s)
        return passage.falling_at_rest(gap, slope, time_s, width_s, start), gap(time_s)

    def halves(self) -> tuple[Model, Model]:
        """Return itself twice, since it is exact."""
        return self, self

    def left_out(self) -> tuple[Model, ...]:
        """Return an empty tuple, since no trial is simulated."""
        return ()

    def identity(self) -> dict[str, object]:
        """Return its name, which is all that it depends on."""
        return {"model": self.name}


def _parts(bins: int) -> tuple[Array, Array, Integers]:
    """Return middles and widths of the parts of all bins, s, and the first part of each bin."""
    parts = np.where(np.arange(bins) < EARLY, PARTS, 2)
    width_s = np.repeat(BIN_S / parts, parts)
    return width_s.cumsum() - width_s / 2, width_s, parts.cumsum() - parts
