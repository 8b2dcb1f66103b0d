"""Panels as records and as HTML, in which names and sentences are text."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

from bgmodel.deciding.measures import OF_DIFFUSION
from bgmodel.experiments.outcomes import PREDICTED, measured, predicted, unknown
from bgmodel.plots import labelled

if TYPE_CHECKING:
    from bgmodel.experiments.experiment import Outcome
    from bgmodel.explorer.state import State

TIMES, TRADEOFF, MEASURES, CIRCUIT, TRIAL = "times", "tradeoff", "measures", "circuit", "trial"
TITLES = {
    CIRCUIT: "Circuit",
    TIMES: "Decision times",
    TRADEOFF: "Speed and accuracy",
    MEASURES: "Behaviour",
    TRIAL: "One trial in spikes",
}
"""All panels and their titles, in the order in which a page shows them."""
RANKING = "ranking"
"""The panel that is computed on request."""
CONTROL, MANIPULATION = "Control", "Manipulation"
"""Headings of both conditions, as in the experiment's file."""


@dataclass(frozen=True)
class Panel:
    """The contents of one panel: a figure, a table, and the same in words for screen readers.

    ``key`` and ``digest`` are the hashes of its state and of the edited circuit; ``folded`` is a
    long table shown on request. If the run was refused, ``text`` is the error.
    """

    name: str
    key: str
    digest: str
    text: str
    svg: str = ""
    html: str = ""
    folded: str = ""
    warnings: tuple[str, ...] = ()
    refused: bool = False


def known(value: float, digits: int = 3, unit: str = "") -> str:
    """Return a number as text, or that it is unknown."""
    return f"{value:.{digits}f}{unit}" if value == value else "unknown"


def html_of(panel: Panel) -> str:
    """Return a panel as HTML: its figure or table, its words, and the circuit that it shows."""
    text = escape(panel.text)
    if panel.refused:
        body = f'<p class="refused">{text}</p>'
    else:
        # The drawing of the circuit is a component that can be clicked.
        drawn = panel.svg and panel.name != CIRCUIT
        figure = f'<img src="{uri(panel.svg)}" alt="{text}">' if drawn else ""
        table = f'<div class="wide">{panel.html}</div>' if panel.html else ""
        body = f"{figure}{table}<p>{text}</p>{_folded(panel)}"
    save = (
        f'<a download="{panel.name}.svg" href="{uri(panel.svg)}">Save as SVG</a>'
        if panel.svg
        else ""
    )
    # The ranking stays when the state changes.
    state = f'data-key="{panel.key}"' if panel.name in TITLES else ""
    return (
        f'<div {state} data-circuit="{panel.digest}">{body}'
        f"<footer><span>Circuit {panel.digest[:8]}</span>{save}</footer></div>"
    )


def _folded(panel: Panel) -> str:
    """Return a long table as HTML that can be unfolded, and scrolled with the keyboard."""
    if not panel.folded:
        return ""
    return (
        "<details><summary>All rows as tables</summary>"
        '<div class="scroll" tabindex="0" role="region" aria-label="All rows as tables">'
        f"{panel.folded}</div></details>"
    )


def uri(svg: str) -> str:
    """Return a figure as an address that contains it."""
    head = '<?xml version="1.0" encoding="utf-8"?>\n'
    return f"data:image/svg+xml;base64,{base64.b64encode((head + svg).encode()).decode()}"


def measures_of(outcome: Outcome, state: State) -> str:
    """Return the table of measures as HTML, with the numbers that the command prints.

    The rows are the same for all edits of a task; below them are reasons for unknown measures, and
    above them what the experiment predicted, if it did.
    """
    names = [CONTROL] if state.alike else [CONTROL, MANIPULATION, "Change"]
    two = outcome.given.evidence.hypotheses == 2
    rows = [
        (labelled(measure), measure, [two_lines(cell) for cell in cells[: len(names)]])
        for measure, cells in measured(outcome.measures, every=True)
        if two or measure not in OF_DIFFUSION
    ]
    why = unknown(outcome.experiment, outcome.measures)[: 1 if state.alike else None]
    notes = "".join(f'<p class="why">{escape(sentence)}</p>' for sentence in why)
    return _story(outcome) + table_of(("Measure", *names), rows) + notes


def _story(outcome: Outcome) -> str:
    """Return what an experiment is about, its predictions and their verdicts as HTML."""
    experiment = outcome.experiment
    if not experiment.predictions:
        return ""
    said = (experiment.published, experiment.source, experiment.note)
    told = zip(("Published", "Source", "In the model"), said, strict=True)
    about = "".join(f"<p>{label}: {escape(text.strip())}</p>" for label, text in told if text)
    found, reasons = predicted(experiment, outcome.measures)
    rows = [(asked, "", [escape(cell) for cell in cells]) for asked, *cells in found]
    left_open = "".join(f'<p class="why">{escape(sentence)}</p>' for sentence in reasons)
    head = tuple(name[0].upper() + name[1:] for name in PREDICTED)
    return f"{about}{table_of(head, rows)}{left_open}"


def table_of(head: Sequence[str], rows: Sequence[tuple[str, str, list[str]]]) -> str:
    """Return a table as HTML."""
    top = "".join(f'<th scope="col">{name}</th>' for name in head)
    lines = [
        f'<tr><th scope="row" title="{escape(title)}">{escape(label)}</th>'
        f"{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"
        for label, title, cells in rows
    ]
    return f"<table><thead><tr>{top}</tr></thead><tbody>{''.join(lines)}</tbody></table>"


def two_lines(cell: str) -> str:
    """Return a value and its interval as HTML, the interval below the value."""
    value, bracket, rest = cell.partition(" [")
    interval = f"<small> {escape(bracket[1:] + rest)}</small>" if bracket else ""
    return f"<strong>{escape(value)}</strong>{interval}"
