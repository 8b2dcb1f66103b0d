"""Recordings made up: drawn images of a hexagonal head, in the forms of real ones."""

import numpy as np
import pandas as pd
import pytest

SIZE, PITCH, MM_PER_PX = 160, 11.0, 0.2
FIELD_PX = 4.5  # largest displacement


def hexagon(rings=5, pitch=PITCH, size=SIZE):
    """Hexagonal pattern in px about the image's centre; 5 rings are 91 pins, 6 are 127, 10 331."""
    q, r = np.meshgrid(*[np.arange(-rings, rings + 1)] * 2)
    keep = np.abs(q + r) <= rings
    pins = np.column_stack([q[keep] + r[keep] / 2, r[keep] * np.sqrt(3) / 2])
    return pins * pitch + (size - 1) / 2


def field(pins, yaw_deg, size=SIZE):
    """Give a smooth displacement (pins, 2) in px: an outward bulge off centre, at the yaw."""
    yaw = np.deg2rad(yaw_deg)
    away = pins - (size - 1) / 2 - 15 * np.array([np.cos(yaw), np.sin(yaw)])
    bulge = away * np.exp(-np.sum(away**2, axis=1, keepdims=True) / 2 / 25**2)
    return FIELD_PX * bulge / (25 * np.exp(-0.5))


def draw(pins, *, specks=(), radius=3.0, size=SIZE):
    """Grey image of bright discs at the pins, smooth at the edges, in uneven light."""
    y, x = np.mgrid[:size, :size]
    apart = np.full(x.shape, np.inf)
    reach = radius + 1.0  # farther from its centre a disc adds nothing
    for pin in pins:
        first, last = (np.clip(pin + side, 0, size).astype(int) for side in (-reach, reach + 1))
        near = (slice(first[1], last[1]), slice(first[0], last[0]))
        away = np.hypot(x[near] - pin[0], y[near] - pin[1])
        apart[near] = np.minimum(apart[near], away)
    image = 20 + 120 * x / size + 100 * np.clip(radius + 0.5 - apart, 0, 1)
    for column, row in specks:
        image[row : row + 4, column : column + 4] = 220
    return image.astype(np.uint8)


def edge_taps(count, sd_deg, seed):
    """Return decoded taps of an edge, with yaws all around and Gaussian errors of the decoder."""
    true = np.linspace(-180, 180, count, endpoint=False)
    read = true + sd_deg * np.random.default_rng(seed).normal(size=count)
    return pd.DataFrame({"yaw_deg": true, "edge_deg": read})


# Table, column of images, their folder, and how columns of poses, of shear and of objects begin.
FORMS = {
    "sensor image": ("targets.csv", "sensor_image", "images", "123456", "move_2", "obj_id"),
    "current tools": ("targets_images.csv", "sensor_image", "processed_images",
                      ("x", "y", "z", "Rx", "Ry", "Rz"), "shear_y", "object_label"),
    "dev-data": ("targets.csv", "image_name", "frames_bw", "123456", "move_2", "obj_id"),
}  # fmt: skip


def write(folder, images, form="sensor image"):
    """Write a recording of taps at yaws from -150 to 150 degrees."""
    cv2 = pytest.importorskip("cv2")
    name, column, images_folder, axes, shear, label = FORMS[form]
    table = pd.DataFrame({column: [f"image_{i + 1}.png" for i in range(len(images))]})
    table[label], table[shear] = 1, 0.5
    yaw = np.linspace(-150, 150, len(images))
    pose = np.column_stack([np.arange(5) + np.zeros((len(images), 1)), yaw])
    table[[f"pose_{axis}" for axis in axes]] = pose
    (folder / images_folder).mkdir(parents=True)
    table.to_csv(folder / name, index=False)
    for name, image in zip(table[column], images, strict=True):
        assert cv2.imwrite(str(folder / images_folder / name), image)
    return folder


def record(folder, yaws_deg, pins=None):
    """Write a recording of taps that push the pins, by default all of a hexagon, at each yaw."""
    shown = hexagon() if pins is None else pins
    return write(folder, [draw(shown + field(shown, yaw)) for yaw in yaws_deg], "dev-data")
