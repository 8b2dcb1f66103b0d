"""Recordings and their tables are read unchanged; markers are tracked to a fraction of a pixel."""

import numpy as np
import pandas as pd
import pytest

from bgmodel.tactile import recordings
from bgmodel.tactile.skin import Tip
from tests.helpers import refused
from tests.tactile.recorded import FORMS, MM_PER_PX, PITCH, SIZE, draw, field, hexagon, write


@pytest.fixture(scope="module")
def truth():
    """Displacements (12, 91, 2) in px of the taps that `recording` shows."""
    return np.stack([field(hexagon(), yaw) for yaw in np.linspace(-150, 150, 12)])


@pytest.fixture(scope="module")
def recording(tmp_path_factory, truth):
    """Folder of taps with specks next to the pins, and the untouched sensor."""
    specks = [(2, 2), (150, 8), (4, 150)]
    images = [draw(hexagon() + moved, specks=specks) for moved in truth]
    folder = write(tmp_path_factory.mktemp("recording"), images)
    import cv2

    cv2.imwrite(str(folder / "rest.png"), draw(hexagon(), specks=specks))
    return folder


def in_order(taps):
    """Displacement (taps, 91, 2) in px, y down, with the pins as `hexagon` lists them."""
    flip = np.array([1, -1]) / MM_PER_PX
    places = taps.rest_mm * flip + (SIZE - 1) / 2
    apart = np.linalg.norm(hexagon()[:, None] - places[None], axis=2)
    assert sorted(apart.argmin(axis=1)) == list(range(len(places)))
    return taps.displacement_mm[:, apart.argmin(axis=1)] * flip


def test_displacement_is_right_to_a_fraction_of_a_pixel(recording, truth):
    taps = recordings.read_taps(recording, mm_per_px=MM_PER_PX, rest=recording / "rest.png")
    assert taps.displacement_mm.dtype == np.float32
    np.testing.assert_allclose(taps.rest_mm.mean(axis=0), 0, atol=0.01)  # the image's centre
    assert taps.labels["markers_found"].tolist() == [91] * 12
    assert np.abs(in_order(taps) - truth).max() < 0.25
    assert (in_order(taps) - truth).std() < 0.06


def test_pins_are_followed_beyond_half_a_pitch(recording, tmp_path, truth):
    far = 1.4 * truth
    assert np.linalg.norm(far, axis=2).max() > 0.55 * PITCH
    folder = write(tmp_path / "far", [draw(hexagon() + moved) for moved in far])
    taps = recordings.read_taps(folder, mm_per_px=MM_PER_PX, rest=recording / "rest.png")
    assert np.abs(in_order(taps) - far).max() < 0.25


def test_without_a_rest_image_the_median_tap_is_the_origin(recording, truth):
    taps = recordings.read_taps(recording, mm_per_px=MM_PER_PX)
    assert taps.rest_mm.shape == (91, 2)
    relative = truth - np.median(truth, axis=0)
    assert (in_order(taps) - relative).std() < 0.1


def test_layout_of_one_recording_serves_another(recording, tmp_path, truth):
    first = recordings.read_taps(recording, mm_per_px=MM_PER_PX)
    other = write(tmp_path / "other", [draw(hexagon() + truth[3])])
    again = recordings.read_taps(other, mm_per_px=MM_PER_PX, rest=first.rest_mm)
    np.testing.assert_array_equal(again.rest_mm, first.rest_mm)
    np.testing.assert_allclose(again.displacement_mm[0], first.displacement_mm[3], atol=0.02)


def test_missed_pins_take_the_motion_of_their_neighbours(recording, tmp_path, truth):
    shown = np.delete(hexagon() + truth[4], [20, 45, 46], axis=0)
    folder = write(tmp_path / "missed", [draw(shown)])
    taps = recordings.read_taps(folder, mm_per_px=MM_PER_PX, rest=recording / "rest.png")
    assert taps.labels["markers_found"].tolist() == [88]
    error = np.linalg.norm(in_order(taps)[0] - truth[4], axis=1)
    assert error.max() < 1.5
    assert np.delete(error, [20, 45, 46]).max() < 0.3


