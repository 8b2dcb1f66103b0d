"""Short representations of records: a line for ``repr``, a table for notebooks."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt


class Facts:
    """Base of records that hold arrays: readable when printed, and saved whole."""

    def save(self, path: str | Path, *, force: bool = False) -> Path:
        """Write the record to an .npz file, which ``bg.load`` reads; see ``saved.save``."""
        from bgmodel.support.saved import save

        return save(self, path, force=force)

    def facts(self) -> dict[str, str]:
        """Return the main facts of a record by name: shapes, units, a few means."""
        raise NotImplementedError

    def __repr__(self) -> str:
        """Return the facts in one line."""
        text = ", ".join(f"{name} {value}" for name, value in self.facts().items())
        return f"{type(self).__name__}({text})"

    def _repr_html_(self) -> str:
        """Return the facts as a table, for a notebook."""
        rows = "".join(
            f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>"
            for name, value in self.facts().items()
        )
        return f"<table><caption>{type(self).__name__}</caption>{rows}</table>"


def span(values: npt.ArrayLike, form: str = ".3g") -> str:
    """Return the lowest and the highest of some numbers as text, ignoring NaN."""
    array = np.asarray(values, dtype=np.float64)
    known = array[np.isfinite(array)]
    if not known.size:
        return "unknown"
    low, high = f"{known.min():{form}}", f"{known.max():{form}}"
    return low if low == high else f"{low} to {high}"
