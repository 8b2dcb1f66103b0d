"""Tables of results to read: printed with all their columns, however wide the terminal."""

from __future__ import annotations

import shutil
from html import escape

import pandas as pd

MOST_ROWS = 60
"""Rows up to which a table is printed whole, as in pandas."""
USUAL = (100, 24)
"""Columns and lines of an output that is no terminal."""


class Readable(pd.DataFrame):
    """A DataFrame that prints wide tables in parts; pandas would hide their middle columns."""

    @property
    def _constructor(self) -> type[Readable]:
        """The class of tables made from this one."""
        return Readable

    def with_note(self, text: str) -> Readable:
        """Return it with a text that is printed below."""
        noted = self.copy()
        noted.attrs["note"] = text
        return noted

    def __repr__(self) -> str:
        """Return the table as text, each line at most as wide as the terminal."""
        if len(self) > MOST_ROWS:
            return super().__repr__()
        text, note = self.to_string(line_width=shutil.get_terminal_size(USUAL).columns), self.attrs
        return f"{text}\n{note['note']}" if note.get("note") else text

    def _repr_html_(self) -> str | None:
        """Return the table for a notebook."""
        table: str | None = super()._repr_html_()  # type: ignore[misc]  # not in the stubs
        note = escape(self.attrs.get("note", ""))
        return f"{table}<pre>{note}</pre>" if table and note else table
