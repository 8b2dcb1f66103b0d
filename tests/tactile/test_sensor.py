"""The simulated sensor: pins, nuisances, symmetries."""

import dataclasses

import numpy as np
import pandas as pd
import pytest

from bgmodel.tactile.library import Library
from bgmodel.tactile.pressing import LibraryPlan, press
from bgmodel.tactile.sensor import Nuisance, noiseless, simulate, simulate_taps
from bgmodel.tactile.skin import Skin, Tip
from bgmodel.tactile.taps import Taps
from tests.helpers import refused
from tests.tactile.plans import PLAN, STILL, one_tap


def test_smooth_plate_does_not_tell_its_yaw():
    """A smooth plate has no orientation; images of a periodic square nearby would give it one."""

    def rms_um(side):
        plan = LibraryPlan(periods_mm=(0.0,), field_side_mm=side)
        smooth = Library(plan, {0.0: press(plan, 0.0, 0.0)[None]})
        moved = [noiseless(one_tap(0.0, yaw), Tip(), smooth)[0] for yaw in (0, 45)]
        size = np.linalg.norm(moved, axis=2)
        return 1000 * np.sqrt(np.mean((size[0] - size[1]) ** 2))

    # About a hundredth of the marker noise; at 36 mm, the control, ten times as much.
    assert rms_um(LibraryPlan().field_side_mm) < 0.12
    assert rms_um(36.0) > 1.2


def test_yaws_as_whole_numbers_have_the_noise_of_others(monkeypatch):
    monkeypatch.setattr("bgmodel.tactile.library.contact_library", lambda *asked, **options: None)
    monkeypatch.setattr("bgmodel.tactile.sensor.simulate", lambda *asked, rng, **options: rng)
    whole, other = (simulate_taps(3, (2.0,), yaws) for yaws in ((-45, 45), (-45.0, 45.0)))
    assert whole.random() == other.random()


def test_quarter_turn_permutes_the_pins(library):
    tip = Tip()
    straight = noiseless(one_tap(phase=0.2), tip, library)[0]
    turned = noiseless(one_tap(phase=0.2, yaw_deg=90), tip, library)[0]
    rest, wanted = tip.rest_mm(), np.column_stack([-straight[:, 1], straight[:, 0]])
    to = np.column_stack([-rest[:, 1], rest[:, 0]])
    where = np.abs(to[:, None] - rest).sum(axis=2).argmin(axis=1)
    assert turned[where] == pytest.approx(wanted, abs=1e-6)
    assert np.abs(turned - straight).max() > 0.01


@pytest.mark.parametrize("yaw", [-60.0, -30.0, 30.0, 75.0])
def test_yaw_turns_the_bars_anticlockwise(library, yaw):
    change = noiseless(one_tap(yaw_deg=yaw), Tip(), library)[0]
    change = change - noiseless(one_tap(period_mm=0.0), Tip(), library)[0]
    axis = np.linalg.eigh(change.T @ change)[1][:, -1]  # pins tilt across the bars
    angle = np.rad2deg(np.arctan2(axis[1], axis[0]))
    assert (angle - yaw + 90) % 180 - 90 == pytest.approx(0, abs=4)


def test_offset_and_shear_move_the_picture(library):
    tip = Tip(camera_height_mm=1e9)
    plain = noiseless(one_tap(), tip, library)[0].reshape(19, 19, 2)
    moved = noiseless(one_tap(offset_x_mm=1.2, shear_y_mm=0.5), tip, library)[0]
    moved = moved.reshape(19, 19, 2) - [0, 0.5]
    assert moved[:, 1:] == pytest.approx(plain[:, :-1], abs=1e-6)
    nearer = noiseless(one_tap(), Tip(), library)[0].reshape(19, 19, 2)
    outward = (nearer - plain)[9, 4:15, 0]
    assert np.all(np.diff(np.abs(outward)[5:9]) > 0)
    assert np.all(outward[6:] > 0)


