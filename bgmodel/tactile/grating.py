"""Stimulus: a rigid square-wave grating with grooves as wide as its bars."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bgmodel.support.checks import check_finite, check_range
from circuits.errors import InputError

PERIODS_MM = (0.0, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0)
"""Periods of the eight stimuli, mm; 0 is smooth (Pestell, Griffith & Lepora 2022)."""


@dataclass(frozen=True)
class Grating:
    """Grating with bars along y, one period apart along x; grooves and bars of equal width."""

    period_mm: float
    """Width of groove plus bar, mm; 0 is a smooth plate (Pestell, Griffith & Lepora 2022)."""
    depth_mm: float = 1.0
    """Depth of the grooves, mm; assumed (no effect above 0.1: the skin bulges in by less)."""
    phase: float = 0.0
    """Distance of a bar's centre from the tip's apex, in periods; at 0 the apex meets a bar."""

    def __post_init__(self) -> None:
        sizes = {"period_mm": self.period_mm, "depth_mm": self.depth_mm}
        check_range(0, np.inf, owner="Grating", **sizes)
        check_finite(owner="Grating", phase=self.phase)

    def half_period_cells(self, dx_mm: float) -> int:
        """Return the number of cells of size `dx_mm` per bar.

        Raises if it is not whole: bars would differ in width, a spurious subharmonic.
        """
        cells = self.period_mm / 2 / dx_mm
        if abs(cells - round(cells)) > 1e-6 or (self.period_mm > 0 and round(cells) < 1):
            raise InputError(
                f"half of period_mm must be a whole number of cells of {dx_mm:g} mm, got "
                f"period_mm = {self.period_mm:g}, half of which is {cells:g} cells",
                "period_mm",
            )
        return round(cells)

    def on_grid(self, cells: int, dx_mm: float) -> tuple[NDArray[np.float64], float]:
        """Return depth below the bars, mm, (cells,), and x of the tip's apex, mm.

        The row of cells is centred on x = 0. The grating is shifted by whole cells only, so that
        every bar keeps its width; the remainder of the phase, at most half a cell, is realised by
        shifting the apex.
        """
        half = self.half_period_cells(dx_mm)
        if half == 0:
            return np.zeros(cells), 0.0
        # The bar nearest the desired position begins at a cell's edge.
        wanted = self.phase * 2 * half
        begin = round(wanted - half / 2 + cells / 2)
        groove = (np.arange(cells) - begin) % (2 * half) >= half
        middle = begin - cells / 2 + half / 2
        return np.where(groove, self.depth_mm, 0.0), (middle - wanted) * dx_mm
