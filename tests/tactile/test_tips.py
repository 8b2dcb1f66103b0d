"""Tips: the pins of each layout."""

import numpy as np
import pytest

from bgmodel.tactile.tips import Tip


@pytest.mark.parametrize(
    ("layout", "pins"), [("square", 361), ("hexagonal", 127), ("circular", 331)]
)
def test_pins_of_every_layout_lie_a_pitch_apart_about_the_centre(layout, pins):
    rest = Tip(layout, pitch_mm=2.0).rest_mm()
    assert rest.shape == (pins, 2)
    apart = np.linalg.norm(rest[:, None] - rest, axis=2)[~np.eye(pins, dtype=bool)]
    assert apart.min() == pytest.approx(2.0, rel=0.05)
    assert rest.mean(axis=0) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize(
    ("made", "change", "message"),
    [
        (Tip, {"layout": "round"}, r"Tip\.layout: got 'round'"),
        (Tip, {"pitch_mm": 0.0}, r"Tip\.pitch_mm"),
    ],
)
def test_tips_without_sense_are_refused(made, change, message):
    with pytest.raises(ValueError, match=message):
        made(**change)
