"""A rate unit: a population too large, or too abstract, to be simulated cell by cell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from circuits.arrays import Array
from circuits.cells.cell import Cell, Line, Response, register
from circuits.checks import check_types


@register
@dataclass(frozen=True)
class Rate(Cell):
    """A noiseless unit that transmits the rate of its line."""

    #: Whether the rate is a difference from a tonic level, which may be negative.
    signed: bool = False
    spikes: ClassVar[bool] = False
    of_rates: ClassVar[tuple[str, ...]] = ("signed",)

    def __post_init__(self) -> None:
        check_types(self, "a Rate cell")

    @property
    def lowest_hz(self) -> float:
        """Lowest rate, Hz: 0, or -inf if the rate is a difference."""
        return -np.inf if self.signed else 0.0

    def response(self, x: Array, line: Line, frequency_hz: Array) -> Response:
        """Return the slopes of its line: it has no noise and no lag."""
        return Response(line.slope[:, None], line.curvature[:, None] / 2, np.zeros((len(x), 1)))
