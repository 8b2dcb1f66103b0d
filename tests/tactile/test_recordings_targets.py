"""Tables of real recordings are read unchanged, in each of their formats."""

import numpy as np
import pytest

from bgmodel.tactile.recordings import read_targets
from tests.tactile.recorded import FORMS, write

NEEDED = ["x_mm", "y_mm", "z_mm", "roll_deg", "pitch_deg", "yaw_deg"]
IMAGES = [np.zeros((64, 64), np.uint8)] * 2


@pytest.mark.parametrize("form", FORMS)
def test_all_forms_give_one_table(tmp_path, form):
    targets = read_targets(write(tmp_path / "taps", IMAGES, form))
    assert targets[NEEDED].iloc[0].tolist() == [0, 1, 2, 3, 4, -150]
    folder = tmp_path / "taps" / FORMS[form][2]
    assert targets["image"].tolist() == [folder / f"image_{i}.png" for i in (1, 2)]
    assert targets["object_label"].tolist() == [1] * 2
    assert targets["shear_y_mm"].tolist() == [0.5] * 2
    assert "shear_x_mm" not in targets


def test_parts_of_a_recording_share_the_images_beside_them(tmp_path):
    """dev-data: a table of all taps, and one each of those to train and to test on."""
    folder = write(tmp_path / "model_edge2d", IMAGES, "dev-data")
    rows = (folder / "targets.csv").read_text().splitlines()
    for part, row in (("train", rows[1]), ("test", rows[2])):
        (folder / part).mkdir()
        (folder / part / "targets.csv").write_text(f"{rows[0]}\n{row}\n")
    yaws = [read_targets(folder / part)["yaw_deg"].tolist() for part in ("train", "test")]
    assert yaws == [[-150], [150]]
    image = read_targets(folder / "test")["image"][0]
    assert image.samefile(folder / "frames_bw" / "image_2.png")


def test_a_form_without_its_folder_of_images_names_it(tmp_path):
    folder = write(tmp_path / "taps", IMAGES, "dev-data")
    (folder / "frames_bw").rename(folder / "images")
    with pytest.raises(FileNotFoundError, match=r"has no folder frames_bw or \.\./frames_bw"):
        read_targets(folder)
