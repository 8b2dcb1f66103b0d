"""Plans of a library of contacts: their names, the contact they solve, and gratings."""

import dataclasses

import numpy as np
import pytest

from bgmodel.tactile.pressing import PERIODS_MM, Grating, press
from bgmodel.tactile.skin import Skin
from tests.tactile.plans import PLAN, TINY, places


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
