"""Spaces of tasks are checked when they are read, and searched within a budget."""

import numpy as np
import pytest

from bgmodel.discriminating.space import Probe, Space, check_space, search
from circuits.errors import DataWarning
from tests.helpers import refused, unwarned


def test_the_shipped_space_is_read_and_tests_lack_its_nuclei():
    space = Space.shipped()
    assert check_space(None) == space
    with refused("space"):
        check_space(3)
    assert len(space.edits) > 1
    assert space.stop_nats != (0.0,)
    assert space.of_tests().edits == ("",)
    assert space.of_tests().stop_nats == (0.0,)
    assert space.of_tests().channels == space.channels


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("channel = [2]", "channel"),
        ("channels = []", "channels"),
        ("channels = [1]", "channels"),
        ("conflict = [0.5, 0.5]", "conflict"),
        ("conflict = [1.0]", "conflict"),
        ("d_prime = [0.0]", "d_prime"),
        ("accuracy = [1.0]", "accuracy"),
        ("share = 1.0", "share"),
        ("deadline_ms = [1000.0]\nstop_delay_ms = 2000.0", "stop_delay_ms"),
        ("stop_nats = [3.0]", "stop_nats"),
        ('edits = ["", "lesoin STN 10%"]', "edits"),
    ],
)
def test_a_wrong_space_is_refused_in_one_sentence(text, field, tmp_path):
    path = tmp_path / "space.toml"
    path.write_text(text)
    with refused(field):
        check_space(path)


@pytest.mark.parametrize("name", ["non_decision_sd_ms", "stop_delay_ms"])
def test_times_in_seconds_are_doubted(name):
    with pytest.warns(DataWarning, match=f"{name} is 0.03: is it in seconds"):
        Space(**{name: 0.03})
    with unwarned():
        Space(**{name: 0})


def test_a_probe_is_interleaved_with_plain_trials():
    probe = Probe(4, 0.5, 0.9, 0.5, "dopamine 0.9; lesion GPe 5%")
    assert probe.plain == Probe(4, 0.5)
    assert probe.plain.plain == probe.plain
    assert probe.lines == ("dopamine 0.9", "lesion GPe 5%")
    assert "conflict 0.9" in probe.text()


SIZES = (4, 5, 3, 6, 2)
BEST = (2, 3, 1, 4, 1)


def peak(place):
    return -sum((a - b) ** 2 for a, b in zip(place, BEST, strict=True))


def test_a_small_grid_is_searched_completely():
    values = search((2, 3), lambda place: float(sum(place)), evaluations=6, seed=1)
    assert len(values) == 6
    assert max(values, key=values.get) == (1, 2)


def test_a_large_grid_is_searched_within_the_budget_and_better_than_at_random():
    ranks = []
    every = sorted((peak(place) for place in np.ndindex(*SIZES)), reverse=True)
    for seed in range(8):
        values = search(SIZES, peak, evaluations=80, seed=seed)
        assert len(values) <= 80
        assert all(0 <= k < n for place in values for k, n in zip(place, SIZES, strict=True))
        ranks.append(every.index(max(values.values())))
    # The best of 80 random places has rank 720 / 81 on average.
    assert np.mean(ranks) < 0.5 * np.prod(SIZES) / 81


def test_a_search_repeats_itself_and_survives_places_without_a_score():
    def odd(place):
        return -np.inf if place[0] == 0 else float(peak(place))

    one, again = (search(SIZES, odd, evaluations=40, seed=3) for _ in range(2))
    assert one == again
    assert one != search(SIZES, odd, evaluations=40, seed=4)
    assert np.isfinite(max(one.values()))
