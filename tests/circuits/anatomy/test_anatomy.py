"""What holds for every table."""

import math

import pytest

from circuits import anatomy
from tests.helpers import refused


@pytest.mark.parametrize("table", anatomy.CIRCUITS.values())
@pytest.mark.parametrize("channels", [0, 1, -1, "2", 2.5, math.nan, None, True])
def test_a_table_has_two_or_more_channels(table, channels):
    with refused("channels"):
        table(channels)


def test_every_number_has_a_source(circuit):
    for row in (*circuit.populations, *circuit.projections):
        assert row.cite, row.name
