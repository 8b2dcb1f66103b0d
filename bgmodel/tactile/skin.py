"""Tip of the sensor: skin, an elastic sheet bonded to a gel, solved exactly; pins and camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bgmodel.support.arrays import Array
from bgmodel.support.checks import check_positive, check_range
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


class Response(NamedTuple):
    """Response to a unit pressure wave on the surface, as a function of its wavenumber.

    A pressure of 1 MPa times exp(ikx) yields, in mm and with z pointing into the body, the depth
    displacement ``compliance`` exp(ikx) at the surface, ``interface_depth`` exp(ikx) at the
    skin/gel interface, and the lateral displacement i ``interface_lateral`` exp(ikx) there.
    """

    compliance: Array
    interface_depth: Array
    interface_lateral: Array


def response(skin: Skin, wavenumber_per_mm: ArrayLike) -> Response:
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
    return Response(*values[:, where.reshape(k.shape)])


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
