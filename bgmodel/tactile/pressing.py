"""Gratings pressed on the skin: contacts to solve and displacement fields at the pins."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from bgmodel.support.checks import check_finite, check_positive, check_range
from bgmodel.tactile.contact import polonsky_keer, unfold, wavenumbers
from bgmodel.tactile.skin import Skin, response
from circuits.arrays import Array, Singles
from circuits.errors import InputError, require

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


FORMAT = 2  # increment if values or layout change, so that older files are not used


@dataclass(frozen=True)
class LibraryPlan:
    """Contents of a contact library; equal plans share a file."""

    skin: Skin = field(default_factory=Skin)
    """Layers of the skin."""
    radius_mm: float = 20.0
    """Radius of the dome, mm; tip diameter 40 mm (Pestell, Griffith & Lepora 2022)."""
    depth_mm: float = 1.0
    """Depth of the grooves, mm; assumed (no effect above 0.1)."""
    periods_mm: tuple[float, ...] = PERIODS_MM
    """Grating periods, mm; the eight stimuli of Pestell, Griffith & Lepora (2022)."""
    phases: int = 8
    """Phases per period, interpolated trigonometrically; assumed, error below marker noise."""
    forces_n: tuple[float, ...] = (1.2, 1.5, 1.8)
    """Forces, N, interpolated by a polynomial; assumed, error below marker noise."""
    side_mm: float = 32.0
    """Side of the periodic square in which the contact is solved, mm; assumed."""
    field_side_mm: float = 96.0
    """Side of the periodic square in which the displacement field is computed, mm; assumed. In a
    smaller square, periodic images would reveal the square's orientation to the outer pins."""
    kept_mm: float = 36.0
    """Side of the square of the field that is stored, mm; must contain all pins; assumed."""
    dx_mm: float = 0.125
    """Cell size in the contact solver, mm; assumed."""
    stored_dx_mm: float = 0.25
    """Size of a stored cell, mm; sufficient because the skin transmits no finer detail."""
    tol: float = 1e-6
    """Tolerance of the contact solver, as a fraction of the displacement."""

    def __post_init__(self) -> None:
        for name in ("periods_mm", "forces_n"):  # lists are accepted, but a plan must be hashable
            object.__setattr__(self, name, tuple(float(v) for v in getattr(self, name)))
        sides = ("side_mm", "field_side_mm", "kept_mm")
        positive = ("radius_mm", "depth_mm", *sides, "dx_mm", "stored_dx_mm", "tol")
        check_positive(owner="LibraryPlan", **{name: getattr(self, name) for name in positive})
        require(self.phases >= 2, "phases", "must be 2 or more", self.phases, owner="LibraryPlan")
        require(
            len(self.forces_n) >= 2 and np.all(np.diff(self.forces_n, prepend=0.0) > 0),
            "forces_n",
            "must be two or more forces above 0, increasing",
            self.forces_n,
            owner="LibraryPlan",
        )
        require(
            self.field_side_mm >= max(self.side_mm, self.kept_mm),
            "field_side_mm",
            f"must be at least side_mm = {self.side_mm:g} and kept_mm = {self.kept_mm:g}",
            self.field_side_mm,
            owner="LibraryPlan",
        )
        for side, name in product(sides, ("dx_mm", "stored_dx_mm")):
            side_mm = getattr(self, side)
            cells = side_mm / 2 / getattr(self, name)
            if abs(cells - round(cells)) > 1e-9 or self.stored_dx_mm < self.dx_mm:
                raise InputError(
                    f"LibraryPlan.{name}: got dx_mm = {self.dx_mm!r} and stored_dx_mm = "
                    f"{self.stored_dx_mm!r}, must both divide half of "
                    f"{side} = {side_mm:g}, and stored_dx_mm must not be smaller than dx_mm",
                    name,
                )
        for period in self.periods_mm:
            Grating(period).half_period_cells(self.dx_mm)

    @property
    def key(self) -> dict[str, Any]:
        """All parameters, the same for equal plans."""
        # Convert every number to float: plans with 20 and 20.0 are equal and must share a file.
        key: dict[str, Any] = json.loads(json.dumps(asdict(self)), parse_int=float)
        return key

    @property
    def stored_cells(self) -> int:
        """Number of stored cells per side."""
        return round(self.kept_mm / self.stored_dx_mm)

    def solved_phases(self, period_mm: float) -> int:
        """Return the number of phases to solve; the others are mirror images."""
        return self.phases // 2 + 1 if period_mm > 0 else 1


