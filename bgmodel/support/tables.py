"""Tables of results to read: printed with all their columns, however wide the terminal."""

from __future__ import annotations

import shutil

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

    def __repr__(self) -> str:
        """Return the table as text, each line at most as wide as the terminal."""
        if len(self) > MOST_ROWS:
            return super().__repr__()
        return self.to_string(line_width=shutil.get_terminal_size(USUAL).columns)
