"""Moves are reversible, and leave the posterior under the surrogate invariant."""

import numpy as np
import pytest
from scipy.stats import ks_2samp

from bgmodel.fitting.hierarchy import guide as moves
from bgmodel.fitting.hierarchy.group import Group
from bgmodel.fitting.hierarchy.guide import guide_of
from bgmodel.fitting.hierarchy.surrogate import surrogate_of, values
from bgmodel.support.processes import local_map
from bgmodel.support.seeds import stream
from tests.fitting.hierarchy.known import Known, wide

SEED, PEOPLE = 24_317, 5
# Far above the lower bound, where the scale is linear, so that the surrogate can represent a
# Gaussian exactly.
MIDDLES = np.linspace(4, 7, PEOPLE)
VAGUE = np.array([0.6, 0.4])


def person(middle):
    return Known(lambda x: float(-(((x - middle) / 0.7) ** 2).sum() / 2), wide())


@pytest.fixture(scope="module")
def guide():
    people, rng = [person(each) for each in MIDDLES], stream(SEED)
    draws = MIDDLES[:, None] + 0.7 * rng.normal(size=(300, PEOPLE, 2))
    logs = np.array([[p(x) for p, x in zip(people, each, strict=True)] for each in draws])
    surrogate = surrogate_of(local_map(people), draws, logs, rng)
    groups = rng.normal(0.5, 0.4, size=(2, 100, 2))
    return guide_of(surrogate, 5 + groups[0], np.abs(groups[1]))


def pairs(guide, correlation, count=6000):
    """Return consecutive states of a chain of guided moves: mean, sd and first person."""
    group = Group(np.full(2, 5.0), np.ones(2), correlation=correlation)
    scaled = np.tile(MIDDLES[:, None], 2).astype(float)
    rng, kept = stream(SEED, "chain"), []
    for _ in range(count):
        group, scaled, _ = guide.moved(group, scaled, VAGUE, rng)
        related = [] if correlation is None else [group.correlation[0, 1]]
        kept.append([*group.mean, *np.log(group.variance), *scaled[0], *related])
    return np.array(kept[100:])


@pytest.mark.parametrize("correlation", [None, np.eye(2)], ids=["independent", "correlated"])
def test_moves_are_reversible(guide, correlation, monkeypatch):
    # Few moves, so that a state depends on the one before; steps up and down are then equally
    # common of any size, which a chain that cycles in one direction would violate.
    monkeypatch.setattr(moves, "MOVES_OF_ALL", 6)
    kept = pairs(guide, correlation)
    for column in kept.T:
        assert np.corrcoef(column[1:], column[:-1])[0, 1] > 0.1
    # A function of both states and its mirror image have one mean.
    now, then = kept[:-1], kept[1:]
    for k in range(kept.shape[1]):
        for j in range(kept.shape[1]):
            apart = now[:, k] ** 2 * then[:, j] - then[:, k] ** 2 * now[:, j]
            blocks = apart[: len(apart) // 50 * 50].reshape(50, -1).mean(axis=1)
            assert abs(blocks.mean()) < 4.5 * blocks.std() / np.sqrt(50), (k, j)


def test_the_rise_is_that_of_the_surrogate(guide):
    rng, scaled = stream(SEED, "rise"), np.tile(MIDDLES[:, None], 2).astype(float)
    group = Group(np.full(2, 5.0), np.ones(2))
    before = scaled.copy()
    arrays = guide.surrogate.arrays
    for alone in (True, False):
        _, now, rise = guide.moved(group, scaled, VAGUE, rng, people_alone=alone)
        assert rise == pytest.approx(values(now, arrays) - values(before, arrays))
    assert scaled.tobytes() == before.tobytes()
    assert group.mean.tolist() == [5.0, 5.0]


def test_people_given_the_group_do_not_depend_on_where_they_begin(guide, monkeypatch):
    monkeypatch.setattr(moves, "MOVES_OF_PEOPLE", 200)
    group, moved = Group(np.array([5.5, 5.0]), np.array([1.0, 0.3])), []
    for first in (2.0, 8.0):
        given = group, np.full((PEOPLE, 2), first), VAGUE, stream(SEED, "people", first)
        every = [guide.moved(*given, people_alone=True)[1] for _ in range(400)]
        moved.append([people.ravel() for people in every])
    for one, other in zip(*(np.array(each).T for each in moved), strict=True):
        assert ks_2samp(one, other).pvalue > 1e-4
    # And have the product of both Gaussians.
    precision = 1 / 0.7**2 + 1 / group.variance
    exact = (MIDDLES[:, None] / 0.7**2 + group.mean / group.variance) / precision
    mean = np.array(moved).reshape(800, PEOPLE, 2).mean(axis=0)
    assert np.abs((mean - exact) * np.sqrt(800 * precision)).max() < 4


def test_means_stay_within_their_range(guide):
    group = Group(np.array([5.2, 4.9]), np.ones(2), highest=np.array([5.3, np.inf]))
    rng, scaled, seen = stream(SEED, "range"), np.tile(MIDDLES[:, None], 2).astype(float), []
    for _ in range(100):
        group, scaled, _ = guide.moved(group, scaled, VAGUE, rng)
        seen.append(group.mean)
    assert max(mean[0] for mean in seen) <= 5.3 < max(mean[1] for mean in seen)
