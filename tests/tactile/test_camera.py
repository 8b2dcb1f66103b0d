"""Pictures of the markers."""

import numpy as np
import pytest

from bgmodel.tactile.camera import marker_pixels, render
from bgmodel.tactile.tips import Tip


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


def test_a_picture_that_cannot_be_drawn_is_refused():
    with pytest.raises(ValueError, match=r"displacement_mm: got shape \(3, 2\)"):
        render(np.zeros((3, 2)))
    with pytest.raises(ValueError, match="marker_mm"):
        render(0, marker_mm=5.0)
    with pytest.raises(ValueError, match="shape: got"):
        render(0, shape=(4, 4))
