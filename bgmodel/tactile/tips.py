"""Tips of the sensor: pin layout and camera geometry."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from bgmodel.support.checks import check_positive, check_range
from circuits.errors import require

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