def shaken(points, taps=12):
    """Return the blobs of several taps; in each tap all have moved alike, a little."""
    angle = 2 * np.pi * np.arange(taps) / taps
    return [points + PITCH / 20 * np.array([np.cos(a), np.sin(a)]) for a in angle]


def outwards(pin, pitches):
    """Return a place beyond a pin, as seen from the middle of the hexagon."""
    away = pin - (SIZE - 1) / 2
    return pin + pitches * PITCH * away / np.linalg.norm(away)


def rim(rings=5):
    """Return the indices of a corner of the hexagon, and of a pin half-way along a side."""
    away = hexagon(rings) - (SIZE - 1) / 2
    corner = np.abs(away - [rings * PITCH, 0]).sum(axis=1).argmin()
    beside = np.abs(away - PITCH * np.array([0, rings * 0.75**0.5])).sum(axis=1).argmin()
    return corner, beside


@pytest.mark.parametrize(("seen", "pins"), [(3, 90), (4, 91), (12, 91)])
def test_a_pin_is_one_that_three_tenths_of_the_taps_show(seen, pins):
    taps = shaken(hexagon())
    hidden = [np.delete(tap, 45, axis=0) if k >= seen else tap for k, tap in enumerate(taps)]
    assert recordings._median_layout(hidden).shape == (pins, 2)


@pytest.mark.parametrize(("pitches", "pins"), [(0.65, 127), (0.75, 128)])
def test_of_two_places_closer_than_seven_tenths_of_a_pitch_one_is_a_pin(pitches, pins):
    """The one that is seen more often: the other one is in three of four taps."""
    places, (_, beside) = hexagon(6), rim(6)
    both = shaken(np.concatenate([places, [outwards(places[beside], pitches)]]))
    taps = [tap if k % 4 else tap[:-1] for k, tap in enumerate(both)]
    assert len(recordings._median_layout(taps)) == pins


def test_a_pin_has_three_neighbours_at_a_pitch_or_its_diagonal():
    """A corner of a square array has them; a speck a pitch beyond a corner of a hexagon has one."""
    square = Tip().rest_mm()
    assert np.array_equal(recordings._lattice(square), square)
    places, (corner, _) = hexagon(), rim()
    speck = np.concatenate([places, [outwards(places[corner], 1.0)]])
    assert np.array_equal(recordings._lattice(speck), places)


def test_ten_pins_are_enough_for_a_layout_and_nine_are_not(recording):
    x, y = np.meshgrid(np.arange(5.0), np.arange(2.0))
    assert len(recordings._lattice(np.column_stack([x.ravel(), y.ravel()]))) == 10
    x, y = np.meshgrid(np.arange(3.0), np.arange(3.0))
    with pytest.raises(ValueError, match="no marker layout among 9 bright blobs"):
        recordings._lattice(np.column_stack([x.ravel(), y.ravel()]))
    pins = recordings.read_taps(recording, mm_per_px=MM_PER_PX).rest_mm
    assert len(recordings.read_taps(recording, mm_per_px=MM_PER_PX, rest=pins[40:50]).rest_mm) == 10
    with refused("rest"):
        recordings.read_taps(recording, mm_per_px=MM_PER_PX, rest=pins[40:49])


def test_a_pin_is_followed_up_to_three_quarters_of_a_pitch():
    places, (corner, _) = hexagon(), rim()
    track = recordings._tracker(places)
    for pitches, pins in ((0.74, 91), (0.76, 90)):
        moved = places.copy()
        moved[corner] = outwards(places[corner], pitches)
        motion, seen = track(moved)
        assert seen == pins
        # One that is lost stays with its neighbours, which have not moved.
        want = moved - places if pins == 91 else np.zeros_like(places)
        np.testing.assert_allclose(motion, want, atol=1e-9)


