"""Taps: maps of their displacement, parts and joins."""

import numpy as np
import pandas as pd
import pytest

from bgmodel.tactile.sensor import simulate
from bgmodel.tactile.skin import Tip
from bgmodel.tactile.taps import Taps
from tests.helpers import refused
from tests.tactile.plans import STILL


@pytest.mark.parametrize("layout", ["square", "hexagonal", "circular"])
def test_maps_have_zero_mean_unit_spread_and_the_places_of_the_pins(library, layout):
    rng = np.random.default_rng(3)
    taps = simulate([0.0, 2.0, 5.0], [0, 45, 90], rng=rng, tip=Tip(layout), library=library)
    maps = taps.maps()
    assert maps.shape == (3, 1, 19, 19)
    assert maps.dtype == np.float32
    assert maps.mean(axis=(1, 2, 3)) == pytest.approx(0, abs=1e-5)
    assert maps.std(axis=(1, 2, 3)) == pytest.approx(1, abs=1e-5)
    middle = maps[0, 0]
    assert middle[9, 9] < middle[9, 4]  # least under the apex, most on a ring about it
    if layout == "square":
        size = np.linalg.norm(taps.displacement_mm[2], axis=1).reshape(19, 19)
        assert np.corrcoef(size.ravel(), maps[2].ravel())[0, 1] == pytest.approx(1, abs=1e-6)


def test_parts_of_taps_join_to_the_taps_that_were_selected(library):
    taps = simulate(
        [0.0, 2.0, 5.0, 2.0], 10.0, rng=np.random.default_rng(0), nuisance=STILL, library=library
    )
    fine = taps.select(taps.labels.period_mm == 2.0)
    assert len(fine) == 2
    assert np.array_equal(fine.displacement_mm, taps.displacement_mm[[1, 3]])
    both = Taps.concatenate([fine, taps.select([0])])
    assert both.labels.period_mm.tolist() == [2.0, 2.0, 0.0]
    assert both.labels.index.tolist() == [0, 1, 2]
    other = simulate(2.0, 0, rng=np.random.default_rng(0), tip=Tip("hexagonal"), library=library)
    with refused("parts same pins"):
        Taps.concatenate([taps, other])
    with refused("parts got none"):
        Taps.concatenate([])
    with refused("mask"):
        taps.select([True, False, True])
    with refused("displacement_mm"):
        Taps(taps.displacement_mm[:2], taps.rest_mm, taps.labels)


def test_the_order_in_which_pins_are_listed_changes_no_map():
    rng = np.random.default_rng(7)
    rest, moved = Tip().rest_mm(), rng.normal(size=(2, 361, 2)).astype(np.float32)
    labels, order = pd.DataFrame({"yaw_deg": [0.0, 1.0]}), rng.permutation(361)
    known = Taps(moved, rest, labels).maps()
    # Rows of the picture run from the top down, as the pins of the square array do.
    assert known[0, 0].argmax() == np.linalg.norm(moved[0], axis=1).argmax()
    listed = Taps(moved[:, order], rest[order], labels).maps()
    np.testing.assert_allclose(listed, known, atol=1e-4)


def test_a_file_gives_back_its_taps_and_an_older_one_without_a_stimulus_holds_gratings(tmp_path):
    labels = pd.DataFrame({"yaw_deg": [0.0, 1.0], "frame": [3, 4]})
    moved = np.random.default_rng(7).normal(size=(2, 361, 2)).astype(np.float32)
    taps = Taps(moved, Tip().rest_mm(), labels, "edge")
    path = taps.save(tmp_path / "taps.npz", {"seed": 5})
    restored, about = Taps.load(path)
    assert about == {"seed": 5}
    assert restored.stimulus == "edge"
    assert np.array_equal(restored.displacement_mm, moved)
    assert np.array_equal(restored.rest_mm, taps.rest_mm)
    pd.testing.assert_frame_equal(restored.labels, labels)
    with np.load(path) as stored:
        old = {name: stored[name] for name in stored.files if name != "stimulus"}
    np.savez(path, **old)
    assert Taps.load(path)[0].stimulus == "grating"
    np.savez(path, **{name: value for name, value in old.items() if name != "rest_mm"})
    with refused("path does not hold taps of this program"):
        Taps.load(path)
    with refused(r"path there are no taps .*absent\.npz"):
        Taps.load(tmp_path / "absent.npz")
