"""Real TacTip recordings: read folders of images as taps, in the same form as simulated ones.

A tap is one greyscale image of bright markers on a dark background. Its blobs are matched one to
one to the marker layout, and the displacement of an undetected pin is interpolated from its
neighbours. Without a rest image, the layout is the median position of each marker: displacements
are then relative to the typical tap, not to the untouched skin.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree
from tqdm import tqdm

from bgmodel.tactile.taps import Taps
from circuits.arrays import Array, Image, Integers, Reals
from circuits.errors import InputError

POSE = ("x_mm", "y_mm", "z_mm", "roll_deg", "pitch_deg", "yaw_deg")


@dataclass(frozen=True)
class Form:
    """Layout of a recording: table of taps, image folders and column names."""

    table: str
    """File name of the table."""
    image: str
    """Column with image names."""
    folders: tuple[str, ...]
    """Image folders relative to the table, in order of preference."""
    label: str
    """Column with the object tapped."""
    shear: str
    """Prefix of shear columns."""
    axes: tuple[str, ...]
    """Suffixes of pose and shear columns."""


NUMBERED = ("1", "2", "3", "4", "5", "6")
NAMED = ("x", "y", "z", "Rx", "Ry", "Rz")
# If a folder has both tables, targets_images.csv was derived from the other. Training and test
# parts of a recording have their own folders with a table, next to one folder with all images.
FORMS = (
    Form("targets_images.csv", "sensor_image", ("processed_images", "sensor_images"),
           "object_label", "shear_", NAMED),
    Form("targets.csv", "sensor_image", ("images",), "obj_id", "move_", NUMBERED),
    Form("targets.csv", "image_name", ("frames_bw", "../frames_bw"), "obj_id", "move_", NUMBERED),
)  # fmt: skip


def read_targets(folder: str | Path) -> pd.DataFrame:
    """Read the labels of a recording in any of the known layouts, one row per tap.

    Columns: `x_mm`, `y_mm`, `z_mm`, `roll_deg`, `pitch_deg`, `yaw_deg`, `image` (path), and if
    recorded `shear_x_mm` ... `shear_yaw_deg` and `object_label`.
    """
    folder = Path(folder)
    form, raw = _read_table(folder)
    table, images = folder / form.table, _image_paths(folder, form, raw)
    names = {f"pose_{axis}": name for axis, name in zip(form.axes, POSE, strict=True)}
    for axis, name in zip(form.axes, POSE, strict=True):
        names[f"{form.shear}{axis}"] = f"shear_{name}"
    numbers = raw[[name for name in names if name in raw]].apply(pd.to_numeric, errors="coerce")
    for row, column in np.argwhere(~np.isfinite(numbers.to_numpy(float)))[:1]:
        value = f"{numbers.columns[column]} of {raw[form.image][row]}"
        raise InputError(f"{table}: {value} is missing or not a number", "folder", folder)
    labels = {"object_label": raw[form.label]} if form.label in raw else {}
    renamed = numbers.astype(float).rename(columns=names)
    targets: pd.DataFrame = renamed.assign(image=images, **labels)
    return targets


def _read_table(folder: Path) -> tuple[Form, pd.DataFrame]:
    known = [form for form in FORMS if (folder / form.table).is_file()]
    if not known:
        tables = " nor ".join(dict.fromkeys(form.table for form in FORMS))
        raise FileNotFoundError(
            f"recording: {folder} has neither {tables}: give the folder that has"
        )
    table = folder / known[0].table
    try:
        raw = pd.read_csv(table)
    except ValueError as error:  # base class of pandas errors for bad bytes and rows
        raise InputError(f"{table}: not a readable csv table ({error})", "folder") from error
    known = [form for form in known if form.table == table.name]
    form = next((form for form in known if form.image in raw), None)
    if form is None:
        columns = " and ".join(form.image for form in known)
        raise InputError(f"{table}: lacks {columns}; a column of image names is required", "folder")
    poses = [f"pose_{axis}" for axis in form.axes]
    if missing := [column for column in poses if column not in raw]:
        raise InputError(
            f"{table}: lacks {', '.join(missing)}; needed: {', '.join(poses)}", "folder"
        )
    if raw.empty:
        raise InputError(f"{table}: has no rows; a recording needs at least one tap", "folder")
    return form, raw


def _image_paths(folder: Path, form: Form, raw: pd.DataFrame) -> list[Path]:
    images = [folder / name for name in form.folders if (folder / name).is_dir()]
    if not images:
        raise FileNotFoundError(f"{folder}: has no folder {' or '.join(form.folders)}")
    paths = [images[0] / str(name) for name in raw[form.image]]
    if missing := [path for path in paths if not path.is_file()]:
        raise FileNotFoundError(f"{missing[0]}: no such file; {len(missing)} are missing")
    return paths


SMALLEST_IMAGE_PX, FEWEST_PINS = 64, 10
LAYOUT_TAPS = 400  # enough for a stable median
REACH, CROWDED = 0.75, 0.7  # in pitches: largest match distance; smallest pin distance


def find_recordings(option: Path | None) -> Path | None:
    """Return the given folder, or that of the environment variable BGMODEL_RECORDINGS, or None."""
    folder = option or os.environ.get("BGMODEL_RECORDINGS")
    if folder and not Path(folder).is_dir():
        raise InputError(f"recordings (BGMODEL_RECORDINGS): {folder} is not a folder", "recordings")
    return Path(folder) if folder else None


def read_taps(folder: str | Path, *, mm_per_px: float, rest: str | Path | Reals | None = None,
              stimulus: str = "edge", pins: int | None = None) -> Taps:  # fmt: skip
    """Track the markers in every image of a recording; labels as in `read_targets`.

    ``rest`` is an image of the untouched sensor, `rest_mm` of another recording (origin at the
    image centre), or None for the median over taps. Recordings do not contain the stimulus. The
    scale is the pin pitch in mm over that in px. `markers_found` counts detected pins: more than
    ``pins``, or fewer than half in a tap, raise.
    """
    for name, value in {"mm_per_px": mm_per_px, "pins": pins}.items():
        if value is not None and not 0 < value < np.inf:
            raise InputError(f"{name} must be a positive number, got {value}", name, value)
    labels = read_targets(folder)
    images = list(labels["image"])
    shape = _read_image(images[0]).shape
    centre, scale = (np.array(shape[::-1]) - 1) / 2, mm_per_px * np.array([1, -1])
    rest_mm = None if rest is None else _given_rest(rest, shape, centre, scale)
    taps = [_detect(path, shape) for path in tqdm(images, "markers", unit="tap", disable=None)]
    if rest_mm is None:
        rest_mm = (_median_layout(taps) - centre) * scale
    if pins is not None and len(rest_mm) > pins:
        raise InputError(
            f"pins must be those of the sensor, got {pins}: {len(rest_mm)} were detected", "pins"
        )
    track = _tracker(rest_mm / scale + centre)
    moved, counts = zip(*map(track, taps), strict=True)
    few = int(np.argmin(counts))
    _check_enough(images[few], counts[few], rest_mm, None if rest is None else mm_per_px)
    labels["markers_found"] = counts
    return Taps((np.stack(moved) * scale).astype(np.float32), rest_mm, labels, stimulus)


class Tracker:
    """Track single images of a sensor with known pins, as ``read_taps`` does for folders.

    ``rest_mm``, (pins, 2), holds the positions of pins at rest, such as those of a ``Decoder``.
    """

    def __init__(self, rest_mm: Reals, mm_per_px: float, stimulus: str) -> None:
        if not 0 < mm_per_px < np.inf:
            raise InputError.of("mm_per_px", "must be a positive number", mm_per_px)
        self.rest_mm, self.stimulus = np.asarray(rest_mm, dtype=np.float64), stimulus
        self.mm_per_px, self.scale = mm_per_px, mm_per_px * np.array([1, -1])
        self.shape: tuple[int, ...] | None = None

    def read(self, path: Path) -> Taps:
        """Return the tap in an image of the first one's size; fewer than half of the pins raise."""
        if self.shape is None:
            self.shape = _read_image(path).shape
            centre = (np.array(self.shape[::-1]) - 1) / 2
            self._track = _tracker(self.rest_mm / self.scale + centre)
        moved, pins = self._track(_detect(path, self.shape))
        _check_enough(path, pins, self.rest_mm, self.mm_per_px)
        labels = pd.DataFrame({"image": [path], "markers_found": [pins]})
        still = (moved[None] * self.scale).astype(np.float32)
        return Taps(still, self.rest_mm, labels, self.stimulus)


