"""Tables of real TacTip recordings: columns with images, poses and objects."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

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
