"""The page as one HTML file: no server, no net."""

from __future__ import annotations

import json
from importlib.resources import files as resources
from pathlib import Path

from bgmodel.support.files import replacing
from bgmodel.web.model import tables


def page(circuit: str | Path) -> str:
    """Return the page of a circuit, a table's name or file, as HTML.

    Raises
    ------
    ValueError
        If there is no such circuit, or the page cannot show it: see ``model.check_shown``.
    """
    own = resources("bgmodel.web")
    parts = {name: (own / name).read_text(encoding="utf-8") for name in ("model.js", "page.js")}
    parts["tables"] = json.dumps(tables(circuit)).replace("</", "<\\/")
    text = (own / "page.html").read_text(encoding="utf-8")
    for place, name in (("MODEL", "model.js"), ("PAGE", "page.js"), ("TABLES", "tables")):
        text = text.replace(f"/*{place}*/", parts[name])
    return text


def write_page(circuit: str | Path, path: Path) -> None:
    """Write the page, whole or not at all."""
    text = page(circuit)
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")
