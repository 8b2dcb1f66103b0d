"""Tables in columns: every value under its field's name."""

import pytest

from circuits.anatomy.columns import rows
from circuits.cells import Rate
from circuits.rows import GABA, Population, Projection


def test_values_go_to_the_fields_named_above_them():
    found = rows(
        Population,
        ("name  cell  tau_ms", ("STN", Rate(), 5), ("GPe", Rate(signed=True), 10)),
        ("name  transmitter", ("STN", "glutamate"), ("GPe", GABA)),
    )
    assert found == (
        Population("STN", Rate(), tau_ms=5),
        Population("GPe", Rate(signed=True), tau_ms=10, transmitter=GABA),
    )


def test_parts_of_a_table_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="STN: 3 columns, got 2 values"):
        rows(Projection, ("source target weight", ("STN", "GPe")))
    two = ("name cell", ("STN", Rate()), ("GPe", Rate()))
    with pytest.raises(ValueError, match="the table has 2 rows, its part 'name tau_ms' 1"):
        rows(Population, two, ("name tau_ms", ("STN", 5)))
    with pytest.raises(ValueError, match="name is 'GPe' in one part, 'SNr' below"):
        rows(Population, two, ("name tau_ms", ("STN", 5), ("SNr", 5)))
