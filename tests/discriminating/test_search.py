"""The search over a grid of tasks."""

import numpy as np

from bgmodel.discriminating.search import search

SIZES = (4, 5, 3, 6, 2)
BEST = (2, 3, 1, 4, 1)


def peak(place):
    return -sum((a - b) ** 2 for a, b in zip(place, BEST, strict=True))


def test_a_small_grid_is_searched_completely():
    found = search((2, 3), lambda place: float(sum(place)), evaluations=6, seed=1)
    assert len(found) == 6
    assert max(found, key=found.get) == (1, 2)


def test_a_large_grid_is_searched_within_the_budget_and_better_than_at_random():
    ranks = []
    every = sorted((peak(place) for place in np.ndindex(*SIZES)), reverse=True)
    for seed in range(8):
        found = search(SIZES, peak, evaluations=80, seed=seed)
        assert len(found) <= 80
        ranks.append(every.index(max(found.values())))
    # The best of 80 random places has rank 720 / 81 on average.
    assert np.mean(ranks) < 0.5 * np.prod(SIZES) / 81


def test_a_search_repeats_itself_and_survives_places_without_a_score():
    def odd(place):
        return -np.inf if place[0] == 0 else float(peak(place))

    one, again = (search(SIZES, odd, evaluations=40, seed=3) for _ in range(2))
    assert one == again
    assert one != search(SIZES, odd, evaluations=40, seed=4)
    assert np.isfinite(max(one.values()))


def test_places_are_within_the_grid():
    found = search(SIZES, peak, evaluations=60, seed=1)
    assert all(0 <= k < n for place in found for k, n in zip(place, SIZES, strict=True))
