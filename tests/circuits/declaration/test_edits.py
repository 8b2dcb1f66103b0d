"""Edits as text: one grammar for Python, files and the terminal."""

import re
from dataclasses import dataclass
from itertools import combinations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bgmodel.cli import parsed
from bgmodel.support import toml_files
from circuits.anatomy import load_circuit
from circuits.declaration.courses import Course
from circuits.declaration.edits import FRACTION, VERBS, Edits
from circuits.declaration.edits import parsed as parsed_line
from circuits.dynamics.fixed_point import resting_hz
from circuits.engines import run
from tests.helpers import refused

TABLE = load_circuit("spiking_msprt", 2)
ADDED = ("add TRN like=STN bias_nats=-1", "add TRN->GPe weight=0.1")
ALL = (
    "neurons 20",
    "heterogeneity 0.1",
    *ADDED,
    "keep rest",
    "set STN.neurons 50",
    "set STN->GPe.delay_ms 4",
    "set D1->SNr.synapse GABA-A",
    "lesion TRN 50%",
    "lesion D1[1] 10%",
    "cut GPe->STN 30%",
    "block D1->SNr GABA-A 20%",
    "scale TRN->GPe 0.5",
    "dopamine 1.1",
    "compensate",
    "rebound SNr 0.2",
)
"""An edit of every kind except two, in the order in which they are applied."""


@dataclass(frozen=True)
class File:
    edits: Edits = Edits()  # noqa: RUF009


def at_the_terminal(*lines):
    return parsed(["circuit", "show", "spiking_msprt", "--edits", *lines]).keywords["edits"]


@pytest.mark.parametrize("verb", VERBS)
def test_the_example_of_every_verb_is_that_edit(verb):
    line, table = VERBS[verb].example, TABLE.set("STN->SNr.synapse", "NMDA")
    assert parsed_line(line).verb == verb
    if verb == "keep":
        assert TABLE.edited(*ADDED, line) != TABLE.edited(*ADDED)
    elif verb != "compensate":
        assert table.edited(line) != table
    assert TABLE.edited("lesion STN", "compensate") != TABLE.edited("lesion STN")


def test_a_file_the_terminal_and_python_say_the_same():
    lines = ("lesion STN 10%", "set STN->GPe.delay_ms 4", *ADDED)
    file = toml_files.decoded({"edits": [*lines]}, File, "mine.toml").edits
    assert file == at_the_terminal(*lines) == Edits(lines) == lines


@pytest.mark.parametrize(
    ("line", "edited"),
    [
        ("lesion STN 10%", TABLE.lesion("STN", 0.1)),
        ("  lesion  STN  0.1 ", TABLE.lesion("STN", 0.1)),
        ("lesion D2", TABLE.lesion("D2")),
        ("lesion GPe [1] 25%", TABLE.lesion("GPe", 0.25, channel=1)),
        ("lesion D2[0]", TABLE.lesion("D2", channel=0)),
        ("clamp GPe 50%", TABLE.clamp("GPe", 0.5)),
        ("clamp GPe[0]", TABLE.clamp("GPe", channel=0)),
        ("cut GPe->STN 30%", TABLE.cut("GPe->STN", 0.3)),
        ("cut D1 -> SNr[1]", TABLE.cut("D1->SNr", channel=1)),
        ("scale STN->GPe 0.5", TABLE.scale("STN->GPe", 0.5)),
        ("scale ctx -> D1[0] 1.1", TABLE.scale("ctx->D1", 1.1, channel=0)),
        ("add dopamine amount=0.2", TABLE.with_rows(Course("dopamine", 0.2))),
        ("dopamine 0.9", TABLE.dopamine(0.9)),
        ("neurons 1e2", TABLE.with_neurons(100)),
        ("connections 0.25", TABLE.with_connections(0.25)),
        ("rebound SNr 0.2", TABLE.compensate(TABLE, rebound_nats={"SNr": 0.2})),
    ],
)
def test_every_verb_is_a_method(line, edited):
    assert TABLE.edited(line) == edited != TABLE


