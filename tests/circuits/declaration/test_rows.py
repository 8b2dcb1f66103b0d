"""The rows of the tables: what a population may hold, and tables in columns."""

import pytest

from circuits import anatomy
from circuits.cells import Rate
from circuits.declaration.rows import GABA, Population, Projection, rows
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


def test_values_go_to_the_fields_named_above_them():
    populations = rows(
        Population,
        ("name  cell  tau_ms", ("STN", Rate(), 5), ("GPe", Rate(signed=True), 10)),
        ("name  transmitter", ("STN", "glutamate"), ("GPe", GABA)),
    )
    assert populations == (
        Population("STN", Rate(), tau_ms=5),
        Population("GPe", Rate(signed=True), tau_ms=10, transmitter=GABA),
    )


def test_parts_of_a_table_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="STN: 3 columns, got 2 values"):
        rows(Projection, ("source target weight", ("STN", "GPe")))
    two = ("name cell", ("STN", Rate()), ("GPe", Rate()))
    with pytest.raises(ValueError, match="'name tau_ms' has a row SNr, the first part does not"):
        rows(Population, two, ("name tau_ms", ("STN", 5), ("SNr", 5)))
    with pytest.raises(
        ValueError, match="a part must begin with source target, got 'source weight'"
    ):
        rows(Projection, ("source weight", ("STN", 1)))


def test_a_row_that_a_later_part_leaves_out_has_the_default():
    projections = rows(
        Projection,
        ("source target weight", ("STN", "GPe", 1), ("STN", "SNr", 2)),
        ("source target delay_ms", ("STN", "SNr", 3)),
    )
    assert projections == (Projection("STN", "GPe", 1), Projection("STN", "SNr", 2, delay_ms=3))