@pytest.mark.parametrize(
    ("form", "pins", "shown", "rings", "size", "pitch"),
    [
        ("sensor image", 331, 331, 10, 128, 5.6),
        ("sensor image", 331, 309, 10, 128, 5.6),
        ("dev-data", 127, 127, 6, 256, 18.0),
        ("dev-data", 127, 114, 6, 256, 18.0),
    ],
)
def test_both_public_sensors_are_read_and_their_pins_counted(
    tmp_path, form, pins, shown, rings, size, pitch
):
    """In black and white, at the sizes of the public recordings; pins at the rim may be hidden."""
    places = hexagon(rings, pitch, size)
    assert len(places) == pins
    rim = np.argsort(np.linalg.norm(places - (size - 1) / 2, axis=1), kind="stable")
    places = places[np.sort(rim[:shown])]
    moved = [field(places, yaw, size) * pitch / 2 / PITCH for yaw in np.linspace(-150, 150, 6)]
    images = [draw(places + m, radius=0.27 * pitch, size=size) for m in moved]
    light = 20 + 120 * np.arange(size) / size
    black_and_white = [((image > light + 50) * 255).astype(np.uint8) for image in images]
    folder = write(tmp_path / "taps", black_and_white, form)
    taps = recordings.read_taps(folder, mm_per_px=MM_PER_PX, pins=pins)
    assert taps.labels["markers_found"].tolist() == [shown] * 6
    per_tap = f"pins found, {shown} to {shown} of them per tap"
    assert recordings.pins_found(taps, pins) == f"{shown} of {pins} {per_tap}"
    assert recordings.pins_found(taps) == f"{shown} {per_tap}"
    flip = np.array([1, -1]) / MM_PER_PX
    pins_px = taps.rest_mm * flip + (size - 1) / 2
    nearest = np.linalg.norm(places[:, None] - pins_px[None], axis=2).argmin(axis=1)
    relative = np.stack(moved) - np.median(moved, axis=0)
    # Black and white leaves each edge of a disc on whole pixels.
    assert (taps.displacement_mm[:, nearest] * flip - relative).std() < 0.25
    with refused("pins"):
        recordings.read_taps(folder, mm_per_px=MM_PER_PX, pins=shown - 1)


def edit_table(change):
    def spoil(folder):
        change(pd.read_csv(folder / "targets.csv")).to_csv(folder / "targets.csv", index=False)

    return spoil


def without(column):
    return edit_table(lambda t: t.drop(columns=column))


def edit_image(change, name="image_2.png"):
    def spoil(folder):
        import cv2

        path = str(folder / "images" / name)
        cv2.imwrite(path, change(cv2.imread(path, cv2.IMREAD_UNCHANGED)))

    return spoil


def rename(old, new):
    return lambda folder: (folder / old).rename(folder / new)


BAD = {
    "no table": (rename("targets.csv", "labels.csv"), "has neither targets_images.csv nor targets"),
    "no column": (without("pose_6"), "targets.csv: lacks pose_6; needed"),
    "no image column": (without("sensor_image"), "lacks sensor_image and image_name"),
    "no rows": (edit_table(lambda t: t.iloc[:0]), "targets.csv: has no rows"),
    "empty table": (lambda f: (f / "targets.csv").write_text(""), "not a readable csv table"),
    "binary table": (lambda f: (f / "targets.csv").write_bytes(b"\xff\xfe\x00"), "not a readable"),
    "no number": (
        edit_table(lambda t: t.astype({"pose_2": str}).replace({"pose_2": "1.0"}, "left")),
        "pose_2 of image_1.png is missing or not a number",
    ),
    "no folder": (rename("images", "pictures"), "has no folder images"),
    "no image": (rename("images/image_2.png", "images/image_9.png"), "image_2.png: no such file"),
    "no picture": (lambda f: (f / "images/image_2.png").write_text("x"), "not a readable image"),
    "colour": (edit_image(lambda i: np.dstack([i] * 3)), r"image_2.png: got uint8 of shape .* 3\)"),
    "16 bits": (edit_image(lambda i: i.astype(np.uint16)), "image_2.png: got uint16"),
    "other size": (edit_image(lambda i: i[:-1]), r"image_2.png: .*\(160, 160\) px like the first"),
    "small": (edit_image(lambda i: i[:63, :63], "image_1.png"), "64 px a side or more"),
    "blank": (edit_image(np.zeros_like), "image_2.png: 0 markers found"),
    "half seen": (
        edit_image(lambda i: i * (np.arange(SIZE) < 60).astype(np.uint8)),
        "image_2.png: .* of 91 pins were detected",
    ),
}