def _check_enough(path: Path, pins: int, rest_mm: Array, mm_per_px: float | None) -> None:
    """Raise ValueError for a tap with fewer than half of the pins, which a wrong scale causes."""
    if pins < len(rest_mm) / 2:
        scale = "" if mm_per_px is None else f"; is mm_per_px, {mm_per_px:g}, that of the layout?"
        raise ValueError(f"{path}: only {pins} of {len(rest_mm)} pins were detected{scale}")


def pins_found(taps: Taps, pins: int | None = None) -> str:
    """Return a message with the number of pins detected, overall and per tap."""
    seen = taps.labels["markers_found"]
    of_all = "" if pins is None else f" of {pins}"
    return f"{len(taps.rest_mm)}{of_all} pins found, {seen.min()} to {seen.max()} of them per tap"


def _read_image(path: Path, shape: tuple[int, ...] | None = None) -> Image:
    try:
        import cv2
    except ImportError as error:
        needed = 'reading recordings needs OpenCV: pip install ".[tactile]"'
        raise ImportError(needed) from error
    image: Image | None = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise ValueError(f"{path}: not a readable image")
    sizes = f"{shape} px like the first" if shape else f"{SMALLEST_IMAGE_PX} px a side or more"
    fits = image.shape == shape if shape else min(image.shape) >= SMALLEST_IMAGE_PX
    if image.ndim != 2 or image.dtype != np.uint8 or not fits:
        got = f"got {image.dtype} of shape {image.shape}"
        raise ValueError(f"{path}: {got}; must be one grey channel of uint8, {sizes}")
    return image


