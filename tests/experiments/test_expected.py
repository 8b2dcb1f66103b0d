"""What is expected: a direction or a value, sizes that a measure can have, and verdicts."""

from functools import partial

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from bgmodel.deciding.measures import MEASURES, OF_STOP, SHARES
from bgmodel.experiments.expected import (
    AGREES,
    COMPATIBLE,
    DIFFERS,
    DISAGREES,
    LIKELY,
    NO_INTERVAL,
    OPEN,
    Expected,
)
from bgmodel.experiments.experiment import shipped
from circuits.errors import DataWarning, quiet
from tests.helpers import refused, refusing, unwarned

CHANGE = partial(Expected, "mean_ms")


test_what_is_expected_is_a_direction_or_a_value = refusing(
    ({}, "value"),
    ({"low": 1.0}, "low"),
    ({"value": 1.5, "high": 2.0}, "low"),
    ({"low": 1.0, "high": 2.0, "value": 1.5, "se": 0.1}, "low"),
    ({"low": 2.0, "high": 1.0}, "low"),
    ({"low": 1.0, "high": 2.0, "value": 3.0}, "value"),
    *(({"value": value}, "value") for value in (np.nan, np.inf, -np.inf)),
    ({"value": np.inf, "low": -np.inf, "high": np.inf}, "value"),
    ({"value": 1.0, "se": 0.0}, "se"),
    ({"se": 1.0}, "value"),
    ({"direction": "up", "value": 1.0}, "direction"),
    ({"direction": "none"}, "at_least"),
    ({"direction": "up", "at_least": -1.0}, "at_least"),
    ({"value": 1.0, "at_least": 1.0}, "at_least"),
    ({"direction": "up", "unit": "percent"}, "unit"),
    ({"value": 5.0, "unit": "s"}, "unit"),
    ({"value": 5.0, "unit": "percent", "measure": "missed"}, "measure"),
    ({"value": 5.0, "measure": "mood"}, "measure"),
    of=lambda changes: Expected(**{"measure": "mean_ms"} | changes),
)


def test_a_value_needs_no_interval_and_an_interval_no_value():
    assert np.isnan(CHANGE(value=5.0).interval).all()
    assert CHANGE(low=4.0, high=8.0).middle == 6.0
    assert CHANGE(value=5.0, se=1.0).interval == pytest.approx((5 - 1.96, 5 + 1.96))
    assert np.isnan(CHANGE(direction="up").error(1.0))


@pytest.mark.parametrize(
    ("direction", "at_least", "interval", "outcome"),
    [
        ("up", 1, (1.1, 2), AGREES),
        ("up", 1, (0.9, 2), OPEN),
        ("up", 1, (-3, 0.9), DISAGREES),
        ("up", 1, (0.2, 0.9), DISAGREES),
        ("up", 0, (0, 0), DISAGREES),
        ("up", 1, (0, 0), DISAGREES),
        ("down", 1, (-2, -1.1), AGREES),
        ("down", 1, (-2, -0.9), OPEN),
        ("down", 1, (-0.9, 3), DISAGREES),
        ("down", 1, (0, 0), DISAGREES),
        ("none", 1, (-0.9, 0.9), AGREES),
        ("none", 1, (0, 0), AGREES),
        ("down", 0, (0, 0), DISAGREES),
        ("none", 1, (-0.9, 1.1), OPEN),
        ("none", 1, (1.1, 2), DISAGREES),
        ("none", 1, (-2, -1.1), DISAGREES),
        ("up", 1, (np.nan, np.nan), OPEN),
        ("up", 1, (np.nan, 0.5), OPEN),
        ("up", 1, (1.5, np.inf), OPEN),
    ],
)
def test_the_interval_decides(direction, at_least, interval, outcome):
    assert CHANGE(direction, at_least).outcome(0.0, *interval) == outcome


def test_a_difference_is_counted_in_the_standard_errors_that_point_to_each_other():
    """Errors of 3 and 4 make one of 5; an interval counts as one of 95 %."""
    for published in (
        CHANGE(value=10.0, se=3.0),
        CHANGE(low=10 - 3 * 1.96, high=10 + 3 * 1.96),
        CHANGE(value=10.0, low=9.0, high=10 + 3 * 1.96),
    ):
        assert published.z(20.0, 4.0, 90.0) == pytest.approx(2.0)
    assert CHANGE(value=10.0, low=10 - 3 * 1.96, high=11.0).z(0.0, 9, 4) == pytest.approx(-2.0)
    assert np.isnan(CHANGE(value=10.0).z(20.0, 4.0, 4.0))


WIDTH = st.floats(0, 30)


@given(st.floats(-50, 50), st.floats(-50, 50), WIDTH, WIDTH, WIDTH, WIDTH)
def test_both_ends_of_the_difference_are_those_of_two_independent_samples(
    model, published, low, high, below, above
):
    """Zou & Donner (2008), against their formula in half-widths of both intervals."""
    apart = model - published
    reach = np.hypot(low, above) if apart > 0 else np.hypot(high, below)
    assume(abs(abs(apart) - reach) > 1e-6)
    with quiet():
        effect = CHANGE(value=published, low=published - below, high=published + above)
    outcome = effect.outcome(model, model - low, model + high)
    assert outcome == (COMPATIBLE if abs(apart) < reach else DIFFERS)


def test_a_value_is_left_open_without_an_estimate_and_not_compared_without_an_interval():
    assert CHANGE(value=5.0, se=1.0).outcome(np.nan, np.nan, np.nan) == OPEN
    assert CHANGE(value=5.0, se=1.0).outcome(5.0, np.nan, 6.0) == OPEN
    assert CHANGE(value=5.0).outcome(5.0, 4.0, 6.0) == NO_INTERVAL


def test_every_measure_has_likely_sizes_and_those_that_ship_are():
    assert LIKELY.keys() == {*MEASURES, *OF_STOP}
    with unwarned():
        assert shipped()
        for size in (0.0, 1.0, 30.0, 5000.0):
            Expected("mean_all_ms", "up", size)


@pytest.mark.parametrize("measure", SHARES)
@pytest.mark.parametrize("size", [1, 1.5, 3, 100])
def test_a_share_that_changes_by_one_or_more_is_refused(measure, size):
    with refused("at_least must be a share, below 1"):
        Expected(measure, "up", size)
    Expected(measure, value=1.0)
    with refused("value must be a share, below 1"):
        Expected(measure, value=-max(size, 1.1))
    Expected("accuracy", value=-3.4, unit="percent")


@pytest.mark.parametrize(
    ("measure", "size"),
    [
        ("accuracy", 0.9),
        ("missed", 0.51),
        ("mean_ms", 0.03),
        ("mean_all_ms", 0.5),
        ("non_decision_ms", 0.2),
        ("decided", 0.05),
        ("drift", 1.2),
        ("boundary_separation", 2.0),
    ],
)
def test_a_size_that_seems_to_be_in_another_unit_is_warned_of(measure, size):
    for expected in ({"direction": "up", "at_least": size}, {"value": -size}):
        with pytest.warns(DataWarning):
            Expected(measure, **expected)


@pytest.mark.parametrize("measure", [*MEASURES, *OF_STOP])
def test_likely_sizes_are_not_warned_of(measure):
    low, high = LIKELY[measure]
    with unwarned():
        for size in (0.0, low, min(high, 1e4), np.clip(0.1, low, high)):
            Expected(measure, "up", size)
