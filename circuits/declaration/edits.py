"""Edits of a circuit as text, one per line, identical in Python, in files and in the terminal.

``VERBS`` lists them with examples. A nucleus is written ``STN``, a pathway ``GPe->STN``; ``GPe[0]``
and ``ctx->D1[0]`` refer to one channel. A fraction is written ``10%`` or ``0.1``. A pathway through
one receptor is ``STN->SNr NMDA``; without it ``cut`` and ``scale`` act on all rows of a pathway.

The order of the lines does not matter: edits of all nuclei are applied first, then rows are added
and fields set, then nuclei are lesioned, pathways cut and scaled, and dopamine changed;
compensation comes last. Two edits must not change the same number, except that an added row may be
lesioned, cut or scaled.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import TYPE_CHECKING

from circuits.checks import place_of
from circuits.errors import InputError, shown

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler
    from pydantic_core import CoreSchema

NUCLEUS, PATHWAY, RECEPTOR = "nucleus", "pathway", "receptor"
FRACTION, NUMBER, WHOLE_NUMBER = "fraction", "number", "whole number"


@dataclass(frozen=True)
class Verb:
    """A kind of edit."""

    example: str  # an example line
    about: str  # description of the edit
    of: str = ""  # what follows the verb: a nucleus, a pathway, either with a receptor, or nothing
    takes: str = ""  # the number at the end: a fraction (by default all), a number, or none
    method: str = ""  # the method of a circuit that makes the edit, if its name differs
    changes: str = ""  # the field of rows that it changes


# fmt: off
VERBS = {
    "neurons": Verb("neurons 100", "cells per channel of every spiking nucleus",
                    takes=WHOLE_NUMBER, method="with_neurons", changes="neurons"),
    "connections": Verb("connections 0.25",
                        "connection probability between spiking nuclei, with fixed in-degree",
                        takes=NUMBER, method="with_connections", changes="probability"),
    "heterogeneity": Verb(
        "heterogeneity 0.1",
        "heterogeneity of the constants of cells in every spiking nucleus, as a fraction of each",
        takes=NUMBER, method="with_heterogeneity", changes="heterogeneity"),
    "add": Verb(
        "add D1->GPe weight=-0.1 delay_ms=4",
        "a pathway, a nucleus (TRN like=STN bias_nats=-1), a motif (urgency), or a course, "
        "which is a change within each trial (D2[0] amount=-2 from_ms=200 to_ms=400)"),
    "keep": Verb("keep rest", "existing nuclei keep their resting rates when rows are added"),
    "set": Verb(
        "set STN.bias_nats -0.2",
        "a field of a nucleus, of its cells (STN.cell.cv) or of a pathway (STN->GPe.delay_ms)"),
    "lesion": Verb(
        "lesion STN 10%",
        "a fraction of a nucleus is lost, with the effect of its steady firing (its tone)",
        NUCLEUS, FRACTION, changes="intact"),
    "clamp": Verb(
        "clamp GPe 50%",
        "a lesion after which the targets receive the lost output as a constant, its resting rate",
        NUCLEUS, FRACTION, changes="intact"),
    "cut": Verb("cut GPe->STN 30%",
                "a fraction of the axons of a pathway is lost, with their tone",
                PATHWAY, FRACTION, changes="intact"),
    "block": Verb(
        "block STN->SNr NMDA 50%",
        "a fraction of the receptors of a pathway, or of all pathways onto a nucleus (GPe AMPA), "
        "is blocked, with the tone that they transmit",
        RECEPTOR, FRACTION, changes="intact"),
    "scale": Verb("scale STN->GPe 0.5",
                  "the weight of a pathway is multiplied; the tone of its source stays",
                  PATHWAY, NUMBER, changes="weight"),
    "dopamine": Verb("dopamine 0.9", "the dopamine level, 0 to 2, where 1 is normal",
                     takes=NUMBER),
    "compensate": Verb("compensate",
                       "every nucleus returns to its own resting rate, as long after a lesion"),
    "rebound": Verb(
        "rebound SNr 0.5",
        "nuclei compensate, and one comes to rest above its old rate by that many nats",
        NUCLEUS, NUMBER),
}
# fmt: on
"""All kinds of edits, in the order in which they are applied."""
NOTES = {
    "scale": "scale multiplies the signal of a pathway, the deviation of its source from "
    "baseline_hz, and keeps its tone, the effect of firing at baseline_hz: resting rates change "
    "unless the source rests at its baseline_hz; cut takes both, compensate restores resting rates",
    "cut": "cut takes a fraction of a pathway's axons, with their signal and their tone, the "
    "effect of firing at baseline_hz; scale keeps the tone, compensate restores resting rates",
}
"""Notes on edits that are easily confused."""
SAME_NUMBER = {
    "intact_by_channel": "intact",
    "clamped": "intact",
    "factors": "weight",
}
"""Fields of rows that in effect change another field."""
WITH_RECEPTOR = r"[^\s=>]+\s*->\s*[^\s=.]+\s+[^\s=.]+\.[^\s=]+"
SET = re.compile(rf"({WITH_RECEPTOR}|[^\s=]+(?:\s*->\s*[^\s=]+)?)(?:\s*=\s*|\s+)(.*)")
NAME = re.compile(r"[a-z]*[A-Z][^\s=]*")
"""A receptor, which has a capital letter, unlike numbers and fields of rows."""
AMOUNT = "amount"
"""The field that makes a row a course; courses of one nucleus add up."""


@dataclass(frozen=True)
class Edit:
    """One edit."""

    text: str  # the original line
    verb: str  # a key of ``VERBS``
    # the nucleus or the pathway (``STN->SNr NMDA`` with its receptor); empty for some verbs
    row: str = ""
    field: str = ""  # the field to set
    channel: int | None = None  # None: all
    # the number in the line; or, as text, the new value of a field, or a new row
    value: float | str = ""

    @property
    def is_course(self) -> bool:
        """Whether it adds a course, of which a nucleus may have several."""
        return self.verb == "add" and AMOUNT in self._given()

    @property
    def place(self) -> tuple[object, ...]:
        """Target of the edit: edits with the same target differ only in their values."""
        course = self.value if self.is_course else None
        return self.verb, self.row, self.field, self.channel, course

    def overlaps(self, other: Edit) -> bool:
        """Whether both change the same number."""
        if self.place == other.place:
            return True
        verbs = {self.verb, other.verb}
        if verbs == {"set"} or (self.is_course and other.is_course):
            return False
        if "add" in verbs and verbs & {"lesion", "clamp", "cut", "block", "scale"}:
            return False
        return self.meets(other) and bool(self._changes() & other._changes())

    def meets(self, other: Edit) -> bool:
        """Whether both are about the same row, and a channel in common."""
        apart = None not in (self.channel, other.channel) and self.channel != other.channel
        (one, at, mine), (two, there, theirs) = self._ends(), other._ends()
        from_one = one == two or ("" in (one, two) and None not in (one, two))
        return from_one and at == there and (mine == theirs or None in (mine, theirs)) and not apart

    def _ends(self) -> tuple[str | None, str, str | None]:
        """Return source ("": any; None: of a nucleus), target and receptor (None: any)."""
        path, _, synapse = self.row.partition(" ")
        source, arrow, target = path.rpartition("->")
        every = not synapse and self.verb in ("cut", "scale")
        return source if arrow or synapse else None, target, None if every else synapse

    def _changes(self) -> set[str]:
        """Return the fields of its row that it changes."""
        fields = {"add": self._given(), "set": [self.field]}.get(self.verb)
        if fields is None:
            return {VERBS[self.verb].changes or self.verb}
        return {SAME_NUMBER.get(name, name) for name in fields}

    def _given(self) -> list[str]:
        return re.findall(r"(\S+?)\s*=", str(self.value))


class Edits(tuple[str, ...]):
    """Edits of a circuit, one per line; ValueError if two of them change the same number."""

    def __new__(cls, lines: Iterable[str] = ()) -> Edits:
        """Return edits from their lines."""
        if isinstance(lines, str):
            raise InputError.of("edits", f'must be a list of lines, such as ["{lines}"]', lines)
        edits = super().__new__(cls, lines)
        for one, other in combinations(edits.parsed(), 2):
            if one.overlaps(other):
                raise overlapping(one, other)
        return edits

    @classmethod
    def __get_pydantic_core_schema__(
        cls, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        from pydantic_core import core_schema

        lines = core_schema.no_info_before_validator_function(_list, handler(tuple[str, ...]))
        return core_schema.no_info_after_validator_function(cls, lines)

    def parsed(self) -> list[Edit]:
        """Return the edits in the order in which they are applied."""
        return sorted(map(parsed, self), key=lambda edit: [*VERBS].index(edit.verb))

    def of(self, *verbs: str) -> list[Edit]:
        """Return the edits of some kinds, in the order in which they are applied."""
        return [edit for edit in self.parsed() if edit.verb in verbs]

    @property
    def compensates(self) -> bool:
        """Whether nuclei return to their resting rates."""
        return bool(self.of("compensate", "rebound"))

    def text(self) -> str:
        """Return the lines in the order in which the edits are applied."""
        return "; ".join(edit.text.strip() for edit in self.parsed())

    def notes(self) -> list[str]:
        """Return a note for each kind of edit that is easily confused with another."""
        return [note for verb, note in NOTES.items() if self.of(verb)]

    def replacing(self, lines: Iterable[str], without: Iterable[str] = ()) -> Edits:
        """Return the edits with further ones, which replace edits of the same target.

        ``without`` leaves out edits of the same target, whatever their value, and courses that are
        identical. InputError also if a line adds another course to a place that already has one,
        because it is unclear whether to replace it.
        """
        new = {edit.place: edit for edit in map(parsed, Edits(lines))}
        left_out = {parsed(line).place for line in without}
        kept = [edit for edit in map(parsed, self) if edit.place not in left_out]
        for old, edit in product(kept, new.values()):
            both = old.is_course and edit.is_course and old.meets(edit)
            if both and old.place != edit.place:
                raise overlapping(old, edit)
        replaced = [new.pop(edit.place, edit) for edit in kept]
        return Edits(edit.text for edit in (*replaced, *new.values()))


def _list(value: object) -> tuple[object, ...]:
    if not isinstance(value, (list, tuple)):
        must = 'must be a list of lines, such as edits = ["lesion STN 10%"]'
        raise InputError.of("edits", must, value)
    return tuple(value)


def overlapping(one: Edit, other: Edit) -> ValueError:
    """Return the error for two edits of the same number."""
    same = "edit the same number, so neither would be its value: keep one of them"
    return InputError(f"{one.text!r} and {other.text!r} {same}", "edits")


def parsed(line: str) -> Edit:
    """Parse a line as an edit."""
    if not isinstance(line, str):
        many = ": unpack it, edited(*lines)" if isinstance(line, (list, tuple)) else ""
        reason = f"an edit must be a text such as 'lesion STN 10%', got {shown(line)}{many}"
        raise InputError(reason, "edits", line)
    verb, _, rest = line.strip().partition(" ")
    if verb not in VERBS:
        known = f"{', '.join(VERBS)}, such as 'lesion STN 10%'"
        raise InputError(f"{shown(line)}: an edit must begin with one of {known}", "edits", line)
    kind, rest = VERBS[verb], rest.strip()
    if verb == "add":
        edit = _new_row(line, rest)
    elif verb == "set":
        edit = _new_value(line, rest)
    elif kind.of or kind.takes:
        edit = _numbered(line, verb, _tidied(rest).split())
    else:
        edit = Edit(line, verb) if f"{verb} {rest}".strip() == kind.example else None
    if edit is None:
        hint = "; a pathway is cut, as in 'cut GPe->STN 30%'" if "->" in rest else ""
        reason = f"{line!r}: {verb} is written as in {kind.example!r}{hint}"
        raise InputError(reason, "edits", line)
    return edit


def _new_row(line: str, rest: str) -> Edit | None:
    names = _tidied(rest).split()
    if not names or "=" in names[0]:
        return None
    names[0], channel = _channel_of(line, names[0])
    return Edit(line, "add", row_of(names), channel=channel, value=rest)


def _new_value(line: str, rest: str) -> Edit | None:
    match = SET.fullmatch(rest)
    row, _, field = _tidied(match[1]).partition(".") if match else ("", "", "")
    if not (match and row and field):
        return None
    quoted = re.fullmatch(r"(['\"])(.*)\1", match[2])
    return Edit(line, "set", row, field, value=quoted[2] if quoted else match[2])


def _numbered(line: str, verb: str, words: Sequence[str]) -> Edit | None:
    """Return an edit of the form VERB [ROW] [NUMBER]; None for another form."""
    kind = VERBS[verb]
    row, channel, left = "", None, [*words]
    if kind.of:
        of = PATHWAY if "->" in "".join(left[:1]) else NUCLEUS
        if not left or "=" in left[0] or kind.of not in (of, RECEPTOR):
            return None
        left[0], channel = _channel_of(line, left[0])
        row = row_of(left, kind.of == RECEPTOR)
        if kind.of == RECEPTOR and " " not in row:
            return None
    if not left and kind.takes == FRACTION:
        return Edit(line, verb, row, channel=channel, value=1.0)
    if len(left) != 1 or (channel is not None and not kind.changes):
        return None
    number, percent = left[0].removesuffix("%"), left[0].endswith("%")
    if percent and kind.takes != FRACTION:
        return None
    try:
        value = float(f"{number}e-2" if percent else number)
        value = int(value) if kind.takes == WHOLE_NUMBER and value == int(value) else value
    except (ValueError, OverflowError):
        return None
    if kind.takes == FRACTION and value > 1 and not percent:
        write = f"write {value:g}% or {value / 100:g}"
        raise InputError(f"{line!r}: a fraction is within 0..1: {write}", "edits")
    return Edit(line, verb, row, channel=channel, value=value)


def row_of(words: list[str], receptor: bool = False) -> str:
    """Take a row from words: a nucleus, or a pathway with its receptor, if one is given."""
    row = words.pop(0)
    named = words and (receptor or "->" in row) and NAME.fullmatch(words[0])
    return f"{row} {words.pop(0)}" if named else row


def _channel_of(line: str, name: str) -> tuple[str, int | None]:
    row, channel = place_of(name)
    if "[" in row:
        raise InputError(f"{line!r}: a channel is a number in brackets, such as GPe[0]", "edits")
    return row, channel


def _tidied(text: str) -> str:
    """Return the text without blanks around "->", "=" and "[" and before "%"."""
    return re.sub(r"\s+(?=%)", "", re.sub(r"\s*(->|=|\[)\s*", r"\1", text))
