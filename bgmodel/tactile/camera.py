"""Rendered camera images of the pins, for display and for tests of marker tracking."""

import numpy as np
from numpy.typing import ArrayLike

from bgmodel.support.arrays import Array, Image
from bgmodel.tactile.skin import Tip
from circuits.errors import InputError, require

_DARK, _BRIGHT = 18.0, 225.0


def pixels_per_mm(tip: Tip, shape: tuple[int, int] = (480, 640)) -> float:
    """Return the scale of an image (height, width) as high as the aperture.

    The aperture extends one pitch beyond the pins.
    """
    aperture_mm = float(np.linalg.norm(tip.rest_mm(), axis=1).max()) + tip.pitch_mm
    return min(shape) / 2 / aperture_mm


def marker_pixels(
    displacement_mm: ArrayLike, tip: Tip, shape: tuple[int, int] = (480, 640)
) -> Array:
    """Return marker positions in an image (height, width), pixels, (pins, 2), x right and y down.

    Displacements from rest, (pins, 2), are in mm, x right and y up. Position 0 is the centre of the
    first pixel.
    """
    rest = tip.rest_mm()
    moved = np.asarray(displacement_mm, dtype=float)
    if moved.shape not in ((), rest.shape):
        raise InputError.of("displacement_mm", f"must be {rest.shape} for this tip", moved.shape)
    middle = (np.array(shape[::-1]) - 1) / 2
    return np.asarray(middle + (rest + moved) * [1, -1] * pixels_per_mm(tip, shape))


def render(
    displacement_mm: ArrayLike,
    tip: Tip | None = None,
    *,
    shape: tuple[int, int] = (480, 640),
    marker_mm: float = 0.6,
) -> Image:
    """Render an image of the pins: bright round markers on dark, within a round aperture.

    Displacements from rest, (pins, 2), are in mm, x right and y up; the result holds grey values,
    (height, width). The diameter of a marker is assumed.
    """
    tip = tip or Tip()
    require(min(shape) >= 16, "shape", "must be at least 16 by 16 pixels", shape)
    if not 0 < marker_mm <= tip.pitch_mm:
        raise InputError.of("marker_mm", f"must be in (0, {tip.pitch_mm:g}]", marker_mm)
    radius = marker_mm / 2 * pixels_per_mm(tip, shape)
    light = _discs(marker_pixels(displacement_mm, tip, shape), radius, shape)
    rows, columns = np.indices(shape)
    distance = np.hypot(rows - (shape[0] - 1) / 2, columns - (shape[1] - 1) / 2) / (min(shape) / 2)
    # Illumination decreases towards the rim and is 0 outside.
    lit = (1 - 0.35 * distance**2) * np.clip((1 - distance) * min(shape) / 4, 0, 1)
    grey = np.round((_DARK + (_BRIGHT - _DARK) * light) * lit.clip(0))
    return np.asarray(grey, dtype=np.uint8)


def _discs(middles: Array, radius: float, shape: tuple[int, int]) -> Array:
    """Return an image of blurred discs of brightness 1, with subpixel positions."""
    blur = max(0.5, 0.2 * radius)
    reach = int(np.ceil(radius + 4 * blur))
    offset = np.arange(-reach, reach + 1)
    nearest = np.round(middles).astype(int)
    columns = (nearest[:, :1] + offset)[:, None, :]
    rows = (nearest[:, 1:] + offset)[:, :, None]
    distance = np.hypot(columns - middles[:, :1, None], rows - middles[:, 1:, None])
    # A logistic edge approximates a uniform disc out of focus.
    patches = 1 / (1 + np.exp(np.clip(3 * (distance - radius) / blur, -50, 50)))
    rows, columns = np.broadcast_arrays(rows, columns)
    inside = (rows >= 0) & (rows < shape[0]) & (columns >= 0) & (columns < shape[1])
    light = np.zeros(shape)
    np.maximum.at(light, (rows[inside], columns[inside]), patches[inside])
    return light
