"""Edits as a person writes them: one dialect for a file, the terminal and Python."""

import inspect
import re
import tomllib
from dataclasses import fields, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bgmodel.cli import main, parsed
from bgmodel.integrators.basal_ganglia import rest_out
from bgmodel.support import toml_files
from circuits import anatomy
from circuits.declaration.courses import Course
from circuits.edit_lists import Edits, written

TABLE = anatomy.spiking_msprt()
DELAY, BIAS = "STN->GPe.delay_ms=4", "STN.bias_nats=-2.3"
PATHWAY, NUCLEUS = "D1->GPe weight=-0.1 delay_ms=4", "TRN like=STN bias_nats=-1"


def examples():
    """Yield the examples that stand in the documentation of each edit."""
    source = inspect.getsource(Edits)
    for field in fields(Edits):
        after = re.search(rf'\n    {field.name}: [^\n]*\n    """(.*?)"""', source, re.DOTALL)
        assert after, field.name
        found = re.findall("`([^`]+)`", after[1])
        assert any(example.startswith(f"{field.name} = ") for example in found), field.name
        yield field.name, "\n".join(found)


@pytest.mark.parametrize(("name", "example"), examples())
def test_the_example_of_every_edit_runs_and_edits(name, example):
    given = tomllib.loads(example)
    edits = toml_files.decoded(given, Edits, "example")
    assert name in given
    assert edits.apply(TABLE) != TABLE
    assert edits.text().startswith(next(iter(given)))


def at_the_terminal(*options):
    return parsed(["circuit", "show", "spiking_msprt", *options]).edits


def test_a_file_the_terminal_and_python_say_the_same():
    told = {"change": [DELAY, BIAS], "add": [PATHWAY, NUCLEUS]}
    file = toml_files.decoded(told, Edits, "mine.toml")
    typed = at_the_terminal("--edits.change", DELAY, BIAS, "--edits.add", PATHWAY, NUCLEUS)
    python = Edits(change=(DELAY, BIAS), add=(PATHWAY, NUCLEUS))
    assert file == typed == python
    assert python.apply(TABLE) == TABLE.add(PATHWAY, NUCLEUS).edited(DELAY, BIAS)
    assert python.apply(TABLE).projection("STN", "GPe").delay_ms == 4


def test_a_course_is_a_row_wherever_rows_are_added_and_is_relative_to_the_level_of_the_edits():
    text = "dopamine amount=0.2 to_ms=300 decay_ms=50"
    edits = Edits(add=(text,), dopamine=1.1, without=("STN=0.1",))
    assert written(text) == Edits(add=(text,))
    assert at_the_terminal("--edits.add", text) == Edits(add=(text,))
    course = Course("dopamine", 0.2, 0, 300, decay_ms=50)
    assert edits.apply(TABLE) == TABLE.lesion("STN", 0.1).dopamine(1.1).add(course)
    assert rest_out(edits.apply(TABLE)) == rest_out(TABLE.lesion("STN", 0.1).dopamine(1.1))


def test_edits_are_made_in_the_order_of_their_fields():
    """What is said of one row holds against what is said of all; factors come last."""
    edits = Edits(
        dopamine=1.1,
        scale=("D1->GPe=0.5",),
        without=("TRN=0.5",),
        change=("STN.neurons=50", "TRN.neurons=30", "D1->GPe.weight=-0.3"),
        add=(PATHWAY, NUCLEUS),
        neurons=20,
    )
    by_hand = TABLE.with_neurons(20).add(PATHWAY, NUCLEUS).with_population("STN", neurons=50)
    by_hand = by_hand.with_population("TRN", neurons=30).with_projection("D1", "GPe", weight=-0.3)
    by_hand = by_hand.lesion("TRN", 0.5).scale("D1", "GPe", 0.5).dopamine(1.1)
    assert edits.apply(TABLE) == by_hand
    assert edits.text() == (
        f"neurons 20; add {PATHWAY}, {NUCLEUS}; change STN.neurons=50, TRN.neurons=30, "
        "D1->GPe.weight=-0.3; without TRN=0.5; scale D1->GPe=0.5; dopamine 1.1"
    )
    assert edits.used()["applied"] == edits.text()
    assert list(edits.used())[:-1] == [f.name for f in fields(Edits) if f.name in edits.used()]


@given(st.floats(0.01, 0.99), st.sampled_from(["D1", "D2", "STN", "GPe"]))
def test_edits_undone_leave_the_circuit(fraction, name):
    lesioned = Edits(without=(f"{name}={fraction!r}",)).apply(TABLE)
    assert lesioned.unlesioned == TABLE
    assert lesioned.edited(f"{name}.intact=1") == TABLE
    halved = Edits(scale=("STN->GPe=0.5",)).apply(TABLE)
    assert Edits(scale=("STN->GPe=2",)).apply(halved) == TABLE


