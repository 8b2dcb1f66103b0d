"""Frictionless contact of the skin with a rigid surface, under a given load."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft

from bgmodel.support.checks import check_positive
from circuits.arrays import Array, Truths
from circuits.errors import InputError, require

Convolution = Callable[[Array, Array], Array]


def wavenumbers(shape: tuple[int, int], dx_mm: float, *, mirrored: bool = False) -> Array:
    """Return the wavenumbers of the coefficients in `polonsky_keer`, 1/mm, (nx // 2 + 1, ny).

    A mirrored surface is symmetric in y, and its cells are those at y > 0.
    """
    along_x = 2 * np.pi * fft.rfftfreq(shape[0], dx_mm)
    if mirrored:
        along_y = np.pi * np.arange(shape[1]) / (shape[1] * dx_mm)
    else:
        along_y = 2 * np.pi * fft.fftfreq(shape[1], dx_mm)
    return np.asarray(np.hypot(along_x[:, None], along_y))


def unfold(half: Array) -> Array:
    """Return the full field (nx, 2 * ny), y increasing, of a mirrored one (nx, ny)."""
    return np.concatenate([half[:, ::-1], half], axis=1)


def polonsky_keer(
    gap_mm: ArrayLike,
    compliance: ArrayLike,
    load_n: float,
    dx_mm: float,
    *,
    tol: float = 1e-6,
    max_iterations: int = 1000,
    start_mpa: ArrayLike | None = None,
    mirrored: bool = False,
) -> Array:
    """Solve for the pressure between an elastic and a rigid surface under a load, MPa, (nx, ny).

    Uses conjugate gradients on the cells in contact (Polonsky & Keer 1999, Wear 231:206), with the
    elastic response (``compliance`` at each of `wavenumbers`, mm/MPa) as a periodic convolution.
    The search is preconditioned by the wavenumber, which is proportional to the stiffness of a
    half-space: for a stiff skin on a soft gel this saves at least half the convolutions. A mirrored
    surface needs half the cells (a cosine transform in y).

    ``gap_mm`` is the height of the rigid surface above the undeformed skin, up to a constant; the
    load is that on the whole surface, both halves if mirrored. ``tol`` bounds the misfit
    (pressure-weighted gap inside the contact, overlap outside it) as a fraction of the range of
    displacements. Cells without a start pressure are added only where surfaces overlap: better
    start from too large a contact area than too small.
    """
    gap, kernel, pressure = _checked(gap_mm, compliance, start_mpa)
    check_positive(load_n=load_n, dx_mm=dx_mm, tol=tol)
    total = load_n / dx_mm**2 / (2 if mirrored else 1)
    stiffness = wavenumbers(gap.shape, dx_mm, mirrored=mirrored)
    convolve = _mirrored_convolution if mirrored else _periodic_convolution
    problem = _Problem(gap, kernel, stiffness, total, convolve)
    return problem.solve(pressure, tol, max_iterations)


def _checked(
    gap_mm: ArrayLike, compliance: ArrayLike, start_mpa: ArrayLike | None
) -> tuple[Array, Array, Array]:
    """Return the three arrays after checking that they are finite and match in shape."""
    gap, kernel = np.asarray(gap_mm, dtype=float), np.asarray(compliance, dtype=float)
    if gap.ndim != 2 or gap.size == 0 or not np.all(np.isfinite(gap)):
        raise InputError.of("gap_mm", "must be (nx, ny) and finite throughout", gap.shape)
    expected = (gap.shape[0] // 2 + 1, gap.shape[1])
    fits = kernel.shape == expected and np.all(kernel >= 0) and np.all(np.isfinite(kernel))
    require(fits, "compliance", f"must be {expected}, finite and not negative", kernel.shape)
    start = np.ones_like(gap) if start_mpa is None else np.asarray(start_mpa, dtype=float)
    fits = start.shape == gap.shape and np.all(start >= 0) and 0 < start.sum() < np.inf
    must = f"must be {gap.shape}, not negative and above 0 somewhere"
    require(fits, "start_mpa", must, start.shape)
    return gap, kernel, start


@dataclass(frozen=True)
class _Problem:
    """Contact problem: quantities that are constant over iterations."""

    gap: Array
    kernel: Array
    stiffness: Array
    total: float
    convolve: Convolution

    def displace(self, pressure: Array) -> Array:
        """Return the displacement of the surface under a pressure."""
        return self.convolve(self.kernel, pressure)

    def descent(self, misfit: Array, touching: Truths) -> Array:
        """Precondition a misfit; a zero sum over the contact conserves the load."""
        change = self.convolve(self.stiffness, misfit)
        return np.where(touching, change - change[touching].mean(), 0.0)

    def advance(self, pressure: Array, change: Array, overlap: Array, step: float) -> Array:
        """Take a step; pressures stay non-negative, and overlapping cells enter the contact."""
        moved = np.maximum(pressure - step * change, 0.0)
        if overlap.any():
            entering = -step * self.convolve(self.stiffness, overlap)
            moved = np.where(overlap < 0, np.maximum(entering, 0.0), moved)
        return moved

    def solve(self, pressure: Array, tol: float, max_iterations: int) -> Array:
        """Iterate from an initial pressure until the misfit is below `tol`."""
        pressure = pressure * (self.total / pressure.sum())
        displacement = self.displace(pressure)
        direction, before = np.zeros_like(self.gap), None
        error = scale = slope = np.nan
        for _ in range(max_iterations):
            touching = pressure > 0
            clearance = self.gap + displacement
            clearance -= clearance[touching].mean()
            error, scale = _misfit(clearance, pressure, touching), np.ptp(displacement)
            if error <= tol * scale:
                return pressure
            misfit = np.where(touching, clearance, 0.0)
            descent = self.descent(misfit, touching)
            momentum = 0.0
            if before is not None:  # Polak-Ribiere: resets itself when the contact changes
                momentum = max(0.0, np.vdot(descent, misfit - before) / slope)
            direction = np.where(touching, descent + momentum * direction, 0.0)
            response = self.displace(direction)
            curvature = np.vdot(response - response[touching].mean(), direction)
            step = np.vdot(misfit, direction) / curvature
            slope = np.vdot(misfit, descent)

            overlap = np.where(touching, 0.0, np.minimum(clearance, 0.0))
            moved = self.advance(pressure, direction, overlap, step)
            gain = self.total / moved.sum()
            if np.array_equal(moved > 0, touching):  # linear: this saves a convolution
                displacement = (displacement - step * response) * gain
            else:
                displacement = self.displace(moved * gain)
            pressure = moved * gain
            before = None if overlap.any() else misfit
        raise RuntimeError(
            f"polonsky_keer: misfit {error / scale:.1e} after {max_iterations} iterations, "
            f"above tol = {tol:.1e}; allow more iterations or a larger tol"
        )


def _misfit(clearance: Array, pressure: Array, touching: Truths) -> float:
    """Return the larger of pressure-weighted rms gap and overlap per touching cell, mm."""
    inside = np.sqrt(np.vdot(pressure, clearance**2) / pressure.sum())
    outside = -np.minimum(clearance[~touching], 0.0).sum() / np.count_nonzero(touching)
    return float(max(inside, outside))


def _periodic_convolution(kernel: Array, values: Array) -> Array:
    # The order of axes matters: rfft2 halves the last one.
    spectrum = fft.rfft2(values, axes=(1, 0))
    spectrum *= kernel
    moved = fft.irfft2(spectrum, s=values.shape[::-1], axes=(1, 0), overwrite_x=True)
    return np.asarray(moved)


def _mirrored_convolution(kernel: Array, values: Array) -> Array:
    spectrum = fft.rfft(fft.dct(values, axis=1), axis=0)
    spectrum *= kernel
    rows = fft.irfft(spectrum, n=values.shape[0], axis=0, overwrite_x=True)
    return np.asarray(fft.idct(rows, axis=1, overwrite_x=True))
