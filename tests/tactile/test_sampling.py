"""Values between grid points, phases and forces: exact where the interpolation promises it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates

from bgmodel.tactile.sampling import gather, node_weights, phase_weights

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