def test_no_edits_leave_the_circuit_and_say_nothing():
    assert Edits().apply(TABLE) is TABLE
    assert Edits().used() == {}
    assert Edits().text() == ""


@pytest.mark.parametrize(
    ("text", "edits"),
    [
        ("STN", Edits(without=("STN",), replaced=True)),
        ("STN=0.5", Edits(without=("STN=0.5",), replaced=True)),
        ("GPe[0]=0.25", Edits(without=("GPe[0]=0.25",), replaced=True)),
        ("D2[1]", Edits(without=("D2[1]",), replaced=True)),
        ("STN->GPe=0.5", Edits(scale=("STN->GPe=0.5",))),
        ("ctx -> D1[0]=1.1", Edits(scale=("ctx -> D1[0]=1.1",))),
        (DELAY, Edits(change=(DELAY,))),
        ("STN -> GPe.delay_ms = 4", Edits(change=("STN -> GPe.delay_ms = 4",))),
        (PATHWAY, Edits(add=(PATHWAY,))),
        (NUCLEUS, Edits(add=(NUCLEUS,))),
        ("striatal_FSI", Edits(add=("striatal_FSI",))),
        ("dopamine=0.9", Edits(dopamine=0.9)),
        ("rebound SNr=0.2", Edits(rebound=("SNr=0.2",))),
    ],
)
def test_the_form_of_a_text_says_which_edit_it_is(text, edits):
    found = written(text, replaced=True)
    assert found == edits
    assert found.apply(TABLE) != TABLE


@pytest.mark.parametrize(
    ("engine", "edit"),
    [
        ("algebra", "STN->GPe.delay_ms=4"),
        ("algebra", "STN.tau_ms=4"),
        ("algebra", "GPe.cell.tau_ms=4"),
        ("rate", "STN.cell.cv=0.1"),
        ("rate", "STN.neurons=7"),
        ("rate", "STN->GPe.probability=0.5"),
    ],
)
def test_a_change_that_an_engine_does_not_feel_is_refused(engine, edit):
    Edits(change=(edit,)).check_engine("ensemble")
    with pytest.raises(ValueError, match=f"^'{edit}' says nothing to the {engine} engine$"):
        Edits(change=(edit,)).check_engine(engine)


@pytest.mark.parametrize("edit", [DELAY, "GPe.cell.tau_ms=12", "STN.tau_ms=7", BIAS])
def test_rates_feel_times_and_biases(edit):
    Edits(change=(edit,)).check_engine("rate")


@pytest.mark.parametrize("written", ["ctx->D1[=2", "ctx->D1[x]=2", "ctx->D1[-1]=2", "ctx->D1[0=2"])
def test_a_channel_is_a_number_in_brackets(written):
    with pytest.raises(ValueError, match="a channel is a number in brackets"):
        Edits(scale=(written,)).apply(anatomy.spiking_msprt())


def test_one_channel_is_edited_as_written():
    circuit = anatomy.spiking_msprt(4)
    edited = Edits(scale=("ctx->D1[2]=1.1", "STN->GPe=0.5")).apply(circuit)
    assert edited == circuit.scale("ctx", "D1", 1.1, channel=2).scale("STN", "GPe", 0.5)
    edited = Edits(without=("GPe[3]=0.25", "STN=0.1")).apply(circuit)
    assert edited == circuit.lesion("GPe", 0.25, channel=3).lesion("STN", 0.1)


@pytest.mark.parametrize(
    ("told", "says"),
    [
        ({"without": ("STN=1.5",)}, "'STN=1.5': fraction must lie in 0..1, got 1.5"),
        ({"without": ("GPe[2]=0.5",)}, "'GPe[2]=0.5': GPe: channel must lie in 0..1, got 2"),
        (
            {"without": ("GPe[x]",)},
            "a channel is a number in brackets, as \"GPe[0]\", got 'GPe[x]'",
        ),
        ({"scale": ("STN->GPi=0.5",)}, "'STN->GPi=0.5': spiking_msprt has no pathway STN->GPi"),
    ],
)
def test_a_lesion_or_a_factor_without_sense_is_named_as_it_was_written(told, says):
    with pytest.raises(ValueError, match=f"^{re.escape(says)}"):
        Edits(**told).apply(anatomy.spiking_msprt(2))


