"""What holds for every table."""

import math

import pytest

from circuits import anatomy
from circuits.declaration import table_files
from circuits.declaration.table_files import digest
from circuits.errors import EditWarning
from tests.helpers import refused


@pytest.mark.parametrize("table", anatomy.CIRCUITS.values())
@pytest.mark.parametrize("channels", [0, 1, -1, "2", 2.5, math.nan, None, True])
def test_a_table_has_two_or_more_channels(table, channels):
    with refused("channels"):
        table(channels)


def test_every_number_has_a_source(circuit):
    for row in (*circuit.populations, *circuit.projections):
        assert row.cite, row.name


HASHES = {
    "bogacz_gurney": ("00a40837", "98c8eadf"),
    "appendix_b": ("12ce6098", "a1483e98"),
    "linear_gpe": ("6d48e6f7", "9db5d4e9"),
    "macaque": ("dbb7b144", "e38d6ecc"),
    "spiking_msprt": ("0011528f", "6119a62c"),
    "gpr": ("d5cc4e41", "36a5d88f"),
    "humphries": ("e8ccb839", "f2b1d9bf"),
    "stewart": ("db9d8650", "a587a88b"),
}
"""Hashes of all numbers of a table, for 2 and for 4 alternatives."""


@pytest.mark.parametrize("name", anatomy.CIRCUITS)
def test_no_number_changes_by_accident(name):
    """Results hang on these numbers.

    One that is meant to change changes its hash here, and what was measured with it is measured
    again.
    """
    found = (digest(anatomy.load_circuit(name, channels))[:8] for channels in (2, 4))
    assert tuple(found) == HASHES[name]


@pytest.mark.parametrize("make", [anatomy.gpr, anatomy.humphries, anatomy.stewart])
def test_dopamine_outside_its_range_is_refused(make):
    for level in (-0.1, 1.1):
        with refused(rf"dopamine must be within 0..1, got {level}"):
            make(dopamine=level)


def test_a_copy_keeps_its_name_and_an_edited_copy_has_that_of_its_file(tmp_path):
    table = anatomy.macaque(2)
    path = table_files.write(table, tmp_path / "mine.toml")
    assert anatomy.load_circuit(path) == table
    assert anatomy.is_included(anatomy.load_circuit(path))
    table_files.write(table.edited("set STN.bias_nats -1.9"), path)
    mine = anatomy.load_circuit(path)
    assert mine.name == "mine"
    assert not anatomy.is_included(mine)


def test_rows_for_another_number_of_channels_are_warned_of(tmp_path):
    path = table_files.write(anatomy.macaque(2), tmp_path / "mine.toml")
    path.write_text(path.read_text().replace("channels = 2", "channels = 4"))
    with pytest.warns(EditWarning, match="--channels 4"):
        assert anatomy.load_circuit(path).channels == 4


def test_rows_that_do_not_depend_on_the_number_of_channels_are_those_of_any(tmp_path):
    path = table_files.write(anatomy.gpr(2), tmp_path / "mine.toml")
    path.write_text(path.read_text().replace("channels = 2", "channels = 4"))
    assert anatomy.is_included(anatomy.load_circuit(path)) == (
        anatomy.gpr(2).populations == anatomy.gpr(4).populations
    )
