"""The layered skin against closed forms, the pins of each layout, and pictures of the markers."""

import numpy as np
import pytest

from bgmodel.tactile.skin import Skin, Tip, _discs, marker_pixels, pixels_per_mm, render, response

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


@pytest.mark.parametrize(("layout", "n"), [("square", 361), ("hexagonal", 127), ("circular", 331)])
def test_pins_of_every_layout_lie_a_pitch_apart_about_the_centre(layout, n):
    rest = Tip(layout, pitch_mm=2.0).rest_mm()
    assert rest.shape == (n, 2)
    apart = np.linalg.norm(rest[:, None] - rest, axis=2)[~np.eye(n, dtype=bool)]
    assert apart.min() == pytest.approx(2.0, rel=0.05)
    assert rest.mean(axis=0) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize(("layout", "pairs"), [("square", 2 * 19 * 18), ("hexagonal", 342)])
def test_neighbours_of_a_lattice_are_a_pitch_apart(layout, pairs):
    # A hexagon of k rings of a triangular lattice has 9 k^2 + 3 k pairs of neighbours.
    rest = Tip(layout, pitch_mm=1.0).rest_mm()
    apart = np.linalg.norm(rest[:, None] - rest, axis=2)
    assert np.isclose(apart, 1.0, rtol=0, atol=1e-12).sum() == 2 * pairs


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
    centres = []
    for place in places:
        near = light * (np.hypot(columns - place[0], rows - place[1]) < 0.42 * scale)
        centres.append([(near * columns).sum(), (near * rows).sum()] / near.sum())
    error = np.abs(centres - places).max()
    assert error < (0.05 if shape[0] == 480 else 0.3)


@pytest.mark.parametrize(("radius", "blur"), [(1.2, 0.5), (3.0, 0.6), (6.0, 1.2)])
def test_a_marker_is_a_disc_with_a_logistic_edge_on_all_sides(radius, blur):
    places = np.array([[15.0, 14.0], [28.4, 29.3], [13.5, 32.0]])
    rows, columns = np.indices((48, 48))
    distance = np.hypot(columns - places[:, :1, None], rows - places[:, 1:, None])
    want = (1 / (1 + np.exp(3 * (distance - radius) / blur))).max(axis=0)
    np.testing.assert_allclose(_discs(places, radius, (48, 48)), want, atol=2e-4)


def test_a_marker_at_the_rim_is_cut_off_where_the_picture_ends():
    side, margin = 24, 12
    places = np.array([[0.2, 5.0], [22.7, 11.0], [6.0, -0.4], [15.0, 23.3], [-1.0, 24.0]])
    small = _discs(places, 3.0, (side, side))
    large = _discs(places + margin, 3.0, (side + 2 * margin,) * 2)
    np.testing.assert_allclose(small, large[margin:-margin, margin:-margin])
    assert min(small[0].max(), small[-1].max(), small[:, 0].max(), small[:, -1].max()) > 0.5


def test_a_marker_is_bright_and_as_wide_as_its_diameter_on_a_dark_ground():
    """Of 225 on 18 in its middle, and half-way between the two at its edge."""
    tip, side = Tip(), 481
    pixels = pixels_per_mm(tip, (side, side))
    # The aperture, a pitch beyond the corner pin 9 pitches away each way, fills the height.
    assert pixels == pytest.approx(side / 2 / (1.2 * (9 * 2**0.5 + 1)))
    for marker_mm, image in (
        (0.6, render(0, tip, shape=(side, side))),
        (0.9, render(0, tip, shape=(side, side), marker_mm=0.9)),
    ):
        middle, half = side // 2, round(0.6 * pixels)
        assert image[middle, middle] == 225
        # The pins form squares, whose centres are farthest from them and least lit.
        assert image[middle - half, middle - half] == 18
        near = image[middle - half : middle + half + 1, middle - half : middle + half + 1]
        area = np.count_nonzero(near > (18 + 225) / 2) / pixels**2
        assert area == pytest.approx(np.pi * (marker_mm / 2) ** 2, rel=0.08)


def test_light_falls_with_the_square_of_the_distance_and_ends_at_the_rim():
    """About a third (0.35) less at the rim; markers are large, so that their middles are full."""
    tip, side = Tip(), 480
    image = render(np.zeros((len(tip.rest_mm()), 2)), tip, shape=(side, side), marker_mm=1.0)
    x, y = marker_pixels(0, tip, (side, side)).T
    distance = np.hypot(x - (side - 1) / 2, y - (side - 1) / 2) / (side / 2)
    inside = distance < 0.95
    middles = image[np.round(y[inside]).astype(int), np.round(x[inside]).astype(int)]
    expected = middles.max() * (1 - 0.35 * distance[inside] ** 2)
    assert distance[inside].max() > 0.8
    np.testing.assert_allclose(middles, expected, rtol=0.03)
    rows, columns = np.indices(image.shape) - (side - 1) / 2
    apart = np.hypot(rows, columns) / (side / 2)
    assert not image[apart > 1].any()
    assert image[apart < 0.97].all()
