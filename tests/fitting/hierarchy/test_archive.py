"""Proposals near earlier draws."""

import numpy as np
import pytest
from scipy.stats import gaussian_kde

from bgmodel.fitting.hierarchy.archive import Archive
from bgmodel.support.seeds import stream

SEED = 24_315


@pytest.fixture
def archive():
    rng = stream(SEED, "earlier")
    modes = np.where(rng.random((2, 300, 1)) < 0.3, 4.0, 0.0)
    return Archive(modes + rng.normal(size=(2, 300, 2)))


def test_density_is_that_of_a_kernel_estimate(archive):
    points = stream(SEED, "points").normal(1, 2, size=(2, 2))
    exact = [
        gaussian_kde(one.T, bw_method="scott").logpdf(point)[0]
        for one, point in zip(archive.draws, points, strict=True)
    ]
    # Scott's rule there divides the covariance by n - 1.
    assert archive.log_density(points) == pytest.approx(exact, abs=0.02)


def test_draws_reach_all_modes_in_their_shares(archive):
    rng = stream(SEED, "draws")
    draws = np.array([archive.draw(rng) for _ in range(2000)])
    share = (archive.draws[..., 0] > 2).mean(axis=1)
    assert (draws[..., 0] > 2).mean(axis=0) == pytest.approx(share, abs=0.06)
    assert draws.mean(axis=0) == pytest.approx(archive.draws.mean(axis=1), abs=0.2)


def test_one_person_is_independent_of_the_others(archive):
    alone = Archive(archive.draws[1:])
    point = np.array([[0.3, -0.2]])
    both = archive.log_density(np.repeat(point, 2, axis=0))
    assert alone.log_density(point)[0] == pytest.approx(both[1])
