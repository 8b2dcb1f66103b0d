"""The simulated sensor: pins, nuisances, symmetries."""

import dataclasses

import numpy as np
import pytest

from bgmodel.tactile.library import Library
from bgmodel.tactile.pressing import LibraryPlan, press
from bgmodel.tactile.sensor import Nuisance, noiseless, simulate
from bgmodel.tactile.skin import Skin, Tip
from tests.helpers import refused
from tests.tactile.plans import PLAN, one_tap


def test_smooth_plate_does_not_tell_its_yaw():
    """A smooth plate has no orientation; images of a periodic square nearby would give it one."""

    def rms_um(side):
        plan = LibraryPlan(periods_mm=(0.0,), field_side_mm=side)
        smooth = Library(plan, {0.0: press(plan, 0.0, 0.0)[None]})
        size = [
            np.linalg.norm(noiseless(one_tap(period_mm=0.0, yaw_deg=yaw), Tip(), smooth)[0], axis=1)
            for yaw in (0, 45)
        ]
        return 1000 * np.sqrt(np.mean((size[0] - size[1]) ** 2))

    # About a hundredth of the marker noise; at 36 mm, the control, ten times as much.
    assert rms_um(LibraryPlan().field_side_mm) < 0.12
    assert rms_um(36.0) > 1.2


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
    for noise_per in ("tap", "frame"):
        nuisance = Nuisance(noise_per=noise_per, frames=3)

        def taps(count, nuisance=nuisance):
            rng = np.random.default_rng(5)
            return simulate(
                periods[:count], yaws[:count], rng=rng, nuisance=nuisance, library=library
            )

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
    assert asked == [
        LibraryPlan(),
        LibraryPlan(skin=soft),
        LibraryPlan(radius_mm=15.0),
        LibraryPlan(skin=soft, radius_mm=15.0),
    ]


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


def test_frames_are_kept_at_the_peak(library):
    nuisance = Nuisance(noise_per="frame", frames=9)
    profile = nuisance.press_profile()
    assert profile.max() == profile[4] == 1
    assert np.all(np.diff(profile[:5]) > 0)
    rng = np.random.default_rng(2)
    taps = simulate(np.full(20, 5.0), 0.0, rng=rng, nuisance=nuisance, library=library)
    assert (taps.labels.frame == 4).all()
    noise = taps.displacement_mm - noiseless(taps.labels, Tip(), library)
    assert noise.std() == pytest.approx(9.5e-3, rel=0.05)


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
