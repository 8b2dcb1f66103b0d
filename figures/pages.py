"""Pages of results from their tables.

A page is a template, ``figures/QUESTION/page.md.j2``, and every number in it comes from a table of
a room. ``tables()`` at the end of a template lists the tables that the page read, with what they
were made from; results measured with an older circuit are marked.
"""

from __future__ import annotations

import os
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import jinja2

from bgmodel.bootstrap import shown
from bgmodel.support.files import read_table, replacing
from bgmodel.support.references import cited
from circuits.anatomy import DEFAULT, load_circuit
from circuits.declaration.table_writer import identity
from figures.rooms import FOLDER, ROOT, origin, rooms, table_path

RESULTS = ROOT / "docs" / "results"
"""Where pages are written."""
PLACEHOLDER = re.compile(r"\{\{.*?\}\}|\{%.*?%\}|\{#.*?#\}", re.DOTALL)
NUMBER = re.compile(r"\[[-+\d., ]*\d, [-+\d., ]*\]|\d*\.\d+")
"""An interval or a decimal number."""


def templates() -> list[Path]:
    """Return the templates of pages: those of rooms, and the index."""
    return [FOLDER / "index.md.j2", *(room.page for room in rooms() if room.page.is_file())]


def page_of(template: Path) -> Path:
    """Return the path of the page of a template."""
    name = "index" if template.name.startswith("index") else template.parent.name
    return RESULTS / f"{name}.md"


def written_numbers(text: str) -> list[str]:
    """Return decimal numbers and intervals written literally in a text, outside placeholders."""
    return NUMBER.findall(PLACEHOLDER.sub("", text))


def rendered(template: Path, place: Callable[[str], Path] = table_path) -> str:
    """Return the page of a template; ``place`` finds a table by its name.

    ValueError if a table is missing, can't be read, or lacks a value used by the template.
    """
    environment = jinja2.Environment(
        undefined=jinja2.StrictUndefined, keep_trailing_newline=True, trim_blocks=True
    )

    read: dict[str, Path] = {}

    def path(name: str) -> Path:
        read[name] = place(name)
        origin(read[name])
        return read[name]

    def rows(name: str, /, **where: Any) -> list[dict[str, Any]]:
        every: list[dict[Any, Any]] = read_table(path(name)).to_dict("records")
        return [each for each in every if all(each.get(k) == v for k, v in where.items())]

    def row(name: str, /, **where: Any) -> dict[str, Any]:
        matches = rows(name, **where)
        if len(matches) != 1:
            raise ValueError(f"{template.name}: {len(matches)} rows of {name} match {where}, not 1")
        return matches[0]

    def tables(*more: str) -> str:
        origins: dict[str, list[str]] = defaultdict(list)
        for name in dict.fromkeys((*read, *more)):
            origins[said(origin(path(name)))].append(name)
        lines = [
            f"- {', '.join(link(read[name]) for name in names)}: {made}."
            for made, names in origins.items()
        ]
        homes = dict.fromkeys(path.parents[1] for path in read.values())
        keys = ", ".join(f"[{home.name}]({_from_page(home / 'room.toml')})" for home in homes)
        return "\n".join([*lines, "", f"What each column means: {keys}."])

    functions = {"rows": rows, "row": row, "tables": tables, "percent": percent, "known": known}
    functions |= {"shown": shown, "sources": sources}
    try:
        made = environment.from_string(template.read_text(encoding="utf-8")).render(**functions)
    except jinja2.UndefinedError as error:
        raise ValueError(
            f"{template.name} uses values that its tables do not contain ({error.message}): "
            "`make score` writes them again"
        ) from error
    return made


def link(path: Path) -> str:
    """Return the link of a page to a table."""
    return f"[{path.stem}]({_from_page(path)})"


def _from_page(path: Path) -> str:
    return Path(os.path.relpath(path, RESULTS)).as_posix()


def sources(texts: Iterable[str]) -> str:
    """Return the references that texts cite, each with a link to its DOI if one is known."""
    known = ((one, f"[{one.short}]({one.link})") for one in cited(texts))
    return "; ".join(linked if one.link else f"{one.short}, {one.place}" for one, linked in known)


def known(row: Mapping[str, Any], name: str, form: str) -> str:
    """Return a value of a row with its 95 % interval, in columns NAME, NAME_low and NAME_high."""
    return shown(row[name], row[f"{name}_low"], row[f"{name}_high"], form)


def percent(share: float, digits: int = 0) -> str:
    """Return a share in percent."""
    return f"{100 * share:z.{digits}f} %"


def said(behind: dict[str, Any]) -> str:
    """Return the origin of a table as text, and whether its circuits are up to date."""
    parameters, seed = behind["parameters"], behind["seed"]
    text = "seeds in their files" if seed is None else f"seed {seed}"
    text += f", version {behind['versions']['bgmodel']}"
    trials = parameters.get("trials")
    if trials not in (None, 1):
        many = trials if isinstance(trials, list) else [trials]
        text = f"{' to '.join(map(str, many))} trials, {text}"
    if parameters.get("fast"):
        text += ", coarse (`make score FAST=1`)"
    if "circuits" not in parameters:
        return f"{text}; **with what circuit is not known**"
    if not parameters["circuits"]:
        return text
    names = sorted({made["name"] for made in parameters["circuits"].values()})
    word = "circuit" if len(names) == 1 else "circuits"
    text += f", {word} {', '.join(names)}"
    if DEFAULT not in names:
        text += f" (not the default, {DEFAULT})"
    others = sorted(_others(parameters["circuits"]))
    if others:
        text += f"; **measured with another circuit than today's**: {', '.join(others)}"
    return text


def _others(circuits: dict[str, Any]) -> Iterator[str]:
    for key, made in circuits.items():
        channels = key.split()[-1]
        if identity(load_circuit(made["name"], int(channels))) != made:
            yield f"{made['name']}, N = {channels} ({made['sha256'][:8]})"


def write_page(template: Path, folder: Path = FOLDER, results: Path = RESULTS) -> Path:
    """Write the page of a template, if the tables of the rooms have all that it names."""
    text = rendered(template, lambda name: table_path(name, folder))
    page = results / page_of(template).name
    with replacing(page) as partial:
        partial.write_text(text, encoding="utf-8")
    return page