def _detect(path: Path, shape: tuple[int, ...]) -> Array:
    """Return subpixel positions (markers, 2) of the bright blobs in an image."""
    import cv2

    image = _read_image(path, shape)
    block = max(shape) // 8 | 1  # subtract local mean: then one threshold fits all
    bright = cv2.subtract(image, cv2.blur(image, (block, block)))
    _, mask = cv2.threshold(bright, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    # Diagonal pixels are not connected: in small images, neighbouring pins nearly touch.
    count, blob, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    if count <= FEWEST_PINS:
        raise ValueError(f"{path}: {count - 1} markers found; needs bright blobs on dark")
    y, x = np.nonzero(mask)
    total, *sums = (np.bincount(blob[y, x], bright[y, x] * v, count)[1:] for v in (1.0, x, y))
    area = stats[1:, cv2.CC_STAT_AREA] / np.median(stats[1:, cv2.CC_STAT_AREA])
    return np.asarray((np.array(sums) / total).T[(area >= 1 / 4) & (area <= 4)])


def _spacing(points: Array) -> Array:
    return np.asarray(cKDTree(points).query(points, 2)[0][:, 1])


def _lattice(points: Array) -> Array:
    """Keep points with at least three neighbours, as pins have; this removes stray specks."""
    radius = 1.5 * np.median(_spacing(points))  # includes the diagonal of a square array
    pins = cKDTree(points).query_ball_point(points, radius, return_length=True) > 3  # counts itself
    if pins.sum() < FEWEST_PINS:
        raise ValueError(f"recording: no marker layout among {len(points)} bright blobs")
    return np.asarray(points[pins])


def _given_rest(rest: Any, shape: Any, centre: Array, scale: Array) -> Array:
    if isinstance(rest, str | Path):
        return np.asarray((_lattice(_detect(Path(rest), shape)) - centre) * scale)
    places = np.asarray(rest, float)
    if places.shape != (max(places.size // 2, FEWEST_PINS), 2) or not np.isfinite(places).all():
        raise InputError(
            f"rest must be finite (pins, 2) in mm, got an array {places.shape}", "rest"
        )
    return places


def _match(points: Array, places: Array, reach: float) -> tuple[Integers, Integers]:
    """Return indices of matched points and places, pairing each place with its nearest point."""
    distance, place = cKDTree(places).query(points, distance_upper_bound=reach)
    order = np.argsort(distance, kind="stable")
    j, first = np.unique(place[order], return_index=True)
    near = j < len(places)  # the tree returns len(places) for points without a match
    return order[first[near]], j[near]


def _median_layout(taps: list[Array]) -> Array:
    """Return the median position of each marker, starting from the tap with most pins."""
    taps = taps[:: -(-len(taps) // LAYOUT_TAPS)]
    pitch = np.median([np.median(_spacing(tap)) for tap in taps])
    # Specks lie close to pins and merged pins are fewer: count only well-spaced blobs.
    places = max(taps, key=lambda tap: np.sum(_spacing(tap) > CROWDED * pitch))
    for _ in range(3):
        seen = np.full((len(taps), len(places), 2), np.nan)
        for tap, row in zip(taps, seen, strict=True):
            i, j = _match(tap, places, REACH * pitch)
            row[j] = tap[i]
        share = np.isfinite(seen[..., 0]).mean(axis=0)
        seen, share = seen[:, share > 0.3], share[share > 0.3]  # pins that merge are often missed
        places = np.nanmedian(seen, axis=0)
    # Of two places too close to both be pins, one is a speck (it does not move) or merged pins
    # (seen less often).
    claim = share * (np.nanstd(seen, axis=0).sum(axis=1) + 1e-9)
    crowding = cKDTree(places).query_ball_point(places, CROWDED * pitch)
    return _lattice(
        places[[k for k, close in enumerate(crowding) if claim[k] >= claim[close].max()]]
    )


def _tracker(layout: Array) -> Callable[[Array], tuple[Array, int]]:
    """Return a function from markers of a tap to pin motion (pins, 2), px, and number of pins seen.

    Undetected pins move with their neighbours.
    """
    pitch = float(np.median(_spacing(layout)))
    apart = np.linalg.norm(layout[:, None] - layout[None], axis=2) / pitch
    weight = np.exp(-(apart**2) / 2) * (apart > 0)

    def track(points: Array) -> tuple[Array, int]:
        motion = np.zeros_like(layout)
        for _ in range(2):  # the second match starts from the motion of neighbouring pins
            i, j = _match(points, layout + motion, REACH * pitch)
            near, seen = weight[:, j], points[i] - layout[j]
            motion = near @ seen / np.maximum(near.sum(axis=1, keepdims=True), 1e-300)
        motion[j] = seen
        return motion, len(j)

    return track
