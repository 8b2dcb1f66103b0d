"""What makes no sense is refused by the name of its field, everywhere on the way of a tap."""

import dataclasses
from functools import partial

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates

from bgmodel.tactile.contact import polonsky_keer
from bgmodel.tactile.decoder import Training
from bgmodel.tactile.library import (
    contact_library,
    entry,
    gather,
    node_weights,
    phase_weights,
    with_mirror_images,
)
from bgmodel.tactile.pressing import PERIODS_MM, Grating, LibraryPlan, press
from bgmodel.tactile.sensor import Nuisance
from bgmodel.tactile.skin import Skin, Tip, render, response
from bgmodel.tactile.source import source
from bgmodel.tactile.task import EdgeDirection, EdgeTurn, Orientation
from tests.helpers import refused, refusing
from tests.tactile.plans import PLAN, TINY, places

NAN, INF = np.nan, np.inf
NONE = [0.0, -1.0, NAN]
SURFACE = {"gap_mm": np.zeros((16, 16)), "compliance": np.ones((9, 16))}
FLAT = partial(polonsky_keer, **SURFACE, load_n=1.0, dx_mm=1.0)
WRONG = {
    Tip: {"layout": ["round"], "pitch_mm": [0.0, INF], "pin_mm": [-0.1], "camera_height_mm": [0.0]},
    Skin: {"skin_mm": NONE, "skin_shear_mpa": NONE, "gel_mm": NONE, "gel_shear_mpa": NONE},
    Nuisance: {"force_n": [(1.8, 1.2)], "marker_noise_um": [-1.0]},
    LibraryPlan: {
        "phases": [1], "forces_n": [(1.5, 1.2), (1.5,), (0.0, 1.5)], "dx_mm": [0.3],
        "stored_dx_mm": [0.3], "radius_mm": [NAN, -20.0], "tol": [0.0], "field_side_mm": [34.0],
    },
    partial(Grating, 1.0): {"depth_mm": [INF], "phase": [NAN]},
    FLAT: {
        "gap_mm": [np.zeros(4), np.full((16, 16), NAN)], "load_n": [0.0], "dx_mm": [-1.0],
        "compliance": [np.ones((16, 16)), -np.ones((9, 16))], "tol": [NAN],
        "start_mpa": [np.zeros((16, 16))],
    },
    partial(response, Skin()): {"wavenumber_per_mm": [-1.0, [1.0, NAN]]},
    partial(render, 0): {"marker_mm": [5.0], "shape": [(15, 16)]},
    render: {"displacement_mm": [np.zeros((3, 2))]},
    partial(contact_library, TINY): {"workers": [0]},
    Training: {
        "width": [0], "epochs": [0], "validation": [0.0, 1.0], "dropout": [-0.1, 2.1],
        "learning_rate": [0.0], "network": ["forest"],
    },
    Orientation: {"channels": [9]},
    EdgeTurn: {"channels": [9], "step_deg": [0.0]},
    partial(EdgeDirection, 4): {"step_deg": [91.0]},
    Grating: {"period_mm": [-1.0]},
}  # fmt: skip
"""Calls, and values of their arguments that each of them refuses by the name of the argument."""


@pytest.mark.parametrize("call", WRONG, ids=lambda call: getattr(call, "func", call).__name__)
def test_what_makes_no_sense_is_refused_by_the_name_of_its_field(call):
    for field, values in WRONG[call].items():
        for value in values:
            with refused(field):
                call(**{field: value})


FEW_EDGES = pd.DataFrame(dict.fromkeys(("yaw_deg", "edge_deg"), np.arange(-180.0, 180.0, 6.0)))


test_fields_that_do_not_fit_together_are_refused = refusing(
    (lambda: LibraryPlan(stored_dx_mm=0.0625), "dx_mm stored_dx_mm must not be smaller"),
    (lambda: LibraryPlan(periods_mm=(1.1,)), "period_mm"),
    (lambda: Grating(1.0).on_grid(64, 0.2), "period_mm"),
    (lambda: source(pd.DataFrame({"psi_deg": [1]}), EdgeTurn()), "taps an edge, with yaw_deg, "),
    (lambda: source(FEW_EDGES, EdgeTurn()), "pool too few"),
)


def test_the_library_is_the_same_file_whatever_the_workers(tmp_path, monkeypatch):
    paths = []
    for workers in (1, 2):
        monkeypatch.setenv("BGMODEL_CACHE", str(tmp_path / str(workers)))
        contact_library(TINY, workers=workers)
        paths.append(entry(TINY).path)
    one, two = paths
    assert one.read_bytes() == two.read_bytes()
    assert [p.name for p in one.parent.iterdir()] == [one.name]