@pytest.mark.parametrize(("spoil", "message"), BAD.values(), ids=list(BAD))
@pytest.mark.filterwarnings("error")
def test_bad_recordings_are_named(tmp_path, spoil, message):
    folder = write(tmp_path / "taps", [draw(hexagon())] * 3)
    spoil(folder)
    with pytest.raises((ValueError, FileNotFoundError), match=message) as caught:
        recordings.read_taps(folder, mm_per_px=MM_PER_PX)
    assert "\n" not in str(caught.value)


def test_another_scale_than_that_of_the_layout_is_asked_for(recording):
    rest_mm = recordings.read_taps(recording, mm_per_px=MM_PER_PX).rest_mm
    with pytest.raises(ValueError, match="that of the layout"):
        recordings.read_taps(recording, mm_per_px=0.66, rest=rest_mm)


@pytest.mark.parametrize(
    "changes",
    [{"mm_per_px": 0.0}, {"mm_per_px": np.nan}, {"pins": 0}]
    + [{"rest": rest} for rest in (np.zeros(4), np.zeros((20, 3)), np.full((20, 2), np.nan))],
)
def test_bad_arguments_are_named(recording, changes):
    name = next(iter(changes))
    with refused(name):
        recordings.read_taps(recording, **({"mm_per_px": MM_PER_PX} | changes))


def test_recordings_are_found_by_option_then_environment(tmp_path, monkeypatch):
    monkeypatch.delenv("BGMODEL_RECORDINGS", raising=False)
    assert recordings.find_recordings(None) is None
    monkeypatch.setenv("BGMODEL_RECORDINGS", str(tmp_path))
    assert recordings.find_recordings(None) == tmp_path
    (tmp_path / "option").mkdir()
    assert recordings.find_recordings(tmp_path / "option") == tmp_path / "option"
    with refused("recordings"):
        recordings.find_recordings(tmp_path / "nowhere")
    monkeypatch.setenv("BGMODEL_RECORDINGS", str(tmp_path / "gone"))
    with refused("recordings"):
        recordings.find_recordings(None)


NEEDED = ["x_mm", "y_mm", "z_mm", "roll_deg", "pitch_deg", "yaw_deg"]
IMAGES = [np.zeros((64, 64), np.uint8)] * 2


@pytest.mark.parametrize("form", FORMS)
def test_all_forms_give_one_table(tmp_path, form):
    targets = recordings.read_targets(write(tmp_path / "taps", IMAGES, form))
    assert targets[NEEDED].iloc[0].tolist() == [0, 1, 2, 3, 4, -150]
    folder = tmp_path / "taps" / FORMS[form][2]
    assert targets["image"].tolist() == [folder / f"image_{i}.png" for i in (1, 2)]
    assert targets["object_label"].tolist() == [1] * 2
    assert targets["shear_y_mm"].tolist() == [0.5] * 2
    assert "shear_x_mm" not in targets


def test_parts_of_a_recording_share_the_images_beside_them(tmp_path):
    folder = write(tmp_path / "model_edge2d", IMAGES, "dev-data")
    rows = (folder / "targets.csv").read_text().splitlines()
    for part, row in (("train", rows[1]), ("test", rows[2])):
        (folder / part).mkdir()
        (folder / part / "targets.csv").write_text(f"{rows[0]}\n{row}\n")
    yaws = [
        recordings.read_targets(folder / part)["yaw_deg"].tolist() for part in ("train", "test")
    ]
    assert yaws == [[-150], [150]]
    image = recordings.read_targets(folder / "test")["image"][0]
    assert image.samefile(folder / "frames_bw" / "image_2.png")
