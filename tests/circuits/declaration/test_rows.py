"""The rows of the tables: what a population may hold."""

import pytest

from circuits import anatomy
from circuits.cells import Rate
from circuits.declaration.rows import Population
from tests.helpers import refused


@pytest.mark.parametrize("wrong", [(1.0,), (2.0, 1.0), (-1.0, 1.0), (0.0, float("nan")), "1"])
def test_published_rates_are_a_range_or_nothing(wrong):
    with refused("published_hz"):
        Population("STN", Rate(), published_hz=wrong)


def test_published_rates_change_neither_the_fixed_point_nor_what_is_claimed_of_it():
    table = anatomy.bogacz_gurney()
    edited = table.with_population("STN", published_hz=(15.2, 22.8))
    assert edited.population("STN").published_hz == (15.2, 22.8)
    assert edited.exact
    assert edited != table
