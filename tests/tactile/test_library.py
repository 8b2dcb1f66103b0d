"""The library of contacts: kept, found again, rebuilt, interpolated."""

import dataclasses

import numpy as np

from bgmodel.tactile.library import contact_library, entry, with_mirror_images
from bgmodel.tactile.pressing import press
from bgmodel.tactile.skin import Tip
from tests.tactile.plans import PLAN, TINY


def test_the_library_is_the_same_file_whatever_the_workers(tmp_path):
    for workers in (1, 2):
        contact_library(TINY, cache_dir=tmp_path / str(workers), workers=workers)
    one, two = (entry(TINY, tmp_path / str(w)).path for w in (1, 2))
    assert one.read_bytes() == two.read_bytes()
    assert [p.name for p in one.parent.iterdir()] == [one.name]


def test_mirror_images_are_the_solutions():
    direct = np.moveaxis(press(PLAN, 5.0, 6 / 8), -1, 0)
    half = np.moveaxis(np.stack([press(PLAN, 5.0, j / 8) for j in range(5)]), -1, 0)
    images = with_mirror_images(half, 8)
    assert images.shape[1] == 8
    assert np.abs(images[:, 6] - direct).max() < 1e-4
    assert np.abs(images[:, 2] - direct).max() > 1e-2


def test_fields_between_phases_and_forces_are_those_of_the_solver(library):
    points = Tip().rest_mm()[None]
    for period, phase, force in ((5.0, 0.31, 1.35), (2.0, 0.31, 1.35), (5.0, 0.94, 1.7)):
        exact = dataclasses.replace(PLAN, forces_n=(force, 1.9), periods_mm=(period,))
        fields = press(exact, period, phase)[None]
        alone = dataclasses.replace(library, plan=exact, fields={0.0: fields}, _splines={})
        wanted = alone.sample(0.0, np.zeros(1), np.array([force]), points, 1.5)
        sampled = library.sample(period, np.array([phase]), np.array([force]), points, 1.5)
        # In the root mean square well below the 9.5 um of a marker.
        assert np.sqrt(np.mean((sampled - wanted) ** 2)) < 1.5e-3
