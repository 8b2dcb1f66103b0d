"""A unit of rate: a population too large, or too abstract, for cells."""

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
    """A noiseless unit that passes the rate of its line on.

    Parameters
    ----------
    signed : bool
        Whether the rate stands for the difference from a tonic level, and so may be negative.
    """

    signed: bool = False
    spikes: ClassVar[bool] = False
    of_rates: ClassVar[tuple[str, ...]] = ("signed",)

    def __post_init__(self) -> None:
        check_types(self, "a Rate cell")

    @property
    def lowest_hz(self) -> float:
        """None where the rate stands for a difference."""
        return -np.inf if self.signed else 0.0

    def response(self, x: Array, line: Line, frequency_hz: Array) -> Response:
        """Return the slopes of its line: it has no noise and no lag."""
        return Response(line.slope[:, None], line.curvature[:, None] / 2, np.zeros((len(x), 1)))