@given(st.permutations(ALL))
@settings(max_examples=30)
def test_the_order_in_which_edits_are_written_does_not_matter(lines):
    circuit, in_order = TABLE.edited(*lines), TABLE.edited(*ALL)
    assert {row.name: row for row in circuit.values()} == dict(in_order.items())
    made = [VERBS[line.split()[0]] for line in Edits(lines).text().split("; ")]
    assert made == sorted(made, key=[*VERBS.values()].index)


def test_edits_of_all_nuclei_come_first_then_rows_then_factors():
    by_hand = TABLE.with_neurons(20).with_heterogeneity(0.1)
    by_hand = by_hand.edited(*ADDED, "keep rest")
    by_hand = by_hand.set("STN.neurons", 50).set("STN->GPe.delay_ms", 4)
    by_hand = by_hand.set("D1->SNr.synapse", "GABA-A").block("D1->SNr GABA-A", 0.2)
    by_hand = by_hand.lesion("TRN", 0.5).lesion("D1", 0.1, channel=1).cut("GPe->STN", 0.3)
    by_hand = by_hand.scale("TRN->GPe", 0.5).dopamine(1.1)
    assert TABLE.edited(*ALL[:-2]) == by_hand
    assert TABLE.edited(*ALL) == by_hand.compensate(TABLE, rebound_nats={"SNr": 0.2})


@pytest.mark.parametrize("value", ['""', "''"])
def test_quotes_around_a_value_are_no_part_of_it(value):
    circuit = load_circuit("macaque")
    assert circuit.edited(f"set D1.receptor {value}").population("D1").receptor == ""
    cited = circuit.edited('set D1.cite "mine, 2026"')
    assert cited.population("D1").cite == "mine, 2026"


@pytest.mark.parametrize(
    "line",
    [
        "", "STN", "STN=0.15", "lesoin STN", "Lesion STN", "lesion", "lesion STN=0.1",
        "lesion STN ten", "lesion STN 10% 20%", "lesion STN->GPe 10%", "lesion GPe[x]",
        "lesion GPe[-1]", "lesion GPe[0", "cut STN 10%", "cut GPe->STN=0.3", "scale STN->GPe",
        "scale STN 2", "scale STN->GPe 50%", "scale ctx->D1[ 2", "set STN", "set STN 0.2",
        "set STN.bias_nats", "set STN->GPe 0.5", "add", "add weight=1", "keep", "keep calm",
        "dopamine", "dopamine low", "dopamine STN 1", "neurons many", "compensate STN",
        "rebound SNr", "rebound SNr[0] 0.2", "rebound 0.2",
    ],
)  # fmt: skip
def test_a_line_that_is_no_edit_is_named_with_an_example_or_the_verbs(line):
    verb = line.split(" ")[0]
    known = VERBS[verb].example if verb in VERBS else ", ".join(VERBS)
    if "[" in line and verb != "rebound":
        known = "GPe[0]"
    with pytest.raises(ValueError, match=rf"^{re.escape(repr(line))}: .*{re.escape(known)}"):
        TABLE.edited(line)


