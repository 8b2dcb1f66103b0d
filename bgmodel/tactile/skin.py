"""Tip of the sensor: skin, an elastic sheet bonded to a gel, solved exactly; pins, their images."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bgmodel.support.checks import check_positive, check_range
from circuits.arrays import Array, Image
from circuits.errors import InputError, require

# Rows of layer states and boundary conditions: depth displacement, lateral displacement,
# normal stress, shear stress.
_DEPTH, _LATERAL, _NORMAL, _SHEAR = range(4)


@dataclass(frozen=True)
class Skin:
    """Two bonded incompressible layers on a rigid window: the skin and the gel behind it."""

    skin_mm: float = 1.0
    """Thickness of the skin, mm; assumed."""
    skin_shear_mpa: float = 1.0 / 3.0
    """Shear modulus of the skin, MPa; assumed: E = 1.0 MPa (Shore A 27, Gent), G = E/3."""
    gel_mm: float = 15.0
    """Thickness of the gel between the skin and the window, mm; assumed."""
    gel_shear_mpa: float = 0.010
    """Shear modulus of the gel, MPa; assumed."""

    def __post_init__(self) -> None:
        check_positive(owner="Skin", **vars(self))


class SkinResponse(NamedTuple):
    """Response to a unit pressure wave on the surface, as a function of its wavenumber.

    A pressure of 1 MPa times exp(ikx) yields, in mm and with z pointing into the body, the depth
    displacement ``compliance`` exp(ikx) at the surface, ``interface_depth`` exp(ikx) at the
    skin/gel interface, and the lateral displacement i ``interface_lateral`` exp(ikx) there.
    """

    compliance: Array
    interface_depth: Array
    interface_lateral: Array


def response(skin: Skin, wavenumber_per_mm: ArrayLike) -> SkinResponse:
    """Return the response of the layered skin to pressure waves, mm/MPa.

    In each layer w = (A + B kz) exp(-kz) + (C + D kz) exp(kz), U = w'/k, p = G (U'' - k^2 U)/k,
    s_zz = -p + 2 G w' and s_xz = G (U' + k w) (incompressible plane strain). The eight constants
    follow from s_zz = -1 and s_xz = 0 on top, continuity of all four at the interface, and w = U =
    0 at the window. For one thick material the limits are 1/(2Gk) and (1 + kz) exp(-kz)/(2Gk)
    (Johnson 1985, Contact Mechanics, section 13.2). At wavenumber 0 an incompressible bonded layer
    does not respond.
    """
    k = np.asarray(wavenumber_per_mm, dtype=float)
    if not np.all(np.isfinite(k)) or np.any(k < 0):
        raise InputError.of("wavenumber_per_mm", "must be finite and not negative", k)
    # Most wavenumbers occur repeatedly on square grids, and solving is expensive.
    distinct, where = np.unique(k, return_inverse=True)
    positive = distinct > 0
    values = np.zeros((3, distinct.size))
    values[:, positive] = _solve(skin, distinct[positive])
    return SkinResponse(*values[:, where.reshape(k.shape)])


def _solve(skin: Skin, k: Array) -> Array:
    """Return surface compliance and both interface transfers, (3, wavenumbers), for k > 0."""
    sheet_top, sheet_bottom = _layer(k * skin.skin_mm)
    gel_top, gel_bottom = _layer(k * skin.gel_mm)
    gel_top[:, _NORMAL:] *= skin.gel_shear_mpa / skin.skin_shear_mpa
    system = np.zeros((k.size, 8, 8))
    system[:, :2, :4] = sheet_top[:, _NORMAL:]
    system[:, 2:6, :4] = sheet_bottom
    system[:, 2:6, 4:] = -gel_top
    system[:, 6:, 4:] = gel_bottom[:, :_NORMAL]
    load = np.zeros((k.size, 8, 1))
    load[:, 0] = -1.0
    constants = np.linalg.solve(system, load)[:, :4, 0]
    surface = np.einsum("ki,ki->k", sheet_top[:, _DEPTH], constants)
    depth = np.einsum("ki,ki->k", sheet_bottom[:, _DEPTH], constants)
    lateral = np.einsum("ki,ki->k", sheet_bottom[:, _LATERAL], constants)
    return np.stack([surface, depth, lateral]) / (skin.skin_shear_mpa * k)


def _layer(thickness: Array) -> tuple[Array, Array]:
    """Return states at the top and bottom of a layer for each of its four solutions.

    `thickness` is kh. Growing solutions are expressed as functions of the distance from the bottom,
    so entries stay bounded and do not overflow for large kh. Stresses are in units of Gk. Each
    result is (wavenumbers, 4 rows, 4 constants).
    """
    zero = np.zeros_like(thickness)
    near, far = _decaying(zero), _decaying(thickness)
    # The same solutions from the other side: components odd in z change sign.
    flip = np.ones((4, 1))
    flip[[_LATERAL, _NORMAL]] = -1.0
    top = np.concatenate([near, flip * far], axis=2)
    bottom = np.concatenate([far, flip * near], axis=2)
    return top, bottom


def _decaying(s: Array) -> Array:
    """Return states of exp(-s) and s exp(-s), s = kz: (wavenumbers, 4 rows, 2 constants)."""
    one = np.ones_like(s)
    rows = [[one, s], [-one, 1 - s], [-2 * one, -2 * s], [2 * one, 2 * (s - 1)]]
    states = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    return np.asarray(states * np.exp(-s)[:, None, None])


Layout = Literal["square", "hexagonal", "circular"]


@dataclass(frozen=True)
class Tip:
    """Dome with pins on its inner surface, viewed by a camera behind it."""

    layout: Layout = "square"
    """Pin layout: square 19 x 19 (Pestell, Griffith & Lepora 2022), hexagonal 127, circular 331."""
    pitch_mm: float = 1.2
    """Distance between neighbouring pins or rings of pins, mm; assumed."""
    pin_mm: float = 1.5
    """Length of a pin, mm; assumed."""
    radius_mm: float = 20.0
    """Radius of the dome, mm; tip diameter 40 mm (Pestell, Griffith & Lepora 2022)."""
    camera_height_mm: float = 45.0
    """Distance from the camera to the pins, mm; assumed."""

    def __post_init__(self) -> None:
        must = f"must be one of {get_args(Layout)}"
        require(self.layout in get_args(Layout), "layout", must, self.layout, owner="Tip")
        positive = ("pitch_mm", "radius_mm", "camera_height_mm")
        check_positive(owner="Tip", **{name: getattr(self, name) for name in positive})
        check_range(0, np.inf, owner="Tip", pin_mm=self.pin_mm)

    def rest_mm(self) -> NDArray[np.float64]:
        """Return the positions of the pins at rest, mm from the apex, (pins, 2), x right and y up.

        The square array runs row by row from the top left, so that one value per pin, reshaped to
        19 x 19, forms an image.
        """
        places = {"square": _square, "hexagonal": _hexagonal, "circular": _circular}[self.layout]
        return places() * self.pitch_mm


def _square() -> NDArray[np.float64]:
    """Return 361 pins in 19 rows of 19."""
    x, y = np.meshgrid(np.arange(-9.0, 10.0), np.arange(9.0, -10.0, -1.0))
    return np.column_stack([x.ravel(), y.ravel()])


def _hexagonal() -> NDArray[np.float64]:
    """Return 127 pins of a triangular lattice in a hexagon: six rings around a central pin."""
    rings = 6
    rows = [
        np.column_stack([np.arange(count) - (count - 1) / 2, np.full(count, -row * 0.75**0.5)])
        for row in range(-rings, rings + 1)
        for count in [2 * rings + 1 - abs(row)]
    ]
    return np.concatenate(rows)


def _circular() -> NDArray[np.float64]:
    """Return 331 pins: ten circles of 6, 12, ... 60 pins around a central one."""
    circles = [np.zeros((1, 2))]
    for ring in range(1, 11):
        angle = 2 * np.pi * np.arange(6 * ring) / (6 * ring)
        circles.append(ring * np.column_stack([np.cos(angle), np.sin(angle)]))
    return np.concatenate(circles)


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
