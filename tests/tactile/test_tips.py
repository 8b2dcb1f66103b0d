"""Tips: the pins of each layout."""

import numpy as np
import pytest

from bgmodel.tactile.tips import Tip


@pytest.mark.parametrize(
    ("layout", "pins"), [("square", 361), ("hexagonal", 127), ("circular", 331)]
)
def test_layouts(layout, pins):
    rest = Tip(layout, pitch_mm=2.0).rest_mm()
    assert rest.shape == (pins, 2)
    apart = np.linalg.norm(rest[:, None] - rest, axis=2)[~np.eye(pins, dtype=bool)]
    assert apart.min() == pytest.approx(2.0, rel=0.05)
    assert rest.mean(axis=0) == pytest.approx(0, abs=1e-12)