def test_what_recovers_does_so_from_every_edit_that_is_told():
    """Lesion, weight, field and level, written in a file as at the terminal."""
    told = {"without": ["STN=0.3"], "scale": ["STN->SNr=0.8"], "dopamine": 0.9, "recovered": True}
    told |= {"change": [BIAS], "rebound": ["SNr=0.2"]}
    file = toml_files.decoded(told, Edits, "mine.toml")
    typed = at_the_terminal(
        *("--edits.without", "STN=0.3", "--edits.scale", "STN->SNr=0.8", "--edits.dopamine", "0.9"),
        *("--edits.change", BIAS, "--edits.recovered", "--edits.rebound", "SNr=0.2"),
    )
    assert file == typed
    by_hand = TABLE.edited(BIAS).lesion("STN", 0.3).scale("STN", "SNr", 0.8).dopamine(0.9)
    assert file.apply(TABLE) == by_hand.compensate(TABLE, rebound_nats={"SNr": 0.2})
    assert file.text().endswith("dopamine 0.9; recovered; rebound SNr=0.2")


def test_a_rebound_recovers_the_others_too():
    edits = Edits(without=("STN",), rebound=("SNr=0.5",))
    assert edits.apply(TABLE) == replace(edits, recovered=True).apply(TABLE)
    assert Edits(recovered=True).apply(TABLE) == TABLE


@pytest.mark.parametrize(
    ("told", "sentence"),
    [
        (("GPi=0.5",), "spiking_msprt has no nucleus 'GPi': ctx"),
        (("SNr",), "an edit is a name, =, and a number; got 'SNr'"),
        (("SNr=0.5", "SNr=0.2"), "'SNr=0.2': the rebound of SNr is given twice"),
    ],
)
def test_a_rebound_that_makes_no_sense_is_one_sentence(told, sentence):
    with pytest.raises(ValueError, match=f"^{re.escape(sentence)}"):
        Edits(rebound=told).apply(TABLE)


def test_an_edit_that_is_written_by_itself_may_recover():
    assert written("STN=0.5", recovered=True) == Edits(without=("STN=0.5",), recovered=True)


def test_replaced_gives_back_what_a_lesion_took():
    lost = Edits(without=("GPe",), replaced=True).apply(TABLE)
    assert lost == TABLE.lesion("GPe", replaced=True) != TABLE.lesion("GPe")


AXONS = "cut GPe->STN=0.3"


def test_axons_are_cut_in_text_as_in_python():
    assert written(AXONS) == Edits(cut=("GPe->STN=0.3",))
    assert written(AXONS).apply(TABLE) == TABLE.cut("GPe", "STN", 0.3)
    assert at_the_terminal("--edits.cut", "GPe->STN=0.3") == Edits(cut=("GPe->STN=0.3",))
    assert Edits(cut=("D1 -> SNr[1]",)).apply(TABLE) == TABLE.cut("D1", "SNr", channel=1)
    both = Edits(cut=("GPe->STN=0.3",), scale=("GPe->STN=0.5",))
    assert both.apply(TABLE) == TABLE.cut("GPe", "STN", 0.3).scale("GPe", "STN", 0.5)
    assert both.text() == "cut GPe->STN=0.3; scale GPe->STN=0.5"
    for wrong in ("GPe=0.3", "GPe->STN=1.2", "GPe->STN=x", "GPe->STN[7]=0.1", "STN->D1"):
        with pytest.raises(ValueError, match=re.escape(wrong)):
            Edits(cut=(wrong,)).apply(TABLE)


def test_what_a_cut_and_a_scale_do_is_said_beside_each_other_and_of_no_other_edit():
    scaled, cut = written("GPe->STN=0.5"), written(AXONS)
    for one, other in ((scaled, "cut"), (cut, "scale")):
        (note,) = one.notes()
        assert "tone" in note
        assert other in note
    assert Edits(cut=("GPe->STN=0.3",), scale=("GPe->STN=0.5",)).notes() == [
        *scaled.notes(),
        *cut.notes(),
    ]
    assert written("STN=0.5").notes() == Edits().notes() == []


@pytest.mark.parametrize("edits", [("--edits.scale", "GPe->STN=0.5"), ("--edits.cut", "GPe->STN")])
def test_commands_say_what_a_cut_or_a_scale_does(edits, capsys):
    assert main(["circuit", "show", "macaque", *edits]) == 0
    found = capsys.readouterr()
    assert "tone" in found.err
    assert main(["circuit", "show", "macaque", "--edits.without", "STN=0.1"]) == 0
    assert "tone" not in capsys.readouterr().err


def test_rows_are_added_in_text_with_rates_at_rest_kept():
    rows = ("TRN like=STN bias_nats=-1", "TRN->GPe weight=0.1")
    edited = Edits(add=rows, keep_rest=True).apply(TABLE)
    assert edited == TABLE.add(*rows, keep_rest=True)
    assert edited != TABLE.add(*rows)
    asked = Edits(add=rows, keep_rest=True)
    assert at_the_terminal("--edits.add", *rows, "--edits.keep-rest") == asked
    with pytest.raises(ValueError, match="keep_rest is for rows that are added"):
        Edits(keep_rest=True).apply(TABLE)
