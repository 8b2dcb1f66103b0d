"""Simulated sensor: pin positions in the camera image when a grating is tapped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from bgmodel.support.checks import check_range, whole
from bgmodel.support.processes import check_memory
from bgmodel.support.seeds import stream
from bgmodel.tactile.pressing import PERIODS_MM
from bgmodel.tactile.skin import Skin, Tip
from bgmodel.tactile.taps import Taps
from circuits.arrays import Array, Singles
from circuits.errors import InputError, require

if TYPE_CHECKING:
    import pandas as pd

    from bgmodel.tactile.library import Library

_BLOCK = 512  # taps per block: limits memory, does not change results


@dataclass(frozen=True)
class Nuisance:
    """Variability between taps of the same grating."""

    force_n: tuple[float, float] = (1.2, 1.8)
    """Range of the uniformly distributed force, N; assumed."""
    offset_sd_mm: float = 0.3
    """Standard deviation of the contact position on the tip, per axis, mm; assumed."""
    shear_sd_mm: float = 0.03
    """Standard deviation of the rigid lateral shift of the skin, per axis, mm; assumed."""
    marker_noise_um: float = 9.5
    """Standard deviation of a marker's position at the peak of a tap, per axis, um; assumed:
    reproduces the validation error of the decoder in Pestell, Griffith & Lepora (2022), 27.5
    degrees."""

    def __post_init__(self) -> None:
        sds = ("offset_sd_mm", "shear_sd_mm", "marker_noise_um")
        check_range(0, np.inf, owner="Nuisance", **{name: getattr(self, name) for name in sds})
        require(
            len(self.force_n) == 2 and 0 < self.force_n[0] <= self.force_n[1] < np.inf,
            "force_n",
            "must be (low, high) with 0 < low <= high",
            self.force_n,
            owner="Nuisance",
        )


def simulate(
    periods_mm: ArrayLike,
    yaw_deg: ArrayLike,
    *,
    rng: np.random.Generator,
    tip: Tip | None = None,
    skin: Skin | None = None,
    nuisance: Nuisance | None = None,
    library: Library | None = None,
) -> Taps:
    """Simulate taps on gratings, with periods and yaws, degrees anticlockwise, per tap or for all.

    A pin's tip moves by u(h) - pin_mm grad u_z(h) + r u_z/H, where u is the displacement field of
    the contact library in the frame of the grating. The terms are the displacement of the skin/gel
    interface, its slope, and the outward shift in the image as the pin approaches the camera.

    At a yaw of 0 bars run along y. Noise of a tap does not depend on later taps. Labels: period_mm,
    yaw_deg, phase (periods), force_n, offset_x_mm, offset_y_mm, shear_x_mm, shear_y_mm.
    """
    # Import solvers and compilers only when taps are simulated, not to list options.
    import pandas as pd

    from bgmodel.tactile.library import contact_library
    from bgmodel.tactile.pressing import LibraryPlan

    tip, nuisance = tip or Tip(), nuisance or Nuisance()
    periods, yaws = _stimuli(periods_mm, yaw_deg)
    if library is None:
        library = contact_library(LibraryPlan(skin=skin or Skin(), radius_mm=tip.radius_mm))
    elif skin not in (None, library.plan.skin) or tip.radius_mm != library.plan.radius_mm:
        raise InputError(
            f"library must be for {skin or library.plan.skin} and radius {tip.radius_mm:g} mm, "
            f"got one for {library.plan.skin} and radius {library.plan.radius_mm:g} mm",
            "library",
        )
    # One stream per kind of draw, tap by tap: a tap does not depend on later ones.
    uniform, normal, noise = rng.spawn(3)
    phase, share = uniform.random((len(periods), 2)).T
    place = normal.standard_normal((len(periods), 4))
    low, high = nuisance.force_n
    labels = pd.DataFrame({"period_mm": periods, "yaw_deg": yaws, "phase": phase})
    labels["force_n"] = low + (high - low) * share
    labels[["offset_x_mm", "offset_y_mm"]] = nuisance.offset_sd_mm * place[:, :2]
    labels[["shear_x_mm", "shear_y_mm"]] = nuisance.shear_sd_mm * place[:, 2:]
    moved = noiseless(labels, tip, library)
    jitter = noise.standard_normal(moved.shape, dtype=np.float32)
    moved += jitter * np.float32(nuisance.marker_noise_um * 1e-3)
    return Taps(moved, tip.rest_mm(), labels)


def simulate_taps(
    taps: int = 1000,
    periods_mm: Sequence[float] = PERIODS_MM,
    yaw_deg: Sequence[float] = (),
    *,
    seed: int = 0,
    tip: Tip | None = None,
    skin: Skin | None = None,
    nuisance: Nuisance | None = None,
    workers: int = 1,
) -> Taps:
    """Tap gratings with the simulated TacTip.

    Parameters
    ----------
    taps : int
        Number of taps per grating.
    periods_mm : sequence of float
        Periods of the gratings, mm.
    yaw_deg : sequence of float
        Yaws, used in turn, degrees; without any, uniform in -90..90, as for training. Taps at
        given yaws have other noise than those for training with the same seed.
    seed : int
        Seed of all random numbers.
    tip, skin, nuisance : optional
        The sensor and its variability.
    workers : int
        Number of processes for the contact mechanics, which are solved once and stored.

    Raises
    ------
    ValueError
        As for ``simulate``.
    """
    from bgmodel.tactile.library import contact_library
    from bgmodel.tactile.pressing import LibraryPlan

    tip, skin = tip or Tip(), skin or Skin()
    count = check_taps(taps, periods_mm, tip)
    requested = np.asarray(yaw_deg, dtype=float)
    rng = stream(seed, "simulate", *requested)
    yaws = np.resize(requested, count) if requested.size else rng.uniform(-90, 90, count)
    library = contact_library(LibraryPlan(skin=skin, radius_mm=tip.radius_mm), workers=workers)
    periods = np.repeat(np.asarray(periods_mm, dtype=float), taps)
    return simulate(periods, yaws, rng=rng, tip=tip, nuisance=nuisance, library=library)


def check_taps(taps: int, periods_mm: Sequence[float], tip: Tip) -> int:
    """Return the number of taps of all gratings; ValueError if they need too much memory."""
    count = whole("taps", taps, 1) * len(periods_mm)
    numbers = 2.0 * count * len(tip.rest_mm())
    check_memory(3 * 8 * numbers, f"{taps} taps of {len(periods_mm)} gratings")
    return count


def noiseless(labels: pd.DataFrame, tip: Tip, library: Library) -> Singles:
    """Return peak displacements of the pins without marker noise, mm, (taps, pins, 2).

    They are in the frame of the sensor; labels are those of `simulate`.
    """
    rest = tip.rest_mm()
    out = np.empty((len(labels), len(rest), 2), dtype=np.float32)
    periods = labels["period_mm"].to_numpy()
    for period in np.unique(periods):
        rows = np.flatnonzero(periods == period)
        for part in np.split(rows, range(_BLOCK, len(rows), _BLOCK)):
            out[part] = _pins_moved(float(period), labels.iloc[part], rest, tip, library)
    return out


def _pins_moved(
    period_mm: float, taps: pd.DataFrame, rest: Array, tip: Tip, library: Library
) -> Array:
    """Return displacements (taps, pins, 2) for taps on one grating."""
    yaw = np.deg2rad(taps["yaw_deg"].to_numpy())
    cos, sin = np.cos(yaw), np.sin(yaw)
    # Columns are the grating's axes in the sensor's frame.
    axes = np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2)
    places = rest - taps[["offset_x_mm", "offset_y_mm"]].to_numpy()[:, None]
    phase, force = taps["phase"].to_numpy(), taps["force_n"].to_numpy()
    moved = library.sample(period_mm, phase, force, places @ axes, tip.pin_mm)
    lateral = moved[..., :2] @ axes.transpose(0, 2, 1)
    nearing = rest * (moved[..., 2:] / tip.camera_height_mm)
    shear = taps[["shear_x_mm", "shear_y_mm"]].to_numpy()
    return np.asarray(lateral + nearing + shear[:, None])


def _stimuli(periods_mm: ArrayLike, yaw_deg: ArrayLike) -> tuple[Array, Array]:
    """Return periods and yaws of equal length; ValueError if they do not broadcast."""
    periods, yaws = np.asarray(periods_mm, dtype=float), np.asarray(yaw_deg, dtype=float)
    try:
        periods, yaws = np.broadcast_arrays(np.atleast_1d(periods), np.atleast_1d(yaws))
    except ValueError:
        periods = np.empty((0, 0))
    if periods.ndim != 1:
        raise InputError(
            f"periods_mm, yaw_deg: got shapes {np.shape(periods_mm)} and {np.shape(yaw_deg)}, "
            "must be one-dimensional of equal length, or one of them a number",
            "yaw_deg",
        )
    for name, values in (("periods_mm", periods), ("yaw_deg", yaws)):
        if not np.all(np.isfinite(values)):
            raise InputError(f"{name} must be finite, got NaN or infinity", name)
    return periods.copy(), yaws.copy()
