"""Taps: pin displacements with labels, and the maps computed from them."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from bgmodel.support.files import from_json, read_arrays, replacing
from circuits.arrays import Array, Integers, Reals, Singles
from circuits.errors import DataWarning, InputError, require

if TYPE_CHECKING:
    import pandas as pd

STIMULI = ("grating", "edge")
"""Kinds of stimuli."""
COPIED = 0.05
"""Share of copies from which a warning is given: in 50 000 taps that are rounded to 0.1 degrees,
1.4 % coincide by chance."""
MANY = 30
"""Number of taps from which their angles are checked."""
MAP = (19, 19)
"""Rows and columns of a map for the grating decoder."""
SLOPES = {0.0: "in another unit, such as radians", -1.0: "mirrored", 0.5: "halved"}
"""Slopes of decoded on true angles that a mistake in units or axes makes."""


def warn_of_copied_taps(copies: int, taps: int, so: str) -> None:
    """Warn if many taps are copies of others; ``so`` is the consequence."""
    if copies > COPIED * taps:
        DataWarning.warn(f"{copies} of {taps} taps are copies of others: {so}")


def warn_of_angles(taps: pd.DataFrame, *decoded: str) -> None:
    """Warn of true angles that may be in radians, and of decoded ones that do not follow them.

    Angles are compared on their circle, of 180 degrees for orientations. A slope of 1 may leave
    twice the spread of a mirrored one, and four times that of the others in ``SLOPES``, since poor
    decoders lean to the middle.
    """
    true = taps["yaw_deg"].to_numpy(dtype=np.float64)
    if len(true) < MANY:
        return
    if _within_a_turn(true) and (true.round(3) % 0.25).any():
        widest = np.abs(true).max()
        DataWarning.warn(f"yaw_deg runs to {widest:.3g}: it seems to be in radians, not degrees")
    for name in decoded:
        read = taps[name].to_numpy(dtype=np.float64)
        turn = 1j * np.radians(2 if name == "orientation_deg" else 1)
        tried = [slope for slope in SLOPES if slope or _within_a_turn(read)]
        spread = {b: 1 - abs(np.exp(turn * (read - b * true)).mean()) for b in (1.0, *tried)}
        best = min(tried, key=lambda slope: spread[slope])
        if (2 if best < 0 else 4) * spread[best] < spread[1.0] - 1e-9:
            must = "must follow yaw_deg, degree by degree"
            DataWarning.warn(f"{name} {must}: it seems to be {SLOPES[best]}")


def _within_a_turn(angles: Reals) -> bool:
    """Whether angles could be radians."""
    return bool(np.abs(angles).max() < 1.0001 * 2 * np.pi)


@dataclass(frozen=True, eq=False)
class Taps:
    """Pin displacements at the peak of each tap, with rest positions and labels."""

    displacement_mm: Singles
    """Displacement from rest at the peak of the tap, x right and y up, mm, (taps, pins, 2)."""
    rest_mm: Array
    """Positions of the pins at rest, mm, (pins, 2)."""
    labels: pd.DataFrame
    """One row per tap; simulated taps have at least period_mm, yaw_deg, phase and force_n."""
    stimulus: str = "grating"
    """Stimulus tapped, a name in ``STIMULI``; decoders refuse taps of another stimulus."""

    def __post_init__(self) -> None:
        if self.stimulus not in STIMULI:
            raise InputError.of("stimulus", f"must be one of {', '.join(STIMULI)}", self.stimulus)
        expected = (len(self.labels), len(self.rest_mm), 2)
        require(
            self.displacement_mm.shape == expected,
            "displacement_mm",
            f"must be {expected} to agree with labels and rest_mm",
            self.displacement_mm.shape,
            owner="Taps",
        )

    def __len__(self) -> int:
        return len(self.labels)

    def numbers(self) -> Integers:
        """Return a hash of each tap's displacements, (taps,), used as its identifier."""
        each = (hashlib.blake2b(one.tobytes(), digest_size=8) for one in self.displacement_mm)
        return np.frombuffer(b"".join(one.digest() for one in each), dtype=np.int64)

    def select(self, mask: ArrayLike) -> Taps:
        """Return the taps where a mask is true, or those with the given indices, in that order."""
        which = np.asarray(mask)
        if which.dtype == bool and which.shape != (len(self),):
            raise InputError.of("mask", f"must be ({len(self)},)", which.shape)
        rows = np.flatnonzero(which) if which.dtype == bool else which.astype(int)
        labels = self.labels.iloc[rows].reset_index(drop=True)
        return Taps(self.displacement_mm[rows], self.rest_mm, labels, self.stimulus)

    def save(self, path: str | Path, about: dict[str, Any]) -> Path:
        """Write the taps and their provenance to an .npz file; never leaves a partial file."""
        path = Path(path)
        columns = {f"label_{name}": self.labels[name].to_numpy() for name in self.labels}
        with replacing(path) as partial, partial.open("wb") as stream:
            np.savez(
                stream,
                displacement_mm=self.displacement_mm,
                rest_mm=self.rest_mm,
                stimulus=np.array(self.stimulus),
                about=np.array(json.dumps(about, sort_keys=True)),
                **columns,  # type: ignore[arg-type]
            )
        return path

    @classmethod
    def load(cls, path: str | Path) -> tuple[Taps, dict[str, Any]]:
        """Read taps and their provenance; ValueError if the file is not one of taps."""
        import pandas as pd

        path = Path(path)
        if not path.is_file():
            raise InputError(f"there are no taps {str(path)!r}", "path", path)
        try:
            stored = read_arrays(path)
            labels = {n[6:]: stored[n] for n in stored if n.startswith("label_")}
            about = from_json(str(stored["about"]))
            # Files written before edges were supported contain gratings.
            stimulus = str(stored.get("stimulus", "grating"))
            table = pd.DataFrame(labels)
            taps = cls(stored["displacement_mm"], stored["rest_mm"], table, stimulus)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(
                f"{str(path)!r} does not hold taps of this program: {error}", "path"
            ) from error
        return taps, about

    def maps(self) -> Singles:
        """Return maps of displacement magnitude for the grating decoder, (taps, 1, 19, 19).

        Each is z-scored (Pestell, Griffith & Lepora 2022); rows run from top to bottom. Pins that
        are not on such a grid are interpolated linearly; outside the array, the nearest
        pin is used.
        """
        size = np.linalg.norm(self.displacement_mm, axis=2)
        grid = _grid(self.rest_mm)
        if grid.shape != self.rest_mm.shape or not np.allclose(grid, self.rest_mm, atol=1e-6):
            size = size @ _interpolation(self.rest_mm, grid)
        size = size - size.mean(axis=1, keepdims=True)
        spread = size.std(axis=1, keepdims=True)
        size /= np.where(spread > 0, spread, 1)
        return np.asarray(size.reshape(-1, 1, *MAP), dtype=np.float32)


def _grid(rest_mm: Array) -> Array:
    """Return positions (pixels, 2) of a map over the pins, row by row from the top left."""
    (left, bottom), (right, top) = rest_mm.min(axis=0), rest_mm.max(axis=0)
    x, y = np.meshgrid(np.linspace(left, right, MAP[1]), np.linspace(top, bottom, MAP[0]))
    return np.column_stack([x.ravel(), y.ravel()])


def _interpolation(rest_mm: Array, grid: Array) -> Singles:
    """Return weights (pins, pixels) of linear interpolation; nearest pin outside the array."""
    from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator

    each = np.eye(len(rest_mm))
    weights = LinearNDInterpolator(rest_mm, each)(grid)
    outside = np.isnan(weights).any(axis=1)
    weights[outside] = NearestNDInterpolator(rest_mm, each)(grid[outside])
    return np.asarray(weights.T, dtype=np.float32)
