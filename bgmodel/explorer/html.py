"""Panels as HTML, in which names and sentences are text."""

from __future__ import annotations

import base64
from html import escape

from bgmodel.explorer.panels import CIRCUIT, Panel


def html_of(panel: Panel) -> str:
    """Return a panel as HTML: its figure or table, its words, and the circuit that it shows."""
    text = escape(panel.text)
    if panel.refused:
        body = f'<p class="refused">{text}</p>'
    else:
        figure = table = ""
        if panel.svg and panel.name != CIRCUIT:
            figure = f'<img src="{uri(panel.svg)}" alt="{text}">'
        if panel.html:
            table = f'<div class="scroll">{panel.html}</div>'
        if panel.name == CIRCUIT:
            table = f"<details><summary>All rows as tables</summary>{table}</details>"
        body = f"{figure}{table}<p>{text}</p>"
    save = (
        f'<a download="{panel.name}.svg" href="{uri(panel.svg)}">Save as SVG</a>'
        if panel.svg
        else ""
    )
    return (
        f'<div data-key="{panel.key}" data-circuit="{panel.digest}">{body}'
        f"<footer><span>Circuit {panel.digest[:8]}</span>{save}</footer></div>"
    )


def uri(svg: str) -> str:
    """Return a figure as an address that contains it."""
    head = '<?xml version="1.0" encoding="utf-8"?>\n'
    return f"data:image/svg+xml;base64,{base64.b64encode((head + svg).encode()).decode()}"