@pytest.mark.parametrize("verb", [verb for verb in VERBS if VERBS[verb].takes == FRACTION])
def test_a_fraction_above_one_is_refused_with_both_spellings(verb):
    line, table = VERBS[verb].example.rpartition(" ")[0], TABLE.set("STN->SNr.synapse", "NMDA")
    with refused(r"edits write 15% or 0.15"):
        table.edited(f"{line} 15")
    assert table.edited(f"{line} 1") == table.edited(line)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("lesion GPe->STN 30%", "a pathway is cut, as in 'cut GPe->STN 30%'"),
        ("cut STN->GPi", "SNr represents both output nuclei"),
        ("neurons 1.5", "neurons must be a whole number"),
        ("set STN.bias_nats=", "bias_nats must be a number"),
        ("set STN->GPe.delay_ms=fast", "STN->GPe: delay_ms must be a number, got 'fast'"),
        ("set STN.pooled=maybe", "pooled"),
        ("set ctx->D1.factors=1,x", "factors"),
        ("set STN.cell=adex", "cell"),
        ("set STN.cell=Phase", "STN: the cell needs cv"),
        ("set STN.receptor=D3", "receptor"),
        ("add D1->GPe", "D1->GPe needs weight, or like=ROW"),
        ("add D1->GPe weight", "a new row is its name and FIELD=VALUE"),
        ("add D1->GPe weight=-1 weight=-2", "each field once"),
        ("add STN->GPe weight=1", "STN->GPe already exists: use set"),
        ("add D1->GPe like=STN", "D1->GPe can't be like STN: one of them is a pathway"),
        ("add TRN neurons=3", "TRN needs cell, or like=ROW"),
        ("add TRN cell.cv=0.2", "TRN has no 'cell.cv': cell, "),
        ("add a.b like=STN", "a population's name is text without blanks, brackets, '.'"),
        ("add TRN like=STN cite='my", "No closing quotation"),
        ("add dopamine weight=1", "weight"),
        ("add TRN amount=1", "course of TRN from 0 to inf ms: spiking_msprt has no nucleus 'TRN'"),
        ("add ctx->D1 amount=1", "has no nucleus 'ctx->D1': a course is of dopamine, ctx, common"),
        ("add STN from_ms=3", "a course of STN needs amount"),
        ("add STN amount=1 until_ms=3", "a course of STN has no 'until_ms': amount, from_ms"),
        ("add dopamine amount=1.1", "of dopamine must be within 0..2, with this row it is 2.1"),
    ],
)
def test_an_edit_that_does_not_fit_is_named_as_it_was_written(line, says):
    with pytest.raises(ValueError, match=r"^[^\n]+$") as error:
        TABLE.edited(line)
    assert str(error.value).startswith(f"{line.removeprefix('add ')!r}: ")
    assert says in str(error.value)


OVERLAPS = [
    ("lesion STN 10%", "lesion STN 20%"),
    ("lesion STN 10%", " lesion  STN  10%"),
    ("lesion STN 10%", "lesion STN[0] 10%"),
    ("lesion STN 10%", "clamp STN 10%"),
    ("lesion STN 10%", "set STN.intact 0.5"),
    ("lesion STN[1] 10%", "set STN.intact_by_channel 1,0.5"),
    ("cut GPe->STN 10%", "cut GPe->STN[1] 10%"),
    ("cut GPe->STN 10%", "set GPe->STN.intact 0.5"),
    ("scale STN->GPe 2", "scale STN->GPe[0] 2"),
    ("scale STN->GPe 2", "set STN->GPe.weight 2"),
    ("scale STN->GPe[0] 2", "set STN->GPe.factors 2,1"),
    ("set STN.bias_nats 1", "set STN.bias_nats=2"),
    ("add TRN like=STN bias_nats=1", "set TRN.bias_nats 2"),
    ("add TRN like=STN bias_nats=1", "add TRN like=GPe"),
    ("dopamine 0.9", "dopamine 1.1"),
    ("neurons 10", "neurons 20"),
    ("rebound SNr 0.1", "rebound SNr 0.2"),
    ("compensate", "compensate"),
]


@pytest.mark.parametrize(("one", "other"), OVERLAPS)
def test_two_edits_of_one_number_are_refused_with_both(one, other):
    for lines in ((one, other), (other, one)):
        with refused("edits edit the same number") as error:
            Edits(lines)
        assert repr(one) in str(error.value)
        assert repr(other) in str(error.value)


@pytest.mark.parametrize("last", ["compensate", "rebound SNr 0.1"])
def test_a_bias_that_compensation_would_set_again_is_refused(last):
    with refused("edits edit the same number"):
        TABLE.edited("set GPe.bias_nats 0.3", last)
    copied = ("add TRN like=STN", "set TRN.bias_nats -1")  # it has no rate to return to
    assert TABLE.edited(*copied, last)["TRN"].bias_nats == -1