def press(plan: LibraryPlan, period_mm: float, phase: float) -> Singles:
    """Solve for displacements of the skin/gel interface under a grating, (forces, n, n, 5).

    The phase is the distance of a bar's centre from the apex, in periods. Values as in
    ``Library.fields``, on cells of ``stored_dx_mm`` with the apex at the centre.
    """
    cells, dx = round(plan.side_mm / plan.dx_mm), plan.dx_mm
    groove, apex = Grating(period_mm, plan.depth_mm, phase).on_grid(cells, dx)
    place = (np.arange(cells) - (cells - 1) / 2) * dx
    dome = ((place[:, None] - apex) ** 2 + place[cells // 2 :] ** 2) / (2 * plan.radius_mm)
    compliance = _compliance(plan)
    fields, pressure = [], None
    # In decreasing order of force: too large a contact is a better start than too small.
    for force in reversed(plan.forces_n):
        pressure = polonsky_keer(
            dome + groove[:, None],
            compliance,
            force,
            dx,
            tol=plan.tol,
            start_mpa=pressure,
            mirrored=True,
        )
        fields.append(_interface(plan, unfold(pressure), apex))
    return np.stack(fields[::-1]).astype(np.float32)


@lru_cache(maxsize=4)
def _compliance(plan: LibraryPlan) -> Array:
    """Return the surface compliance on the half grid of the contact solver."""
    cells = round(plan.side_mm / plan.dx_mm)
    k = wavenumbers((cells, cells // 2), plan.dx_mm, mirrored=True)
    return response(plan.skin, k).compliance


@lru_cache(maxsize=4)
def _transfers(plan: LibraryPlan) -> NDArray[np.complex128]:
    """Return lateral x, y, depth and its slopes, (5, n, n // 2 + 1), per MPa of pressure wave."""
    n = round(plan.field_side_mm / plan.stored_dx_mm)
    x, y = _frequencies(n, plan.stored_dx_mm)
    k = np.hypot(x, y)
    waves = response(plan.skin, k)
    lateral = 1j * waves.interface_lateral / np.where(k > 0, k, 1)
    depth = waves.interface_depth
    transfers = np.stack([x * lateral, y * lateral, depth + 0j, 1j * x * depth, 1j * y * depth])
    # The sign of the highest frequency is undefined; the skin filters it out anyway.
    transfers[:, n // 2], transfers[:, :, n // 2] = 0.0, 0.0
    return transfers


def _frequencies(n: int, dx_mm: float) -> tuple[Array, Array]:
    """Return angular frequencies along x (n, 1) and y (n // 2 + 1,) of a real FFT, per mm."""
    return 2 * np.pi * fft.fftfreq(n, dx_mm)[:, None], 2 * np.pi * fft.rfftfreq(n, dx_mm)


def _interface(plan: LibraryPlan, pressure_mpa: Array, apex_mm: float) -> Array:
    """Return fields (n, n, 5) under a pressure, on stored cells centred on the apex."""
    beside = round((plan.field_side_mm - plan.side_mm) / plan.dx_mm / 2)
    pressure_mpa = np.pad(pressure_mpa, beside)
    fine, n = len(pressure_mpa), round(plan.field_side_mm / plan.stored_dx_mm)
    kept = np.round(fft.fftfreq(n) * n).astype(int)
    spectrum = fft.rfft2(pressure_mpa)[kept, : n // 2 + 1] * (n / fine) ** 2
    # The first stored cell and the first fine cell have different centres.
    x, y = _frequencies(n, plan.stored_dx_mm)
    offset = (plan.stored_dx_mm - plan.dx_mm) / 2
    spectrum *= np.exp(1j * x * (offset + apex_mm)) * np.exp(1j * y * offset)
    first = (n - plan.stored_cells) // 2
    middle = slice(first, first + plan.stored_cells)
    fields = fft.irfft2(spectrum * _transfers(plan), s=(n, n))[:, middle, middle]
    return np.moveaxis(fields, 0, -1)
