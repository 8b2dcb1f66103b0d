"""The simulated sensor: where the camera sees the pins when a grating is tapped."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bgmodel.support.arrays import Array, Singles
from bgmodel.support.checks import check_range
from bgmodel.tactile.skin import Skin
from bgmodel.tactile.taps import Taps
from bgmodel.tactile.tips import Tip
from circuits.errors import InputError, require

if TYPE_CHECKING:
    import pandas as pd

    from bgmodel.tactile.library import Library

_BLOCK = 512  # taps at a time: bounds the memory, and changes no number


@dataclass(frozen=True)
class Nuisance:
    """What differs from tap to tap besides the grating."""

    force_n: tuple[float, float] = (1.2, 1.8)
    """Range of the uniform force, N; assumed."""
    offset_sd_mm: float = 0.3
    """Standard deviation of the place of contact on the tip, each axis, mm; assumed."""
    shear_sd_mm: float = 0.03
    """Standard deviation of the rigid lateral shift of the skin, each axis, mm; assumed."""
    marker_noise_um: float = 9.5
    """Standard deviation of a marker's place in a frame, each axis, um; assumed: it gives the
    decoder the validation error of Pestell, Griffith & Lepora (2022), 27.5 degrees."""
    noise_per: Literal["tap", "frame"] = "tap"
    """Noise drawn once for the peak of a tap, or in each frame of it, the frame of largest summed
    displacement being kept (Pestell, Griffith & Lepora 2022); assumed."""
    frames: int = 15
    """Frames of a tap if noise is drawn for each; assumed. The press rises and falls as a half
    sine, all displacements in proportion."""

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
        known = self.noise_per in ("tap", "frame")
        require(known, "noise_per", "must be 'tap' or 'frame'", self.noise_per, owner="Nuisance")
        require(self.frames >= 1, "frames", "must be 1 or more", self.frames, owner="Nuisance")

    def press_profile(self) -> Singles:
        """Share of the peak displacement in each frame, (frames,): a half sine with peak 1."""
        if self.noise_per == "tap":
            return np.ones(1, dtype=np.float32)
        rise = np.sin(np.pi * np.arange(1, self.frames + 1) / (self.frames + 1))
        return np.asarray(rise / rise.max(), dtype=np.float32)


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
    """Tap gratings with the sensor.

    A pin's tip moves by u(h) - pin_mm grad u_z(h) + r u_z/H: with the interface of skin and gel,
    with its slope, and outwards in the picture as it nears the camera; u is the field of the
    contact library, in the frame of the grating.

    Parameters
    ----------
    periods_mm : array_like, (taps,) or scalar
        Period of each grating, mm, one of the library's.
    yaw_deg : array_like, (taps,) or scalar
        Orientation of each grating, degrees anticlockwise; at 0 the bars run along y.
    rng : Generator
        A tap's nuisances and noise depend on it and on the tap's place, not on later taps.
    tip, skin, nuisance : optional
        The sensor and its variability.
    library : Library, optional
        By default the one of `skin` and the tip's radius, solved and stored if it is not yet.

    Returns
    -------
    Taps
        Labels: period_mm, yaw_deg, phase (periods), force_n, offset_x_mm, offset_y_mm,
        shear_x_mm, shear_y_mm, frame.

    Raises
    ------
    ValueError
        Shapes disagree, a period or force is not in the library, or the library is of another
        skin or radius.
    """
    # Solvers and compilers load where taps are made, not where options are listed.
    import pandas as pd

    from bgmodel.tactile.library import contact_library
    from bgmodel.tactile.pressing import LibraryPlan

    tip, nuisance = tip or Tip(), nuisance or Nuisance()
    periods, yaws = _stimuli(periods_mm, yaw_deg)
    if library is None:
        library = contact_library(LibraryPlan(skin=skin or Skin(), radius_mm=tip.radius_mm))
    elif skin not in (None, library.plan.skin) or tip.radius_mm != library.plan.radius_mm:
        raise InputError(
            f"library: got one of {library.plan.skin} and radius {library.plan.radius_mm:g} mm, "
            f"must be of {skin or library.plan.skin} and radius {tip.radius_mm:g} mm",
            "library",
        )
    # A stream for each kind of draw, filled tap by tap: a tap never sees the ones after it.
    uniform, normal, noise = rng.spawn(3)
    phase, share = uniform.random((len(periods), 2)).T
    place = normal.standard_normal((len(periods), 4))
    low, high = nuisance.force_n
    labels = pd.DataFrame({"period_mm": periods, "yaw_deg": yaws, "phase": phase})
    labels["force_n"] = low + (high - low) * share
    labels[["offset_x_mm", "offset_y_mm"]] = nuisance.offset_sd_mm * place[:, :2]
    labels[["shear_x_mm", "shear_y_mm"]] = nuisance.shear_sd_mm * place[:, 2:]
    displacement, labels["frame"] = _filmed(noiseless(labels, tip, library), nuisance, noise)
    return Taps(displacement, tip.rest_mm(), labels)


def noiseless(labels: pd.DataFrame, tip: Tip, library: Library) -> Singles:
    """Peak displacements of the pins for given nuisances, without marker noise.

    Parameters
    ----------
    labels : DataFrame
        One row a tap, with the columns that `simulate` gives except frame.
    tip : Tip
    library : Library

    Returns
    -------
    ndarray, (taps, pins, 2)
        mm, in the frame of the sensor.

    Raises
    ------
    ValueError
        A period or force is not in the library.
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
    """Displacements (taps, pins, 2) for taps on one grating."""
    yaw = np.deg2rad(taps["yaw_deg"].to_numpy())
    cos, sin = np.cos(yaw), np.sin(yaw)
    # Columns are the axes of the grating in the sensor's frame.
    axes = np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2)
    places = rest - taps[["offset_x_mm", "offset_y_mm"]].to_numpy()[:, None]
    phase, force = taps["phase"].to_numpy(), taps["force_n"].to_numpy()
    moved = library.sample(period_mm, phase, force, places @ axes, tip.pin_mm)
    lateral = moved[..., :2] @ axes.transpose(0, 2, 1)
    nearing = rest * (moved[..., 2:] / tip.camera_height_mm)
    shear = taps[["shear_x_mm", "shear_y_mm"]].to_numpy()
    return np.asarray(lateral + nearing + shear[:, None])


