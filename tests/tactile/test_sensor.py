"""The simulated sensor: library, pins, nuisances, pictures."""

import dataclasses

import numpy as np
import pandas as pd
import pytest

from bgmodel.tactile.camera import marker_pixels, render
from bgmodel.tactile.library import Library, contact_library, with_mirror_images
from bgmodel.tactile.pressing import LibraryPlan, press
from bgmodel.tactile.sensor import Nuisance, noiseless, simulate
from bgmodel.tactile.skin import Skin
from bgmodel.tactile.taps import Taps
from bgmodel.tactile.tips import Tip

PLAN = LibraryPlan(
    periods_mm=(0.0, 2.0, 5.0),
    phases=8,
    forces_n=(1.2, 1.5, 1.8),
    dx_mm=0.25,
    stored_dx_mm=0.5,
    tol=1e-5,
)
TINY = dataclasses.replace(PLAN, periods_mm=(0.0, 4.0), phases=3, forces_n=(1.2, 1.8), dx_mm=0.5)
STILL = Nuisance(offset_sd_mm=0, shear_sd_mm=0, marker_noise_um=0)


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    return contact_library(PLAN, cache_dir=tmp_path_factory.mktemp("cache"))


def one_tap(period_mm=5.0, yaw_deg=0.0, phase=0.0, force_n=1.5, **others):
    row = {"period_mm": period_mm, "yaw_deg": yaw_deg, "phase": phase, "force_n": force_n}
    places = ["offset_x_mm", "offset_y_mm", "shear_x_mm", "shear_y_mm"]
    return pd.DataFrame([row | dict.fromkeys(places, 0.0) | others])


# --- library ---------------------------------------------------------------------------------


def test_same_file_whatever_the_workers(tmp_path):
    for workers in (1, 2):
        contact_library(TINY, cache_dir=tmp_path / str(workers), workers=workers)
    one, two = (tmp_path / str(w) / TINY.name for w in (1, 2))
    assert one.read_bytes() == two.read_bytes()
    assert [p.name for p in one.parent.iterdir()] == [TINY.name]


def test_kept_and_found_by_environment(tmp_path, monkeypatch):
    monkeypatch.setenv("BGMODEL_CACHE", str(tmp_path))
    first = contact_library(TINY)
    monkeypatch.setattr("bgmodel.tactile.library.press", None)  # must not be needed again
    second = contact_library(TINY)
    for period in TINY.periods_mm:
        assert np.array_equal(first.fields[period], second.fields[period])


