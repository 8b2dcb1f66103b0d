"""Inputs with their own time in each trial: what is attached, refused and warned of."""

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import bgmodel as bg
from bgmodel import plausibility
from bgmodel.stopping.inputs import with_input
from circuits.errors import ConfoundWarning, EditWarning
from tests.helpers import refused, told, unwarned

NEVER = math.nan


def evidence(trials, channels=2):
    return bg.gaussian_evidence(trials, channels=channels, t_max=4, step_ms=10, seed=5)


def on_some(some, onset_ms=20.0):
    return np.where(some, onset_ms, NEVER)


@given(st.integers(2, 5), st.integers(2, 6), st.integers(0, 5))
def test_every_mth_trial_is_confounded_if_its_truths_are_not_all_of_them(channels, m, first):
    """Truth follows k mod N: every m-th trial has all truths if m and N have no common divisor."""
    go = evidence(60 * channels, channels)
    light = on_some(np.arange(go.trials) % m == first % m)
    if math.gcd(channels, m) == 1:
        with unwarned():
            with_input(go, light)
        return
    with pytest.warns(ConfoundWarning) as caught:
        with_input(go, light)
    there = set(go.truth[~np.isnan(light)].tolist())
    missed = set(range(channels)) - there
    (one,) = caught
    assert one.filename == __file__
    assert one.message.input == 0
    assert missed <= set(one.message.truths)


@pytest.mark.parametrize("chance", [0.02, 0.2, 0.5])
def test_of_all_ways_to_choose_trials_no_more_than_that_share_warns(monkeypatch, chance):
    """All 252 ways to choose 5 of 10 trials, and those of 3, counted one by one."""
    monkeypatch.setattr(plausibility, "CHANCE", chance)
    truth = np.arange(10) % 2
    for number in (3, 5):
        ways = [np.isin(np.arange(10), some) for some in combinations(range(10), number)]
        warned = [
            told(plausibility.warn_of_confounds, way[:, None, None] * 1.0, truth) for way in ways
        ]
        assert sum(map(bool, warned)) <= chance * len(ways)


@pytest.mark.parametrize(("trials", "warns"), [(8, False), (16, False), (24, True), (100, True)])
def test_few_trials_may_be_aligned_by_chance(trials, warns):
    go = evidence(trials)
    texts = told(with_input, go, on_some(go.truth == 1))
    assert bool(texts) == warns


@pytest.mark.parametrize("name", ["onset_ms", "amount_nats", "duration_ms"])
def test_a_time_or_a_size_that_follows_the_truth_is_warned_of(name):
    go = evidence(60)
    same = {"onset_ms": 10.0, "amount_nats": 1.0, "duration_ms": 10.0}
    with unwarned():
        with_input(go, **same)
        with_input(go, **same | {name: np.where(np.arange(60) // 2 % 2, 10.0, 20.0)})
    with pytest.warns(ConfoundWarning) as caught:
        with_input(go, **same | {name: np.where(go.truth, 10.0, 20.0)})
    assert set(caught[0].message.truths) == {0, 1}


def test_the_input_that_is_confounded_is_named():
    go = evidence(60)
    fair = with_input(go, on_some(np.arange(60) < 30))
    with pytest.warns(ConfoundWarning) as caught:
        with_input(fair, on_some(go.truth == 0))
    assert [one.message.input for one in caught] == [1]
    values = np.zeros((60, 5, 1))
    values[go.truth == 1, 2:] = -1.0
    with pytest.warns(ConfoundWarning):
        replace(go, inputs_nats=values)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"onset_ms": -1.0}, "onset_ms must be >= 0 and finite, got -1"),
        ({"onset_ms": [10.0, math.inf, NEVER, 5.0]}, "onset_ms must be >= 0 and finite, got inf"),
        ({"onset_ms": -math.inf}, "onset_ms must be >= 0 and finite, got -inf"),
        ({"amount_nats": [1.0, math.nan, 1.0, 1.0]}, "amount_nats must be finite, got nan"),
        ({"amount_nats": math.inf}, "amount_nats must be finite, got inf"),
        ({"duration_ms": -5.0}, "duration_ms must be > 0, got -5"),
        ({"duration_ms": 0.0}, "duration_ms must be > 0, got 0"),
        ({"duration_ms": [1.0, 2.0, math.nan, 4.0]}, "duration_ms must be > 0, got nan"),
        ({"onset_ms": [1.0, 2.0]}, "onset_ms must be one number, or"),
        ({"onset_ms": np.arange(4) % 3 == 0}, "onset_ms"),
        ({"amount_nats": np.arange(4) % 3 == 0}, "amount_nats"),
    ],
)
def test_a_window_without_sense_is_refused(wrong, says):
    with refused(says):
        with_input(evidence(4), **{"onset_ms": 10.0} | wrong)


@pytest.mark.parametrize("place", ["D2[0]", "STN"])
def test_an_input_alike_in_all_trials_is_a_course_of_the_circuit(place):
    go, circuit = evidence(20), bg.load_circuit("macaque")
    each = bg.BasalGanglia(circuit.with_inputs(place), seed=3).run(with_input(go, 10.0, -2.0, 20.0))
    course = circuit.edited(f"add {place} amount=-2 from_ms=10 to_ms=30")
    every = bg.BasalGanglia(course, seed=3).run(go)
    np.testing.assert_allclose(each.out_nats, every.out_nats, atol=2e-6)
    assert np.abs(every.out_nats - bg.BasalGanglia(circuit, seed=3).run(go).out_nats).max() > 0.01


def test_an_input_after_the_trials_changes_nothing_and_is_warned_of():
    go, circuit = evidence(20), bg.load_circuit("macaque").with_inputs("D2[0]")
    with pytest.warns(EditWarning):
        late = with_input(go, 50.0, -2.0)
    model = bg.BasalGanglia(circuit, seed=3)
    np.testing.assert_array_equal(model.run(late).out_nats, model.run(go).out_nats)
    with unwarned():
        with_input(go, NEVER, -2.0)
        with_input(go, 50.0, 0.0)
