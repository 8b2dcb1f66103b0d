"""What holds for every table."""

import math

import pytest

from circuits import anatomy
from circuits.table_files import digest

NUMBERS = {
    "bogacz_gurney": "00a40837 98c8eadf",
    "appendix_b": "12ce6098 a1483e98",
    "linear_gpe": "6d48e6f7 9db5d4e9",
    "macaque": "9c4bc534 ce663daa",
    "spiking_msprt": "cf02fcd4 f6297ded",
    "gpr": "d5cc4e41 36a5d88f",
    "humphries": "3bef6ddd 7c3b1a9a",
    "stewart": "db9d8650 a587a88b",
}
"""Hashes of all tables, for 2 and 4 alternatives. Results hang on them: a number that is meant to
change changes its hash here, and what was measured with it is measured again."""


@pytest.mark.parametrize("table", anatomy.CIRCUITS.values())
@pytest.mark.parametrize("channels", [0, 1, -1, "2", 2.5, math.nan, None, True])
def test_a_table_has_two_or_more_channels(table, channels):
    with pytest.raises(ValueError, match="channels must be a whole number >= 2, got"):
        table(channels)


def test_every_number_has_a_source(circuit):
    for row in (*circuit.populations, *circuit.projections):
        assert row.cite, row.name


@pytest.mark.parametrize("name", anatomy.CIRCUITS)
def test_no_number_of_a_table_changes_by_accident(name):
    assert NUMBERS[name] == " ".join(digest(anatomy.circuit(name, n))[:8] for n in (2, 4))