@pytest.mark.parametrize("damage", ["cut", "noise", "empty", "flipped", "other plan"])
def test_damaged_file_is_rebuilt(tmp_path, damage):
    path = tmp_path / TINY.name
    contact_library(TINY, cache_dir=tmp_path)
    whole = path.read_bytes()
    other = dataclasses.replace(TINY, forces_n=(1.2, 1.7))
    if damage == "other plan":
        contact_library(other, cache_dir=tmp_path)
    damaged = {
        "cut": lambda: whole[: len(whole) // 2],
        "noise": lambda: b"not an archive",
        "empty": lambda: b"",
        "flipped": lambda: whole[:5000] + bytes([whole[5000] ^ 255]) + whole[5001:],
        "other plan": lambda: (tmp_path / other.name).read_bytes(),
    }[damage]()
    path.write_bytes(damaged)
    contact_library(TINY, cache_dir=tmp_path)
    assert path.read_bytes() == whole


def test_every_parameter_is_in_the_name():
    changed = {
        "skin": Skin(skin_mm=1.1),
        "periods_mm": (0.0,),
        "phases": 4,
        "forces_n": (1.0, 2.0),
        "side_mm": 16.0,
        "field_side_mm": 64.0,
        "kept_mm": 32.0,
    }
    for field in dataclasses.fields(TINY):
        value = changed.get(field.name) or getattr(TINY, field.name) / 2
        if field.name == "stored_dx_mm":
            value = 1.0
        assert dataclasses.replace(TINY, **{field.name: value}).name != TINY.name, field.name


def test_equal_plans_share_a_name():
    same = dataclasses.replace(PLAN, radius_mm=20, periods_mm=[0, 2, 5], skin=Skin(gel_mm=15))
    assert same == PLAN
    assert same.name == PLAN.name


def test_mirror_images_are_the_solutions():
    direct = np.moveaxis(press(PLAN, 5.0, 6 / 8), -1, 0)
    half = np.moveaxis(np.stack([press(PLAN, 5.0, j / 8) for j in range(5)]), -1, 0)
    images = with_mirror_images(half, 8)
    assert images.shape[1] == 8
    assert np.abs(images[:, 6] - direct).max() < 1e-4
    assert np.abs(images[:, 2] - direct).max() > 1e-2


def test_between_phases_and_forces(library):
    points = Tip().rest_mm()[None]
    for period, phase, force in ((5.0, 0.31, 1.35), (2.0, 0.31, 1.35), (5.0, 0.94, 1.7)):
        exact = dataclasses.replace(PLAN, forces_n=(force, 1.9), periods_mm=(period,))
        fields = press(exact, period, phase)[None]
        alone = dataclasses.replace(library, plan=exact, fields={0.0: fields}, _splines={})
        wanted = alone.sample(0.0, np.zeros(1), np.array([force]), points, 1.5)
        given = library.sample(period, np.array([phase]), np.array([force]), points, 1.5)
        # In the root mean square well below the 9.5 um of a marker.
        assert np.sqrt(np.mean((given - wanted) ** 2)) < 1.5e-3


def test_interface_under_a_small_contact():
    # A point load on an incompressible half-space (Boussinesq): outwards, and down.
    shear, load = 0.1, 0.001
    body = Skin(skin_mm=1.0, skin_shear_mpa=shear, gel_mm=200.0, gel_shear_mpa=shear)
    plan = dataclasses.replace(
        PLAN, skin=body, radius_mm=2.0, forces_n=(load, 2 * load), dx_mm=0.125, stored_dx_mm=0.25
    )
    fields, place = press(plan, 0.0, 0.0)[0], (np.arange(144) - 71.5) * 0.25
    x, y = place[68:86, None], place[None, 72:80]
    distance = np.sqrt(x**2 + y**2 + 1)
    outwards = load / (4 * np.pi * shear) / distance**3
    down = load / (4 * np.pi * shear) * (1 / distance + 1 / distance**3)
    near = fields[68:86, 72:80]
    assert near[..., 0] == pytest.approx(x * outwards, abs=0.02 * (x * outwards).max())
    assert near[..., 1] == pytest.approx(y * outwards, abs=0.02 * (x * outwards).max())
    # Up to a constant: the mean displacement of a periodic surface is zero.
    error = near[..., 2] - down
    assert np.ptp(error) < 0.03 * np.ptp(down)


def test_field_passes_through_the_stored_values(library):
    cells = np.stack(np.meshgrid([5, 30, 31, 40], [20, 32, 63], indexing="ij"), axis=-1)
    points = (cells.reshape(1, -1, 2) + 0.5) * 0.5 - 18
    given = library.sample(2.0, np.array([2 / 8]), np.array([1.5]), points, 0.0)
    stored = library.fields[2.0][2, 1][cells[..., 0], cells[..., 1], :3].reshape(1, -1, 3)
    assert given == pytest.approx(stored, abs=1e-6)


def test_pins_beyond_the_field_are_refused(library):
    with pytest.raises(ValueError, match=r"allows 17 mm"):
        noiseless(one_tap(), Tip(pitch_mm=2.0), library)


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


# --- pins ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("layout", "pins"), [("square", 361), ("hexagonal", 127), ("circular", 331)]
)
def test_layouts(layout, pins):
    rest = Tip(layout, pitch_mm=2.0).rest_mm()
    assert rest.shape == (pins, 2)
    apart = np.linalg.norm(rest[:, None] - rest, axis=2)[~np.eye(pins, dtype=bool)]
    assert apart.min() == pytest.approx(2.0, rel=0.05)
    assert rest.mean(axis=0) == pytest.approx(0, abs=1e-12)


def test_quarter_turn_permutes_the_pins(library):
    tip = Tip()
    straight = noiseless(one_tap(phase=0.2), tip, library)[0]
    turned = noiseless(one_tap(phase=0.2, yaw_deg=90), tip, library)[0]
    rest, wanted = tip.rest_mm(), np.column_stack([-straight[:, 1], straight[:, 0]])
    to = np.column_stack([-rest[:, 1], rest[:, 0]])
    where = np.abs(to[:, None] - rest).sum(axis=2).argmin(axis=1)
    assert turned[where] == pytest.approx(wanted, abs=1e-6)
    assert np.abs(turned - straight).max() > 0.01


def test_half_turn_of_a_symmetric_grating_changes_nothing(library):
    for phase, same in ((0.0, True), (0.5, True), (0.25, False)):
        there = noiseless(one_tap(phase=phase), Tip(), library)
        back = noiseless(one_tap(phase=phase, yaw_deg=180), Tip(), library)
        assert (np.abs(there - back).max() < 1e-4) == same


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


# --- taps ------------------------------------------------------------------------------------


def test_same_seed_same_bytes_and_no_look_ahead(library):
    periods, yaws = np.tile(PLAN.periods_mm, 250), np.linspace(-90, 90, 750)
    for noise_per in ("tap", "frame"):
        nuisance = Nuisance(noise_per=noise_per, frames=3)

        def taps(count, nuisance=nuisance):
            rng = np.random.default_rng(5)
            return simulate(
                periods[:count], yaws[:count], rng=rng, nuisance=nuisance, library=library
            )

        whole, again, start = taps(750), taps(750), taps(40)
        assert whole.displacement_mm.tobytes() == again.displacement_mm.tobytes()
        assert whole.displacement_mm[:40].tobytes() == start.displacement_mm.tobytes()
        assert whole.labels[:40].equals(start.labels)


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


