"""Edits in text: they say what Python says, and what they name is there or is refused."""

import inspect
from dataclasses import fields, replace

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from circuits import anatomy
from circuits.cells import Phase, Rate
from circuits.declaration.rows import Population, Projection
from tests.helpers import refused

TABLE = anatomy.spiking_msprt()
TABLES = [anatomy.load_circuit(name) for name in anatomy.CIRCUITS]
ROWS = [*(p.name for p in TABLE.populations), *(p.name for p in TABLE.projections)]
NAMES = st.text("abcDGNST_19", min_size=1, max_size=5)
NUMBERS = st.floats(0, 1000).map(lambda x: round(x, 3))


def with_texts(*rows):
    return TABLE.edited(*(f"add {row}" for row in rows))


@st.composite
def numbers_changed(draw):
    """Return a circuit, a row, a field that holds a number, and another number for it."""
    circuit = draw(st.sampled_from(TABLES))
    row = draw(st.sampled_from([*circuit.populations, *circuit.projections]))
    field = draw(st.sampled_from([f.name for f in fields(row) if f.type == "float"]))
    value = draw(NUMBERS)
    value = -value if getattr(row, field) < 0 else value
    return circuit, row, field, value


def circuit_or_refusal(edit):
    try:
        return edit()
    except ValueError as error:
        return str(error)


def in_python(circuit, row, **values):
    if isinstance(row, Projection):
        return circuit.with_projection(row.pair, **values)
    return circuit.with_population(row.name, **values)


@given(numbers_changed())
def test_text_and_python_give_equal_circuits_or_the_same_refusal(drawn):
    circuit, row, field, value = drawn
    text = f"set {row.name}.{field} {value!r}"
    expected = circuit_or_refusal(lambda: in_python(circuit, row, **{field: value}))
    outcome = circuit_or_refusal(lambda: circuit.edited(text))
    if isinstance(expected, str):
        assert outcome == f"{text!r}: {expected}"
    else:
        assert outcome == expected
        assert outcome.exact <= circuit.exact


@given(numbers_changed())
def test_a_change_and_its_inverse_give_the_tables_back(drawn):
    circuit, row, field, value = drawn
    try:
        edited = circuit.edited(f"set {row.name}.{field}={value!r}")
    except ValueError:
        assume(False)
    back = edited.edited(f"set {row.name}.{field}={getattr(row, field)!r}")
    marks = {name: getattr(circuit, name) for name in ("about", "exact", "max_lead_nats")}
    assert replace(back, **marks) == circuit
    assert back.exact == edited.exact


@given(NAMES, NAMES, NAMES)
def test_unknown_names_raise_and_give_no_circuit(row, other, field):
    names = {name for kind in (Population, Projection) for name in kind.__dataclass_fields__}
    assume(row not in ROWS and f"{row}->{other}" not in ROWS and field not in names)
    nuclei = ", ".join(p.name for p in TABLE.populations)
    for text in (f"set {row}.bias_nats 1", f"set {row}.{field} 1", f"add TRN like={row}"):
        with refused(f"nucleus {nuclei}$"):
            TABLE.edited(text)
    with refused("pathway"):
        TABLE.edited(f"set {row}->{other}.delay_ms=1")
    for known in ROWS:
        with pytest.raises(ValueError, match=f"{known} has no '{field}': (cell|weight), "):
            TABLE.edited(f"set {known}.{field}=1")
    with pytest.raises(ValueError, match=f"STN has no 'cell.{field}': .*, cell.cv$"):
        TABLE.edited(f"set STN.cell.{field}=1")
    with pytest.raises(ValueError, match=f"D1->GPe has no '{field}': weight, "):
        TABLE.edited(f"add D1->GPe weight=-1 {field}=1")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("set STN->GPe.delay_ms=4", TABLE.with_projection("STN->GPe", delay_ms=4)),
        (" set STN -> GPe.delay_ms = 4 ", TABLE.with_projection("STN->GPe", delay_ms=4)),
        ("set STN.neurons=1e3", TABLE.with_population("STN", neurons=1000)),
        ("set STN.cite=Kita & Kitai 1991", TABLE.with_population("STN", cite="Kita & Kitai 1991")),
        ("set common.pooled=true", TABLE),
        ("set ctx->D1.factors=1,0.9", TABLE.with_projection("ctx->D1", factors=(1, 0.9))),
        ("set ctx->D1.factors=", TABLE),
        ("set STN.cell=Rate", TABLE.with_population("STN", cell=Rate())),
    ],
)
def test_a_change_is_read_by_the_type_of_its_field(text, expected):
    assert TABLE.edited(text) == expected


