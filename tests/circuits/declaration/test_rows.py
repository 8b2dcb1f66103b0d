"""The rows of the tables: what a population may hold, and tables in columns."""

from circuits.cells import Rate
from circuits.declaration.rows import GABA, Population, Projection, rows


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


def test_a_row_that_a_later_part_leaves_out_has_the_default():
    projections = rows(
        Projection,
        ("source target weight", ("STN", "GPe", 1), ("STN", "SNr", 2)),
        ("source target delay_ms", ("STN", "SNr", 3)),
    )
    assert projections == (Projection("STN", "GPe", 1), Projection("STN", "SNr", 2, delay_ms=3))
