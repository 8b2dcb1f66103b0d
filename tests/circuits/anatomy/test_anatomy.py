"""What holds for every table."""

import math
import re
from dataclasses import fields

import pytest

from circuits import anatomy, show
from circuits.declaration import table_writer
from circuits.declaration.rows import Population
from circuits.declaration.table_writer import digest
from circuits.errors import EditWarning
from tests.helpers import refused


@pytest.mark.parametrize("table", anatomy.CIRCUITS.values())
@pytest.mark.parametrize("channels", [0, 1, -1, "2", 2.5, math.nan, None, True])
def test_a_table_has_two_or_more_channels(table, channels):
    with refused("channels"):
        table(channels)


OF_RATES = r"\brates?\b|\brest\b"
WORDS = {
    "weight": "weight|share",
    "delay_ms": "delay",
    "tau_ms": r"\btau\b|\btime",
    "neurons": r"(?<!no )\bcells",
    "cell": "CV",
    "heterogeneity": "heterogeneity",
    "operating_point_nats": "pivot",
    **dict.fromkeys(("baseline_hz", "gain_hz_per_nat", "bias_nats"), OF_RATES),
}
"""Words by which a citation names the numbers of a row."""
SOURCE = re.compile(r"\b\d{4}\b|assumed|tuned|fit|derived")
"""A publication's year, or a word that says where else a number is from."""


def without_source(row, named):
    """Return the fields with a number that no part of the row's citation names with its source.

    A part that names no field gives the source of the whole row, unless each must be ``named``.
    """
    text = f"{row.cite}; {row.cite_more}"
    parts = [part for part in text.split(";") if SOURCE.search(part)]
    whole_row = [part for part in parts if not re.search("|".join(WORDS.values()), part)]
    if text == "assumed; " or (whole_row and not named):
        return []
    known = [field for field in fields(row) if field.name in WORDS]
    numbers = [each.name for each in known if getattr(row, each.name) != each.default]
    if isinstance(row, Population) and not fields(row.cell)[0].type.startswith("float"):
        numbers.remove("cell")
    return [k for k in numbers if not any(re.search(WORDS[k], part) for part in parts)]


def test_every_number_has_a_source(circuit):
    rows = (*circuit.populations, *circuit.projections)
    assert {row.name: row.cite for row in rows if not row.cite} == {}
    gaps = {row.name: without_source(row, circuit.name == anatomy.DEFAULT) for row in rows}
    assert {name: missing for name, missing in gaps.items() if missing} == {}


def test_the_source_of_a_weight_is_shown_and_belongs_to_no_hash_and_to_no_row_like_it():
    table = anatomy.macaque(2)
    row = table["D1->SNr"]
    assert row.cite_more in show.text(table)
    assert digest(table.with_projection("D1->SNr", cite_more="")) == digest(table)
    assert table.edited("add D1->GPe like=D1->SNr")["D1->GPe"].cite_more == ""


HASHES = {
    "bogacz_gurney": ("00a40837", "98c8eadf"),
    "appendix_b": ("12ce6098", "a1483e98"),
    "linear_gpe": ("6d48e6f7", "9db5d4e9"),
    "macaque": ("533d4f00", "1c887193"),
    "macaque_small": ("df431408", "96f43e7c"),
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
    digests = (digest(anatomy.load_circuit(name, channels))[:8] for channels in (2, 4))
    assert tuple(digests) == HASHES[name]


def test_a_copy_keeps_its_name_and_an_edited_copy_has_that_of_its_file(tmp_path):
    table = anatomy.macaque(2)
    path = table_writer.write(table, tmp_path / "mine.toml")
    assert anatomy.load_circuit(path) == table
    assert anatomy.is_included(anatomy.load_circuit(path))
    table_writer.write(table.edited("set STN.bias_nats -1.9"), path)
    mine = anatomy.load_circuit(path)
    assert mine.name == "mine"
    assert not anatomy.is_included(mine)


def test_rows_for_another_number_of_channels_are_warned_of(tmp_path):
    path = table_writer.write(anatomy.macaque(2), tmp_path / "mine.toml")
    path.write_text(path.read_text().replace("channels = 2", "channels = 4"))
    with pytest.warns(EditWarning, match="--channels 4"):
        assert anatomy.load_circuit(path).channels == 4
