"""Gratings: bars where the phase says, and refusals."""

import numpy as np
import pytest

from bgmodel.tactile.pressing import PERIODS_MM, Grating
from tests.tactile.plans import places


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