def _filmed(
    peak: Singles, nuisance: Nuisance, rng: np.random.Generator
) -> tuple[Singles, NDArray[np.int64]]:
    """Displacements with marker noise in the frame that is kept, and which one that is."""
    profile = nuisance.press_profile()[:, None, None]
    kept, frame = np.empty_like(peak), np.zeros(len(peak), dtype=np.int64)
    for tap, displacement in enumerate(peak):
        shape = (len(profile), *displacement.shape)
        noise = rng.standard_normal(shape, dtype=np.float32)
        frames = profile * displacement + noise * np.float32(nuisance.marker_noise_um * 1e-3)
        if len(frames) > 1:
            frame[tap] = np.linalg.norm(frames, axis=-1).sum(axis=-1).argmax()
        kept[tap] = frames[frame[tap]]
    return kept, frame


def _stimuli(periods_mm: ArrayLike, yaw_deg: ArrayLike) -> tuple[Array, Array]:
    """Give periods and yaws of equal length, or ValueError."""
    periods, yaws = np.asarray(periods_mm, dtype=float), np.asarray(yaw_deg, dtype=float)
    try:
        periods, yaws = np.broadcast_arrays(np.atleast_1d(periods), np.atleast_1d(yaws))
    except ValueError:
        periods = np.empty((0, 0))
    if periods.ndim != 1:
        raise InputError(
            f"periods_mm, yaw_deg: got shapes {np.shape(periods_mm)} and {np.shape(yaw_deg)}, "
            "must be two rows of one length, or a row and a single number",
            "yaw_deg",
        )
    for name, values in (("periods_mm", periods), ("yaw_deg", yaws)):
        if not np.all(np.isfinite(values)):
            raise InputError(f"{name}: got values that are not finite, must be numbers", name)
    return periods.copy(), yaws.copy()
