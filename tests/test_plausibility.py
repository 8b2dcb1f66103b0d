"""Readings of a user's table: their serial correlation."""

import numpy as np

from bgmodel import stream
from bgmodel.plausibility import are_sums, products


def test_independent_readings_have_no_serial_correlation_however_short_the_trials():
    """Deviations from a trial's mean correlate by -1 / steps, which is subtracted."""
    rng = stream(1, "readings")
    for steps in (4, 10):
        pooled = np.array([products(x) for x in rng.normal(size=(4000, steps, 2))])
        lagged, squares = pooled[:, 0], pooled[:, 1]
        error = lagged.std() / np.sqrt(len(lagged))
        assert abs(lagged.mean()) < 4 * error
        assert squares.mean() / steps > 8 * error  # without the correction it would be seen
        assert not are_sums(pooled.sum(axis=0))
    summed = np.cumsum(rng.normal(size=(50, 10, 2)), axis=1)
    assert are_sums(np.sum([products(x) for x in summed], axis=0))