def test_mirror_images_are_the_solutions():
    direct = np.moveaxis(press(PLAN, 5.0, 6 / 8), -1, 0)
    half = np.moveaxis(np.stack([press(PLAN, 5.0, j / 8) for j in range(5)]), -1, 0)
    images = with_mirror_images(half, 8)
    assert images.shape[1] == 8
    assert np.abs(images[:, 6] - direct).max() < 1e-4
    assert np.abs(images[:, 2] - direct).max() > 1e-2


def test_fields_between_phases_and_forces_are_those_of_the_solver(library):
    points = Tip().rest_mm()[None]
    for period, phase, force in ((5.0, 0.31, 1.35), (2.0, 0.31, 1.35), (5.0, 0.94, 1.7)):
        exact = dataclasses.replace(PLAN, forces_n=(force, 1.9), periods_mm=(period,))
        fields = press(exact, period, phase)[None]
        alone = dataclasses.replace(library, plan=exact, fields={0.0: fields})
        wanted = alone.sample(0.0, np.zeros(1), np.array([force]), points, 1.5)
        sampled = library.sample(period, np.array([phase]), np.array([force]), points, 1.5)
        # In the root mean square well below the 9.5 um of a marker.
        assert np.sqrt(np.mean((sampled - wanted) ** 2)) < 1.5e-3


NODES = (0.5, 1.0, 2.5, 4.0)
AMPLITUDES = st.lists(st.floats(-2, 2), min_size=5, max_size=5)


@given(st.integers(1, 9), AMPLITUDES, AMPLITUDES, st.floats(-3, 3))
def test_phases_blend_exactly_up_to_the_harmonic_that_so_many_can_hold(count, even, odd, phase):
    def curve(at):
        turns = 2 * np.pi * np.arange((count - 1) // 2 + 1) * np.asarray(at)[..., None]
        terms = turns.shape[-1]
        return np.cos(turns) @ even[:terms] + np.sin(turns) @ odd[:terms]

    weights = phase_weights(np.array([phase]), count)
    assert weights.shape == (1, count)
    assert weights @ curve(np.arange(count) / count) == pytest.approx(curve([phase]), abs=1e-9)


@given(st.floats(0.5, 4), st.lists(st.floats(-2, 2), min_size=4, max_size=4))
def test_nodes_blend_exactly_up_to_the_degree_that_so_many_can_hold(value, powers):
    curve = np.polynomial.Polynomial(powers)
    blend = node_weights(np.array([value]), NODES) @ curve(np.array(NODES))
    assert blend == pytest.approx([curve(value)], abs=1e-9)


def test_splines_are_those_of_scipy_blended_by_the_weights():
    rng = np.random.default_rng(61)
    size, values, blends, taps, pins = 9, 2, 3, 4, 5
    coefficients = rng.normal(size=(size, size, values * blends)).astype(np.float32)
    points = rng.uniform(1.0, size - 2.001, (taps, pins, 2))
    points[0, 0] = 3.0, 4.0
    weights = rng.normal(size=(taps, blends)).astype(np.float32)
    out = np.empty((taps, pins, values), np.float32)
    gather(coefficients, points, weights, out)
    places = points.reshape(-1, 2).T
    each = [map_coordinates(one.T, places, order=3, prefilter=False) for one in coefficients.T]
    by_scipy = np.stack(each, axis=-1).reshape(taps, pins, values, blends)
    expected = (by_scipy * weights[:, None, None]).sum(axis=-1)
    np.testing.assert_allclose(out, expected, rtol=1e-4, atol=1e-5)


def test_every_parameter_is_in_the_key():
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
        assert dataclasses.replace(TINY, **{field.name: value}).key != TINY.key, field.name


def test_mirror_images_are_not_solved():
    """Phases 0 and 1/2 are their own images; a smooth plate has no phase."""
    for phases, solved in ((2, 2), (3, 2), (4, 3), (7, 4), (8, 5)):
        plan = dataclasses.replace(TINY, phases=phases)
        assert plan.solved_phases(4.0) == solved
        assert plan.solved_phases(0.0) == 1


def test_the_interface_under_a_small_contact_moves_as_boussinesq_says():
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


@pytest.mark.parametrize("period_mm", PERIODS_MM)
@pytest.mark.parametrize("phase", [0.0, 0.1, -0.4, 1.25])
def test_grating_is_where_its_phase_says(period_mm, phase):
    cells, dx = 256, 0.125
    depth, apex = Grating(period_mm, 0.7, phase).on_grid(cells, dx)
    if period_mm == 0:
        assert not depth.any()
        return
    x = places(cells, dx) - apex
    from_bar = np.abs((x / period_mm - phase + 0.5) % 1 - 0.5) * period_mm
    assert np.array_equal(depth > 0, from_bar > period_mm / 4)
    assert set(depth) == {0.0, 0.7}
    assert abs(apex) <= dx / 2 + 1e-12
    edges = np.flatnonzero(np.diff(depth))
    assert np.all(np.diff(edges) * dx == period_mm / 2)
