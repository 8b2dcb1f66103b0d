"""A circuit as a file: written and read back it is the same, and what is wrong names its line."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from circuits import anatomy, table_reader
from circuits.cells import Phase, Rate
from circuits.declaration import table_writer
from circuits.declaration.rows import Population, Projection
from tests.helpers import refused
from tests.strategies.edits import edited_circuits

NUMBERS = st.floats(-1e6, 1e6)
WORDS = st.text(st.characters(exclude_categories=["Cs"]), max_size=30)
NAMES = st.from_regex(r"[^\s\[\]=/>]{1,8}", fullmatch=True).filter(
    lambda name: not any("\ud800" <= letter <= "\udfff" for letter in name)
)
EDITS = [
    st.builds(lambda x: lambda c: c.scale("D1->SNr", x, 1), st.floats(0.01, 9)),
    st.builds(lambda x: lambda c: c.cut("GPe->STN", x), st.floats(0, 0.99)),
    st.builds(lambda x: lambda c: c.cut("D1->SNr", x, 1), st.floats(0, 0.99)),
    st.builds(lambda x: lambda c: c.with_population("STN", bias_nats=x), NUMBERS),
    st.builds(lambda x: lambda c: c.with_population("D1", cite=x), WORDS),
    st.builds(lambda x: lambda c: replace(c, about=x, name=x), WORDS),
    st.builds(lambda x: lambda c: replace(c, wiring_seed=x), st.integers()),
    st.builds(lambda x: lambda c: replace(c, max_deficit_nats=x), st.floats(1e-9, math.inf)),
    st.builds(lambda x: lambda c: replace(c, default_gain=x), st.floats(1e-9, 1e9)),
    st.builds(
        lambda name, w: (
            lambda c: c.with_rows(Population(name, Rate(signed=True)), Projection(name, "STN", w))
        ),
        NAMES,
        st.floats(0, 1e3),
    ),
]


@pytest.mark.parametrize("channels", [2, 3, 12])
@pytest.mark.parametrize("name", sorted(anatomy.CIRCUITS))
def test_every_table_comes_back_from_its_file(name, channels, tmp_path):
    circuit = anatomy.load_circuit(name, channels)
    path = table_writer.write(circuit, tmp_path / "mine.toml")
    assert table_reader.read(path) == table_reader.read(path, channels) == circuit
    assert anatomy.load_circuit(path) == anatomy.load_circuit(str(path), channels) == circuit
    assert [file.name for file in tmp_path.iterdir()] == ["mine.toml"]


@settings(max_examples=60)
@given(edited_circuits(), st.lists(st.one_of(EDITS), max_size=4, unique=True))
def test_every_edited_table_comes_back_from_its_file(circuit, edits):
    for edit in edits:
        try:
            circuit = edit(circuit)
        except ValueError:  # two of a name, or a lesion of another kind
            continue
    restored = table_reader.parse(circuit.to_toml(), "mine.toml")
    assert restored == circuit
    assert table_writer.digest(restored) == table_writer.digest(circuit)


def test_equal_circuits_have_one_hash_and_others_another():
    circuit = anatomy.spiking_msprt()
    written = circuit.with_population("STN", tau_ms=np.float64(5), neurons=300.0, pooled=np.False_)
    assert written == circuit
    assert table_writer.digest(written) == table_writer.digest(circuit)
    for other in (
        circuit.with_population("STN", tau_ms=5.1),
        circuit.with_cell("STN", cv=0.31),
        circuit.with_projection("STN->GPe", cite="mine"),
        replace(circuit, unit="salience"),
        anatomy.spiking_msprt(3),
    ):
        assert table_writer.digest(other) != table_writer.digest(circuit)


EDITED = [
    "lesion STN 10%", "scale STN->SNr[0] 0.5", "set STN.bias_nats=7", "set STN->GPe.delay_ms=40",
    "add D2->SNr weight=-0.1", "add STN amount=0.5", "dopamine 0.8", "neurons 3",
    "connections 0.05", "heterogeneity 0.5",
]  # fmt: skip


@pytest.mark.parametrize("edit", EDITED)
def test_an_edited_table_does_not_repeat_the_claim_of_the_original(edit):
    circuit = anatomy.macaque()
    edited = circuit.edited(edit)
    assert edited.about == "edited from: " + circuit.about
    assert edited.lesion("D1", 0.5).about == edited.about
    unmarked = replace(edited, about=circuit.about)
    assert edited == unmarked
    assert table_writer.digest(edited) == table_writer.digest(unmarked)


def test_a_file_of_ones_own_needs_no_more_than_what_differs():
    text = """
        format = 1
        channels = 2
        reference_nats = 3
        [cells]
        source = { type = "Phase", cv = 0.5 }
        [populations]
        columns = ["name", "cell", "transmitter", "cite"]
        rows = [
            ["ctx", "source", "glutamate", "mine"],
            ["D1",  "Rate",   "GABA",      "mine"], ["SNr", "Rate", "GABA", "mine"],
        ]
        [projections]
        columns = ["source", "target", "weight"]
        rows = [["ctx", "D1", 1], ["D1", "SNr", -1]]
    """
    circuit = table_reader.parse(text, "mine.toml")
    assert circuit.name == "mine"
    assert circuit.population("ctx") == Population("ctx", Phase(0.5), cite="mine")
    assert circuit.projection("D1->SNr") == Projection("D1", "SNr", -1)
    # Where rows share lines they are counted.
    with refused(r"transmitter ^mine\.toml, populations, row 3"):
        table_reader.parse(text.replace('"Rate", "GABA"', '"Rate", "gaba"'), "mine.toml")
    other = text.replace('"mine"],\n', '"mine"],', 1).replace('["SNr",', '\n["SNr",')
    other = other.replace('"D1",  "Rate"', '"D1", "Rat"')
    with refused(r"Rat ^mine\.toml, populations, row 2"):
        table_reader.parse(other, "mine.toml")


TEXT = table_writer.text(anatomy.spiking_msprt(2))


def line_of(start, text=TEXT):
    return next(k for k, line in enumerate(text.splitlines(), 1) if line.strip().startswith(start))


STN = line_of('["STN",    "Phase')
PATH = line_of('["STN",    "GPe"')
COLUMNS = line_of('columns = ["name"')
LIF = line_of("Lif_GPe")
REFERENCE = TEXT.splitlines(keepends=True)[line_of("reference_nats") - 1]
# fmt: off
WRONG = [
    ('"bias_nats"', '"bias"', COLUMNS, "no column of populations 'bias'; there are name, cell"),
    ('"pooled"', '"tau_ms"', COLUMNS, "the column 'tau_ms' of populations appears twice"),
    ('"Phase_STN",', '"Phase_STM",', STN, "there is no cell 'Phase_STM'; there are Phase_ctx"),
    ('"Phase_STN",', '"Phase",', STN, "a Phase cell needs cv: name it under [cells]"),
    ('"exp"', '"cubic"', STN, "transfer must be one of linear, rectified"),
    ("21.8,", "", STN, "14 columns, but 13 values"),
    ('["STN",    "Phase', '["GPe",    "Phase', STN + 1, "there is already a row 'GPe'"),
    ('["STN",    "GPe"', '["STN",    "SNr"', PATH + 1, "already a row 'STN->SNr'"),
    ('["STN",    "GPe"', '["STN",    "GPi"', PATH, "STN->GPi: there is no nucleus 'GPi'; there"),
    ('"Lif", tau_ms = 10', '"Lief", tau_ms = 10', LIF, "no cell type 'Lief'; there are AdEx"),
    ("Lif_GPe   = {", "Lif_GPe   = { speed = 1,", LIF, "no constant of a Lif cell 'speed'; there"),
    ('"Lif", tau_ms = 10,', '"Lif", tau_ms = 0,', LIF, "the Lif cell: tau_ms must be > 0"),
    ("range_nats = [1,", "range_nats = [nan,", line_of("range_nats"), "numbers that rise, got"),
    ("channels = 2", "channels = 1", 5, "channels must be a whole number >= 2, got 1"),
    ("channels = 2", "channels = 2\ngane = 1", 6, "no key 'gane'; there are format, name"),
    ("format = 1", "format = 2", 3, "the format must be 1, got 2"),
    ("format = 1\n", "", None, "the key 'format' is missing"),
    ("channels = 2\n", "", None, "the key 'channels' is missing"),
    (REFERENCE, "", None, "the key 'reference_nats' is missing"),
    ('columns = ["source", "target",', 'columns = ["source",', None, "needs the columns target"),
    ("channels = 2", "channels = = 2", None, "is not valid TOML: Invalid value (at line 5, column"),
    ("channels = 2", "channels = 2\ncells = 3", None, "mine.toml is not valid TOML"),
    ("[populations]", "[populations]\nmore = 1", None, "must contain columns and rows, and"),
    ("rows = [", "rows = 3\n[spare]\nrows = [", None, "no key 'spare'; there are format"),
]
# fmt: on


@pytest.mark.parametrize(("old", "new", "line", "says"), WRONG)
def test_what_is_wrong_is_said_with_its_line_if_it_is_in_one(old, new, line, says):
    assert old in TEXT
    where = f", line {line}: " if line else ""
    with pytest.raises(ValueError, match=rf"^mine\.toml{where}") as caught:
        table_reader.parse(TEXT.replace(old, new, 1), "mine.toml")
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


@settings(max_examples=150)
@given(
    st.integers(0, len(TEXT)),
    st.integers(0, 40),
    st.sampled_from(["", "#", "1", "-1e400", "nan", "true", '"', '"x"', "[", "]", "[]", "{}", "="]),
)
def test_a_mangled_file_gives_a_circuit_or_one_sentence(start, length, put):
    mangled = TEXT[:start] + put + TEXT[start + length :]
    circuit, sentence = circuit_or_sentence(mangled)
    if circuit is None:
        assert sentence.startswith("mine.toml")
        assert "\n" not in sentence
    else:
        assert table_reader.parse(table_writer.text(circuit), "mine.toml") == circuit


def circuit_or_sentence(text):
    try:
        return table_reader.parse(text, "mine.toml"), ""
    except ValueError as error:
        return None, str(error)


def test_a_file_that_cannot_be_read_is_said(tmp_path):
    with refused("path mine.toml' can't be read"):
        anatomy.load_circuit(tmp_path / "mine.toml")
    (tmp_path / "mine.toml").write_bytes(b"\xff\xfe\x00")
    with refused("path mine.toml' can't be read as text"):
        anatomy.load_circuit(tmp_path / "mine.toml")