def test_same_seed_same_bytes_and_no_look_ahead(library):
    periods, yaws = np.tile(PLAN.periods_mm, 250), np.linspace(-90, 90, 750)

    def taps(count):
        rng = np.random.default_rng(5)
        return simulate(periods[:count], yaws[:count], rng=rng, library=library)

    first, again, start = taps(750), taps(750), taps(40)
    assert first.displacement_mm.tobytes() == again.displacement_mm.tobytes()
    assert first.displacement_mm[:40].tobytes() == start.displacement_mm.tobytes()
    assert first.labels[:40].equals(start.labels)


def test_the_default_library_is_that_of_the_skin_and_the_tip(library, monkeypatch):
    asked = []

    def contact_library(plan):
        asked.append(plan)
        return library

    monkeypatch.setattr("bgmodel.tactile.library.contact_library", contact_library)
    soft, small = Skin(gel_mm=9.0), Tip(radius_mm=15.0)
    for parts in ({}, {"skin": soft}, {"tip": small}, {"skin": soft, "tip": small}):
        simulate(2.0, 0.0, rng=np.random.default_rng(0), **parts)
    wanted = ({}, {"skin": soft}, {"radius_mm": 15.0}, {"skin": soft, "radius_mm": 15.0})
    assert asked == [LibraryPlan(**parts) for parts in wanted]


def test_nuisances_have_their_size(library):
    def taps(**change):
        nuisance = dataclasses.replace(Nuisance(), **change)
        rng = np.random.default_rng(1)
        return simulate(np.full(800, 2.0), 45.0, rng=rng, nuisance=nuisance, library=library)

    noisy, clean = taps(), taps(marker_noise_um=0)
    assert noisy.labels.equals(clean.labels)
    noise = noisy.displacement_mm - clean.displacement_mm
    assert noise.std() == pytest.approx(9.5e-3, rel=0.01)
    assert clean.labels.force_n.between(1.2, 1.8).all()
    assert clean.labels.force_n.std() == pytest.approx(0.6 / 12**0.5, rel=0.05)
    assert clean.labels.offset_x_mm.std() == pytest.approx(0.3, rel=0.1)
    assert clean.labels.shear_y_mm.std() == pytest.approx(0.03, rel=0.1)
    assert clean.labels.phase.between(0, 1).all()
    assert clean.labels.phase.std() == pytest.approx(1 / 12**0.5, rel=0.05)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"periods_mm": [3.0]}, "period_mm"),
        ({"periods_mm": [np.nan]}, "periods_mm"),
        ({"yaw_deg": [0.0, np.inf]}, "yaw_deg"),
        ({"periods_mm": [2.0, 2.0], "yaw_deg": [1, 2, 3]}, "yaw_deg"),
        ({"nuisance": Nuisance(force_n=(1.0, 1.1))}, "force_n"),
        ({"skin": Skin(skin_mm=2.0)}, "library"),
        ({"tip": Tip(radius_mm=15.0)}, "library"),
        ({"tip": Tip(pitch_mm=2.0)}, "pin_mm"),
    ],
)
def test_taps_that_the_library_does_not_hold_are_refused(library, change, message):
    arguments = {"periods_mm": [2.0], "yaw_deg": 0.0, "library": library} | change
    with refused(message):
        simulate(**arguments, rng=np.random.default_rng(0))


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


def test_taps_are_selected_by_a_mask(library):
    options = {"rng": np.random.default_rng(0), "nuisance": STILL, "library": library}
    taps = simulate([0.0, 2.0, 5.0, 2.0], 10.0, **options)
    fine = taps.select(taps.labels.period_mm == 2.0)
    assert len(fine) == 2
    assert np.array_equal(fine.displacement_mm, taps.displacement_mm[[1, 3]])
    assert fine.labels.index.tolist() == [0, 1]
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
