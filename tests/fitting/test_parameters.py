"""Which parameters a fit moves, and in which cells."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bgmodel.fitting.algorithms import WEIBULL, GapModel
from bgmodel.fitting.parameters import Parameter, freedom
from bgmodel.fitting.simulated.circuit_model import MECHANISMS, CircuitModel
from circuits.anatomy import load_circuit
from tests.helpers import ROOT, refusing

A, B = Parameter("a", 0.0, 10.0, 4.0), Parameter("b", -1.0, 1.0, 0.5)
C = Parameter("c", 0.0, 1.0, 0.25, free=False)
ALL = (A, B, C)
CONDITIONS = {"speed": ["fast", "slow", "fast"], "site": ["x", "y", "z"]}


def freed(**options):
    return freedom(ALL, CONDITIONS, 3, **options)


def test_what_is_free_is_what_says_so_unless_named():
    assert freed().names == ["a", "b"]
    assert freed(free=["c", "a"]).names == ["a", "c"]
    assert freed(fixed={"a": 3.0}).names == ["b"]
    assert freed(fixed={"a": 3.0}).values(np.zeros(1))["a"] == pytest.approx([3, 3, 3])


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4))
def test_a_number_of_a_level_holds_in_the_cells_of_that_level_alone(numbers):
    moved = freed(vary={"a": "speed", "c": "speed/slow"})
    assert moved.names == ["a[speed=fast]", "a[speed=slow]", "b", "c[speed=fast]"]
    values = moved.values(np.array(numbers))
    fast, slow, b, c = numbers
    assert values["a"].tolist() == [fast, slow, fast]
    assert values["b"].tolist() == [b, b, b]
    assert values["c"].tolist() == [c, C.start, c]


def test_bounds_and_start_go_with_their_numbers():
    moved = freed(free=["b"], vary={"a": "site"})
    assert moved.low.tolist() == [0, 0, 0, -1]
    assert moved.high.tolist() == [10, 10, 10, 1]
    assert moved.start.tolist() == [4, 4, 4, 0.5]


def test_a_start_has_the_values_that_are_given_in_all_cells():
    slope = {"Intercept": np.ones(3), "x": np.array([-1.0, 0.0, 2.0])}
    moved = freed(vary={"a": "site"}, designs={"b": slope})
    values = moved.values(moved.started({"a": 20.0, "b": 0.3}))
    assert values["a"].tolist() == [10, 10, 10]
    assert values["b"] == pytest.approx([0.3, 0.3, 0.3])
    assert freed().started({"a": 2.0}).tolist() == [2, 0.5]


test_what_makes_no_sense_is_refused = refusing(
    ({"free": ["d"]}, "d no parameter is called 'd'; there are a, b, c"),
    ({"fixed": {"d": 1}}, "d no parameter is called 'd'"),
    ({"vary": {"d": "site"}}, "d no parameter is called 'd'"),
    ({"fixed": {"a": 11}}, "a must lie between 0 and 10, got 11"),
    ({"fixed": {"a": float("nan")}}, "a must lie between 0 and 10, got nan"),
    ({"vary": {"a": "day"}}, "vary a can't vary with 'day': conditions are speed, site"),
    ({"vary": {"a": "speed/late"}}, "vary speed has no level 'late': fast, slow"),
    ({"fixed": {"a": 1}, "vary": {"a": "speed"}}, "fix a can't be both free and fixed"),
    ({"fixed": {"a": 1}, "free": ["a"]}, "fix a can't be both free and fixed"),
    ({"free": []}, "free no parameter is free: name some of a, b, c"),
    of=lambda options: freed(**options),
)


@pytest.mark.parametrize("limits", [(2, 1, 1), (0, 1, 2), (0, 1, -1), (0, np.inf, 1)])
def test_a_parameter_starts_within_its_bounds(limits):
    with pytest.raises(ValueError, match="low <= start <= high must hold"):
        Parameter("a", *limits)


def test_held_is_what_stands_in_all_cells_or_in_those_of_one_level():
    assert freed().held == {"c": 0.25}
    assert freed(fixed={"a": 3.0}).held == {"a": 3.0, "c": 0.25}
    assert freed(vary={"b": "speed"}).held == {"c": 0.25}
    assert freed(vary={"b": "speed/slow"}).held == {"b": 0.5, "c": 0.25}


MACAQUE = load_circuit("macaque", 2)
CIRCUITS = [CircuitModel(MACAQUE, mechanism=each) for each in MECHANISMS.values()]
MODELS: list = [GapModel(WEIBULL), *CIRCUITS]
EVERY = {each.name: each for model in MODELS for each in model.parameters}


@pytest.mark.parametrize("name", EVERY)
def test_the_page_of_fits_states_the_range_and_the_start_of_each_parameter(name):
    """A reader who sees a value at a bound in a table must find the bound."""
    page = (ROOT / "docs/guides/fit.md").read_text()
    stated = re.search(rf"[^\n]*`{name}`[^\n]*? (-?[\d.]+) to ([\d.]+), start ([\d.]+)", page)
    each = EVERY[name]
    assert [float(x) for x in stated.groups()] == pytest.approx(
        [each.low, each.high, each.start], rel=0.01
    )


def test_a_number_is_at_a_bound_near_either_end_by_factors_if_it_differs_by_these():
    space = freedom([Parameter("a", 0.0, 1.0, 0.5), Parameter("b", 1e-3, 100.0, 1.0, scale="log")],
                    {}, 1)  # fmt: skip
    for vector, ends in (([0.9991, 1e-3], [1, 1]), ([9e-4, 100.0], [1, 1]), ([0.0011, 1], [0, 0])):
        assert space.at_bound(np.array(vector)).tolist() == ends