@pytest.mark.parametrize(
    "lines",
    [
        ("lesion STN[0] 10%", "lesion STN[1] 20%"),
        ("cut GPe->STN 30%", "scale GPe->STN 0.5"),
        ("add D1->GPe weight=-0.1", "scale D1->GPe 0.5", "cut D1->GPe 10%"),
        ("add TRN like=STN", "lesion TRN 50%", "set TRN.bias_nats 1"),
        ("add STN amount=0.1", "add STN amount=0.2 from_ms=100", "lesion STN 10%"),
        ("neurons 10", "set STN.neurons 20"),
        ("compensate", "rebound SNr 0.1", "rebound GPe 0.1"),
        ("set STN.cell Phase", "set STN.cell.cv 0.2"),
    ],
)
def test_edits_of_different_numbers_go_together(lines):
    forth, back = TABLE.edited(*lines), TABLE.edited(*reversed(lines))
    assert dict(forth.items()) == dict(back.items())
    assert set(forth.courses) == set(back.courses)
    assert forth != TABLE
    for one, other in combinations(lines, 2):
        assert not parsed_line(one).overlaps(parsed_line(other))


def test_an_edit_replaces_the_same_edit_in_any_spelling_and_no_other():
    edits = Edits(["lesion STN 10%", "scale STN->GPe 0.5", "compensate", "dopamine 0.9"])
    new = edits.replacing(["scale STN -> GPe  2", "lesion GPe 5%"], without=["compensate"])
    assert set(new) == {"lesion STN 10%", "dopamine 0.9", "scale STN -> GPe  2", "lesion GPe 5%"}
    with refused("edits edit the same number"):
        edits.replacing(["lesion STN[0] 10%"])
    with refused("edits edit the same number"):
        Edits(["add STN amount=0.1"]).replacing(["add STN amount=0.1 to_ms=300"])
    one, other = "add STN[0] amount=0.1", "add STN[1] amount=0.2"
    assert Edits([one]).replacing([other]) == (one, other)
    for meets in ("add STN[0] amount=0.3", "add STN amount=0.1"):
        with refused("edits"):
            Edits([one]).replacing([meets])


def test_a_rebound_compensates_the_others_too():
    edited = TABLE.edited("lesion STN", "rebound SNr 0.5")
    assert edited == TABLE.edited("compensate", "rebound SNr 0.5", "lesion STN")


@pytest.mark.parametrize(("path", "tone"), [("STN->SNr", False), ("GPe->STN", True)])
def test_scaled_and_cut_axons_differ_by_their_tone_until_it_is_compensated(path, tone):
    """The baseline of STN is 0 Hz: its axons have no tone, and halving their signal is a cut."""
    circuit = load_circuit("macaque", 2)
    half = [f"scale {path} 0.5"], [f"cut {path} 50%"]
    scaled, cut = (resting_hz(circuit.edited(*each)) for each in half)
    assert (scaled == pytest.approx(cut)) is not tone
    assert (scaled == pytest.approx(resting_hz(circuit))) is tone
    drive = [[[0.5, -0.5]]]
    compensated = (circuit.edited(*each, "compensate") for each in half)
    one, other = (run(each, drive, engine="algebra", step_ms=50) for each in compensated)
    assert one.output_nats == pytest.approx(other.output_nats)


def test_keep_rest_needs_a_row_that_is_added():
    added, kept = TABLE.edited(*ADDED), TABLE.edited(*ADDED, "keep rest")
    nucleus = TABLE.add("TRN", like="STN", bias_nats=-1)
    assert added == nucleus.add("TRN->GPe", weight=0.1)
    assert added != kept == nucleus.add("TRN->GPe", weight=0.1, keep_rest=True)
    with refused("edits"):
        TABLE.edited("keep rest")
