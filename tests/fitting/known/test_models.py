"""Sums that leak against their closed form, and runs of equal cues."""

import numpy as np

from bgmodel.fitting.known.models import leaky_sums, runs_of_cues


def test_a_leak_is_the_sum_of_decayed_readings():
    rng = np.random.default_rng(1)
    values, time_s = rng.normal(size=(5, 6, 2)), np.sort(rng.uniform(0, 2, (5, 6)), axis=1)
    sums = leaky_sums(values, time_s, 1.7)
    for k in range(6):
        kept = np.exp(-1.7 * (time_s[:, k, None] - time_s[:, : k + 1]))
        np.testing.assert_allclose(sums[:, k], (values[:, : k + 1] * kept[:, :, None]).sum(axis=1))


def test_runs_begin_anew_with_each_change_and_end_at_a_tie():
    favours = [0, 0, 1, 1, 1, -1, 1]
    values = np.zeros((1, 7, 2))
    for k, side in enumerate(favours):
        if side >= 0:
            values[0, k, side] = 1.0 + k
    expected = np.array([[1, 0], [2, 0], [0, 1], [0, 2], [0, 3], [0, 0], [0, 1]])
    np.testing.assert_array_equal(runs_of_cues(values)[0], expected)
