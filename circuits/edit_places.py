"""Where an edit of a row acts, and whether two edits act on the same number."""

from __future__ import annotations

import re
from typing import NamedTuple

SETS = {
    "without": "intact",
    "cut": "intact",
    "scale": "weight",
    "intact_by_channel": "intact",
    "replaced": "intact",
    "factors": "weight",
}
"""Kinds of edits and fields of rows, and the field that they change in effect."""
COURSE = "course"
"""What a new row sets that has an amount: several courses of one nucleus add up."""


class RowEdit(NamedTuple):
    """One of several edits, in the words of the user."""

    kind: str
    text: str

    @property
    def place(self) -> tuple[str, str, str]:
        """Where it edits: two edits of one place are the same edit with another value."""
        head = tidied(self.text).partition("=")[0]
        if self.kind == "add":
            name, *_ = head.split() or [""]
            return (COURSE, name, self.text) if self.of_course else ("add", name, "")
        if self.kind in ("without", "cut", "scale"):
            name, channel = channel_of(head, "GPe[0]")
            return self.kind, name.strip(), "" if channel is None else str(channel)
        row, _, field = head.partition(".")
        return self.kind, row.strip(), field.strip()

    @property
    def of_course(self) -> bool:
        """Whether it adds a course, of which one nucleus may have several."""
        return self.kind == "add" and "amount" in self._given()

    @property
    def sets(self) -> set[tuple[str, str, str]]:
        """The numbers that it sets: row, field and channel; no channel means all of them."""
        kind, row, part = self.place
        if kind in ("without", "cut", "scale"):
            return {(row, SETS[kind], part)}
        names = {"add": self._given(), "change": [part]}.get(kind, [kind])
        return {(row, SETS.get(name, name), "") for name in names}

    def overlaps(self, other: RowEdit) -> bool:
        """Whether both set one number in different ways."""
        if self.kind == other.kind == "change":
            return False
        return any(
            a[:2] == b[:2] and (a[2] == b[2] or not (a[2] and b[2]))
            for a in self.sets
            for b in other.sets
        )

    def _given(self) -> list[str]:
        """Return the fields that a new row gives."""
        return re.findall(r"(\S+)=", tidied(self.text))


def overlapping(one: RowEdit, other: RowEdit) -> ValueError:
    """Return the error for two edits of one number."""
    return ValueError(
        f"{one.text!r} and {other.text!r} edit the same number, so neither would be its value: "
        "keep one of them"
    )


def tidied(edit: str) -> str:
    """Return an edit without blanks around "->", "=" and "["."""
    return re.sub(r"\s*(->|=|\[)\s*", r"\1", edit.strip())


def channel_of(name: str, example: str) -> tuple[str, int | None]:
    """Split "name[channel]"; without brackets it is every channel.

    Raises
    ------
    ValueError
        If the text in brackets is not a number; the message has an example.
    """
    path, bracket, rest = name.partition("[")
    if not bracket:
        return path, None
    number = rest.removesuffix("]")
    if number == rest or not number.isdecimal():
        raise ValueError(f'a channel is a number in brackets, as "{example}", got {name!r}')
    return path, int(number)
