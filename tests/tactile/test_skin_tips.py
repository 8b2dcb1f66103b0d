"""Tips: the pins of each layout."""

import numpy as np
import pytest

from bgmodel.tactile.skin import Tip


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
