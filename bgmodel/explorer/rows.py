"""Rows of a circuit as the explorer shows them, and the edits made by its fields."""

from __future__ import annotations

from dataclasses import fields

import pandas as pd

from bgmodel.explorer.state import State
from circuits.declaration.edits import VERBS, Edit
from circuits.declaration.row_edits import NAMES, OF_CELL
from circuits.declaration.rows import Population, Projection

EXAMPLES = {
    **{kind.example: f"{verb}: {kind.about}" for verb, kind in VERBS.items()},
    "add dopamine amount=0.2 to_ms=300": "course: more dopamine during part of each trial",
    "add STN amount=0.5 from_ms=100": "course: more input to a nucleus from a time on",
    "add D2[0] amount=-2 from_ms=200 to_ms=400": "course: light on one channel of a nucleus",
    "add urgency": "motif: OUT falls with time, as a criterion does",
    "add onset_transient": "motif: a burst of all cortex at the onset of the evidence",
}
"""Example edits and their effects."""
NEUTRAL = {"lesion": 0.0, "cut": 0.0, "scale": 1.0}
"""Verbs with a field for the chosen row, and the number at which there is no edit."""


def names(state: State) -> dict[str, list[str]]:
    """Return the names of nuclei and of pathways of the edited circuit."""
    circuit = state.circuit
    return {
        "Nuclei": [row.name for row in circuit.populations],
        "Pathways": [row.name for row in circuit.projections],
    }


def values(row: Population | Projection) -> dict[str, str]:
    """Return the fields of a row that edits can set, with their values as text."""
    record = {f.name: getattr(row, f.name) for f in fields(row) if f.name not in NAMES}
    cell = record.pop("cell", None)
    if cell is not None:
        record["cell"] = type(cell).__name__
        record |= {OF_CELL + f.name: getattr(cell, f.name) for f in fields(cell)}
    return {name: _text(value) for name, value in record.items()}


def _text(value: object) -> str:
    """Return a value in the notation of an edit."""
    if isinstance(value, tuple):
        return ",".join(map(_text, value))
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def table(state: State, name: str) -> pd.DataFrame:
    """Return the fields of a row as a table, with the control's values where they differ."""
    control = state.control
    before = values(control.row(name)) if name in control else {}
    rows = []
    for field, value in values(state.circuit.row(name)).items():
        old = before.get(field)
        if old != value or value not in ("", "0", "1", "False"):
            rows.append((field, value, "" if old == value else old or "none"))
    return pd.DataFrame(rows, columns=["Field", "Value", "Control"])


def amount(state: State, verb: str, name: str) -> float:
    """Return the size of the edit of a row by a verb: per cent lost, or a factor."""
    edit = _of(state, verb, name)
    if edit is None:
        return NEUTRAL[verb]
    return float(edit.value) * (1 if verb == "scale" else 100)


def with_amount(state: State, verb: str, name: str, number: float | None) -> State:
    """Return the state with a lesion, a cut or a scaling of a row.

    The neutral number, and None for an empty field, remove the edit.
    """
    if number is None or number == NEUTRAL[verb]:
        edit = _of(state, verb, name)
        return state if edit is None else state.without(edit.text)
    return state.edited(f"{verb} {name} {number:.12g}{'' if verb == 'scale' else '%'}")


def _of(state: State, verb: str, name: str) -> Edit | None:
    """Return the edit of a row, in all channels, by a verb."""
    edits = (edit for edit in state.edits.of(verb) if edit.row == name and edit.channel is None)
    return next(edits, None)


def dopamine(state: State) -> float:
    """Return the dopamine level set by an edit, or 1."""
    edits = state.edits.of("dopamine")
    return float(edits[0].value) if edits else 1.0


def with_dopamine(state: State, level: float | None) -> State:
    """Return the state at a dopamine level; 1 and None remove the edit."""
    if level is None or level == 1:
        return state.without(*(edit.text for edit in state.edits.of("dopamine")))
    return state.edited(f"dopamine {level:.12g}")
