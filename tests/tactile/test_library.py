"""The library of contacts: kept, found again, rebuilt, and interpolated as exactly as promised."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates

from bgmodel.tactile.library import (
    contact_library,
    entry,
    gather,
    node_weights,
    phase_weights,
    with_mirror_images,
)
from bgmodel.tactile.pressing import press
from bgmodel.tactile.skin import Tip
from tests.tactile.plans import PLAN, TINY


def test_the_library_is_the_same_file_whatever_the_workers(tmp_path):
    for workers in (1, 2):
        contact_library(TINY, cache_dir=tmp_path / str(workers), workers=workers)
    one, two = (entry(TINY, tmp_path / str(w)).path for w in (1, 2))
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
        alone = dataclasses.replace(library, plan=exact, fields={0.0: fields}, _splines={})
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
    by_scipy = np.stack(
        [map_coordinates(one.T, places, order=3, prefilter=False) for one in coefficients.T],
        axis=-1,
    ).reshape(taps, pins, values, blends)
    expected = (by_scipy * weights[:, None, None]).sum(axis=-1)
    np.testing.assert_allclose(out, expected, rtol=1e-4, atol=1e-5)