@pytest.mark.parametrize("layout", ["square", "hexagonal", "circular"])
def test_maps(library, layout):
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


def test_select_and_concatenate(library):
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
    with pytest.raises(ValueError, match="same pins"):
        Taps.concatenate([taps, other])
    with pytest.raises(ValueError, match="parts: got none"):
        Taps.concatenate([])
    with pytest.raises(ValueError, match=r"mask: got shape \(3,\)"):
        taps.select([True, False, True])
    with pytest.raises(ValueError, match=r"Taps\.displacement_mm"):
        Taps(taps.displacement_mm[:2], taps.rest_mm, taps.labels)


# --- pictures --------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(480, 640), (128, 128)])
def test_markers_are_drawn_where_they_are(shape):
    tip = Tip()
    displacement = np.random.default_rng(0).normal(0, 0.05, (361, 2))
    image = render(displacement, tip, shape=shape)
    assert image.shape == shape
    assert image.dtype == np.uint8
    assert image[0, 0] == 0
    rows, columns = np.indices(shape)
    scale = np.diff(marker_pixels(0, tip, shape)[:2, 0])[0]
    places = marker_pixels(displacement, tip, shape)
    light = np.clip(image.astype(float) - 40, 0, None)
    found = []
    for place in places:
        near = light * (np.hypot(columns - place[0], rows - place[1]) < 0.42 * scale)
        found.append([(near * columns).sum(), (near * rows).sum()] / near.sum())
    error = np.abs(found - places).max()
    assert error < (0.05 if shape[0] == 480 else 0.3)


# --- refusals --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("made", "change", "message"),
    [
        (Tip, {"layout": "round"}, r"Tip\.layout: got 'round'"),
        (Tip, {"pitch_mm": 0.0}, r"Tip\.pitch_mm"),
        (Nuisance, {"force_n": (1.8, 1.2)}, r"Nuisance\.force_n"),
        (Nuisance, {"marker_noise_um": -1.0}, r"Nuisance\.marker_noise_um"),
        (Nuisance, {"noise_per": "pin"}, r"Nuisance\.noise_per"),
        (Nuisance, {"frames": 0}, r"Nuisance\.frames"),
        (LibraryPlan, {"phases": 1}, r"LibraryPlan\.phases"),
        (LibraryPlan, {"forces_n": (1.5, 1.2)}, r"LibraryPlan\.forces_n"),
        (LibraryPlan, {"dx_mm": 0.3}, r"LibraryPlan\.dx_mm"),
        (LibraryPlan, {"stored_dx_mm": 0.3}, r"LibraryPlan\.stored_dx_mm"),
        (LibraryPlan, {"stored_dx_mm": 0.0625}, "the stored one not the smaller"),
        (LibraryPlan, {"radius_mm": np.nan}, r"LibraryPlan\.radius_mm"),
        (LibraryPlan, {"periods_mm": (1.1,)}, "whole number of cells"),
    ],
)
def test_parameters_refused(made, change, message):
    with pytest.raises(ValueError, match=message):
        made(**change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"periods_mm": [3.0]}, r"period_mm: got 3, the library has \[0.0, 2.0, 5.0\]"),
        ({"periods_mm": [np.nan]}, "periods_mm: got values that are not finite"),
        ({"yaw_deg": [0.0, np.inf]}, "yaw_deg: got values that are not finite"),
        ({"periods_mm": [2.0, 2.0], "yaw_deg": [1, 2, 3]}, r"shapes \(2,\) and \(3,\)"),
        ({"nuisance": Nuisance(force_n=(1.0, 1.1))}, r"force_n: got 1\.\d+ to 1\.\d+, the library"),
        ({"skin": Skin(skin_mm=2.0)}, "library: got one of"),
        ({"tip": Tip(radius_mm=15.0)}, "radius 15 mm"),
    ],
)
def test_simulate_refuses(library, change, message):
    arguments = {"periods_mm": [2.0], "yaw_deg": 0.0, "library": library} | change
    with pytest.raises(ValueError, match=message):
        simulate(**arguments, rng=np.random.default_rng(0))


def test_other_refusals(tmp_path):
    with pytest.raises(ValueError, match="workers: got 0"):
        contact_library(TINY, cache_dir=tmp_path, workers=0)
    with pytest.raises(ValueError, match=r"displacement_mm: got shape \(3, 2\)"):
        render(np.zeros((3, 2)))
    with pytest.raises(ValueError, match="marker_mm"):
        render(0, marker_mm=5.0)
    with pytest.raises(ValueError, match="shape: got"):
        render(0, shape=(4, 4))