def test_changes_are_made_at_once_so_that_their_order_does_not_matter():
    sign = ["set STN->GPe.weight -0.5", "set STN->SNr.weight -1", "set STN->common.weight -1"]
    changes = ["set STN.transmitter GABA", *sign, "set STN.cell Phase", "set STN.cell.cv 0.1"]
    edited = TABLE.edited(*changes)
    assert edited == TABLE.edited(*reversed(changes))
    assert edited.population("STN").cell == Phase(0.1)
    with refused("weight"):
        TABLE.edited(changes[0])
    lif = ("set D1.cell.reset_mv 16", "set D1.cell.threshold_mv 20")
    assert TABLE.edited(*lif) == TABLE.with_cell("D1", reset_mv=16, threshold_mv=20)


STN, D1_SNR = TABLE["STN"], TABLE["D1->SNr"]
ADDED = {
    "D1->GPe weight=-0.1 delay_ms=4": Projection("D1", "GPe", -0.1, delay_ms=4),
    "D1 -> GPe like=D1->SNr weight=-0.1":
        replace(D1_SNR, target="GPe", weight=-0.1, cite="as D1->SNr; assumed: weight"),
    "TRN like=STN bias_nats=-1 cell.cv=0.2 cite='my data'":
        replace(STN, name="TRN", bias_nats=-1, cell=Phase(0.2), cite="my data"),
    "TRN cell=Phase cell.cv=0.2 gain_hz_per_nat=20":
        Population("TRN", Phase(0.2), gain_hz_per_nat=20),
    "TRN cell=Rate transmitter=GABA": Population("TRN", Rate(), transmitter="GABA"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "row"), ADDED.items(), ids=[*ADDED])
def test_a_row_in_text_is_the_row_in_python(text, row):
    assert TABLE.edited(f"add {text}") == TABLE.with_rows(row)


def test_a_row_may_be_like_one_that_is_added_with_it_in_any_order():
    nucleus = "Arky cell=Rate transmitter=GABA"
    paths = "Arky->D1 weight=-0.1 delay_ms=6", "Arky->D2 like=Arky->D1"
    rows = (nucleus, "B like=Arky baseline_hz=3", "C like=B", *paths)
    forth, back = with_texts(*rows), with_texts(*reversed(rows))
    first, second = (forth.projection(f"Arky->{name}") for name in ("D1", "D2"))
    assert second == replace(first, target="D2", cite="as Arky->D1")
    assert (forth["C"].baseline_hz, forth["C"].transmitter) == (3, "GABA")
    assert set(back.populations) == set(forth.populations)
    assert set(back.projections) == set(forth.projections)
    assert back.populations[-3:] == forth.populations[:-4:-1]  # in their original order
    python = TABLE.edited(f"add {nucleus}").add("Arky->D1", weight=-0.1, delay_ms=6)
    assert python.add("Arky->D2", like="Arky->D1").projection("Arky->D2") == second
    with refused("add rows that are like each other"):
        with_texts("B like=C", "C like=B", nucleus)
    with refused("edits 'add Arky like=STN'"):
        with_texts(nucleus, "Arky like=STN")


@given(st.floats(0.01, 1), st.sampled_from([None, 0, 1]), st.sampled_from(["lesion", "clamp"]))
def test_a_row_like_a_lesioned_one_is_like_the_intact_one(fraction, channel, verb):
    lesioned = getattr(TABLE, verb)("STN", fraction, channel=channel)
    assert lesioned.add("PPN", like="STN").row("PPN") == TABLE.add("PPN", like="STN").row("PPN")
    assert lesioned.add("PPN", like="STN", intact=0.3).population("PPN").intact == 0.3


def test_a_nucleus_like_another_has_no_published_rates_of_that_one():
    table = anatomy.macaque().add("TRN", like="STN")
    assert table.population("STN").published_hz
    assert table.population("TRN").published_hz == ()


def test_a_new_row_in_keywords_is_that_in_text_and_its_signature_lists_the_fields():
    cell = Phase(0.2)
    by_hand = TABLE.add("TRN", cell=cell, neurons=3).add("TRN->STN AMPA", weight=0.1, delay_ms=2)
    text = "add TRN cell=Phase cell.cv=0.2 neurons=3", "add TRN->STN AMPA weight=0.1 delay_ms=2"
    assert by_hand == TABLE.edited(*text)
    known = inspect.signature(TABLE.add).parameters
    assert {"like", "cell", "bias_nats", "weight", "delay_ms", "amount", "to_ms"} <= known.keys()
    assert not {"fields", "source", "what"} & known.keys()
    with refused("add each field once"):
        TABLE.add("STN->D1 NMDA", weight=0.1, synapse="AMPA")
    with refused("wieght"):
        TABLE.add("STN->D1", wieght=0.1)
    with refused("weight"):
        TABLE.add("STN->D1", weight="heavy")
