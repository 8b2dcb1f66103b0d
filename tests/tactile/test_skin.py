"""The layered skin against closed forms, and the pins of each layout."""

import numpy as np
import pytest

from bgmodel.tactile.skin import Skin, Tip, response

K = np.geomspace(0.05, 100, 60)


def test_a_thick_uniform_body_is_the_half_space():
    shear = 0.02
    body = Skin(skin_mm=0.7, skin_shear_mpa=shear, gel_mm=400, gel_shear_mpa=shear)
    waves = response(body, K)
    kz = K * 0.7
    assert waves.compliance == pytest.approx(1 / (2 * shear * K), rel=1e-9)
    decay = np.exp(-kz) / (2 * shear * K)
    assert waves.interface_depth == pytest.approx((1 + kz) * decay, rel=1e-9)
    assert waves.interface_lateral == pytest.approx(-kz * decay, rel=1e-9)


def test_a_uniform_layer_on_a_window_has_its_closed_form():
    # An incompressible bonded layer, closed form: the two layers add up to one of 3 mm.
    shear, kh = 0.3, K * 3.0
    layer = Skin(skin_mm=1.2, skin_shear_mpa=shear, gel_mm=1.8, gel_shear_mpa=shear)
    # Numerator and denominator times exp(-2kh), so as not to overflow.
    above = (1 - np.exp(-4 * kh)) / 2 - 2 * kh * np.exp(-2 * kh)
    below = (1 + np.exp(-4 * kh)) / 2 + (1 + 2 * kh**2) * np.exp(-2 * kh)
    assert response(layer, K).compliance == pytest.approx(above / below / (2 * shear * K), rel=1e-6)


def test_no_mean_displacement_and_no_overflow():
    waves = response(Skin(), [[0.0, 1.0], [1e3, 1e6]])
    assert waves.compliance.shape == (2, 2)
    assert waves.compliance[0, 0] == 0
    assert np.all(np.isfinite(waves))


@pytest.mark.parametrize(
    ("layout", "pins"), [("square", 361), ("hexagonal", 127), ("circular", 331)]
)
def test_pins_of_every_layout_lie_a_pitch_apart_about_the_centre(layout, pins):
    rest = Tip(layout, pitch_mm=2.0).rest_mm()
    assert rest.shape == (pins, 2)
    apart = np.linalg.norm(rest[:, None] - rest, axis=2)[~np.eye(pins, dtype=bool)]
    assert apart.min() == pytest.approx(2.0, rel=0.05)
    assert rest.mean(axis=0) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize(("layout", "pairs"), [("square", 2 * 19 * 18), ("hexagonal", 342)])
def test_neighbours_of_a_lattice_are_a_pitch_apart(layout, pairs):
    # A hexagon of k rings of a triangular lattice has 9 k^2 + 3 k pairs of neighbours.
    rest = Tip(layout, pitch_mm=1.0).rest_mm()
    apart = np.linalg.norm(rest[:, None] - rest, axis=2)
    assert np.isclose(apart, 1.0, rtol=0, atol=1e-12).sum() == 2 * pairs
