"""Rows of a circuit as the explorer offers them, and the lines that edit them."""

from __future__ import annotations

from dataclasses import fields
from html import escape

from bgmodel.explorer.state import State
from circuits.declaration.edits import VERBS, Edit
from circuits.declaration.row_edits import NAMES, OF_CELL
from circuits.declaration.rows import Population, Projection

EXAMPLES = {
    **{f"{verb}: {kind.about}": kind.example for verb, kind in VERBS.items()},
    "course: dopamine is higher for a part of each trial": "add dopamine amount=0.2 to_ms=300",
    "course: a nucleus has more input from a time on": "add STN amount=0.5 from_ms=100",
    "course: light on one channel of a nucleus": "add D2[0] amount=-2 from_ms=200 to_ms=400",
    "motif: fast-spiking interneurons of the striatum": "add striatal_FSI",
}
"""Example lines of edits, by what they do."""
LOSS, FACTOR = "loss", "factor"
QUICK = {"lesion": LOSS, "cut": LOSS, "scale": FACTOR}
"""Verbs that have an input of their row, and what their number is."""


def names(state: State) -> dict[str, list[str]]:
    """Return the names of nuclei and of pathways of the edited circuit."""
    circuit = state.circuit
    return {
        "Nuclei": [row.name for row in circuit.populations],
        "Pathways": [row.name for row in circuit.projections],
    }


def values(row: Population | Projection) -> dict[str, str]:
    """Return the fields of a row that edits can set, with their values as text."""
    found = {f.name: getattr(row, f.name) for f in fields(row) if f.name not in NAMES}
    cell = found.pop("cell", None)
    if cell is not None:
        found["cell"] = type(cell).__name__
        found |= {OF_CELL + f.name: getattr(cell, f.name) for f in fields(cell)}
    return {name: _text(value) for name, value in found.items()}


def _text(value: object) -> str:
    """Return a value as an edit has it."""
    if isinstance(value, tuple):
        return ",".join(map(_text, value))
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def table(state: State, name: str) -> str:
    """Return the fields of a row as an HTML table, those that differ from the control marked."""
    row = state.circuit.row(name)
    known = state.control
    before = values(known.row(name)) if name in known else {}
    lines = []
    for field, value in values(row).items():
        old = before.get(field)
        if old == value and value in ("", "0", "1", "False"):
            continue
        mark = "" if old == value else f" <em>(control: {escape(old or 'none')})</em>"
        lines.append(f'<tr><th scope="row">{escape(field)}</th><td>{escape(value)}{mark}</td></tr>')
    return f"<table><tbody>{''.join(lines)}</tbody></table>"


def amount(state: State, verb: str, name: str) -> float:
    """Return the number of an edit of a row: per cent lost, or a factor."""
    edit = _of(state, verb, name)
    if edit is None:
        return 1.0 if QUICK[verb] == FACTOR else 0.0
    return float(edit.value) * (1 if QUICK[verb] == FACTOR else 100)


def with_amount(state: State, verb: str, name: str, number: float | None) -> State:
    """Return the state after a lesion, a cut or a scaling of a row.

    There is none at 0 %, at a factor of 1, or at None, an empty field.
    """
    factor = QUICK[verb] == FACTOR
    if number is None or number == (1 if factor else 0):
        edit = _of(state, verb, name)
        return state if edit is None else state.without(edit.text)
    return state.edited(f"{verb} {name} {number:.12g}{'' if factor else '%'}")


def _of(state: State, verb: str, name: str) -> Edit | None:
    """Return the edit of a row, in all channels, by a verb."""
    found = (edit for edit in state.edits.of(verb) if edit.row == name and edit.channel is None)
    return next(found, None)


def dopamine(state: State) -> float:
    """Return the level of dopamine that an edit sets, or 1."""
    found = state.edits.of("dopamine")
    return float(found[0].value) if found else 1.0


def with_dopamine(state: State, level: float | None) -> State:
    """Return the state at a level of dopamine; at 1, and at None, without an edit of it."""
    if level is None or level == 1:
        return state.without(*(edit.text for edit in state.edits.of("dopamine")))
    return state.edited(f"dopamine {level:.12g}")


def new_pathway(source: str, target: str, weight: float, delay_ms: float) -> str:
    """Return the line that adds a pathway."""
    return f"add {source}->{target} weight={weight:.12g} delay_ms={delay_ms:.12g}"
