"""Pages of results from their tables: python -m benchmarks.pages.

A page is a template, ``docs/results/NAME.md.j2``, and every number in it comes from a table in
``docs/tables``, which a score wrote with its parameters, seed, versions and the hash of its
circuits. ``tables()`` at the end of a template lists the tables that the page read, with what they
were made from; results measured with an older circuit are marked. The meaning of each column is in
``docs/tables/columns.toml``.
"""

from __future__ import annotations

import re
import tomllib
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import jinja2

from bgmodel.bootstrap import shown
from bgmodel.integrators.given import identity
from bgmodel.support.files import is_result, read_provenance, read_table, replacing
from circuits.anatomy import DEFAULT, load_circuit

DOCS = Path(__file__).parents[1] / "docs"
RESULTS = DOCS / "results"
"""Templates and pages."""
TABLES = DOCS / "tables"
"""Tables read by pages, under version control."""
KEY = "columns.toml"
"""The meaning of each column, in the folder of the tables."""
ENDING = ".md.j2"
PLACEHOLDER = re.compile(r"\{\{.*?\}\}|\{%.*?%\}|\{#.*?#\}", re.DOTALL)
NUMBER = re.compile(r"\[[-+\d., ]*\d, [-+\d., ]*\]|\d*\.\d+")
"""An interval or a decimal number."""


def templates(folder: Path = RESULTS) -> list[Path]:
    """Return the templates of pages."""
    return sorted(folder.glob(f"*{ENDING}"))


def page_of(template: Path) -> Path:
    """Return the path of the page of a template."""
    return template.with_name(template.name.removesuffix(".j2"))


def written_numbers(text: str) -> list[str]:
    """Return decimal numbers and intervals written literally in a text, outside placeholders."""
    return NUMBER.findall(PLACEHOLDER.sub("", text))


def rendered(template: Path, results: Path = TABLES) -> str:
    """Return the page of a template.

    Raises
    ------
    ValueError
        If a table is missing, can't be read, or lacks a value used by the template.
    """
    environment = jinja2.Environment(
        undefined=jinja2.StrictUndefined, keep_trailing_newline=True, trim_blocks=True
    )

    read: dict[str, Path] = {}

    def path(name: str) -> Path:
        read[name] = results / f"{name}.csv"
        if not is_result(read[name]):
            raise ValueError(f"{template.name} needs the table {name}: `make score` writes it")
        return read[name]

    def rows(name: str, /, **where: Any) -> list[dict[str, Any]]:
        every: list[dict[Any, Any]] = read_table(path(name)).to_dict("records")
        return [each for each in every if all(each.get(k) == v for k, v in where.items())]

    def row(name: str, /, **where: Any) -> dict[str, Any]:
        found = rows(name, **where)
        if len(found) != 1:
            raise ValueError(f"{template.name}: {len(found)} rows of {name} match {where}, not 1")
        return found[0]

    def tables(*more: str) -> str:
        origins: dict[str, list[str]] = defaultdict(list)
        for name in dict.fromkeys((*read, *more)):
            origins[said(read_provenance(path(name)))].append(name)
        listed = [
            f"- {', '.join(map(link, names))}: {origin}." for origin, names in origins.items()
        ]
        return "\n".join([*listed, "", f"[What each column means](../tables/{KEY})."])

    given = {"rows": rows, "row": row, "tables": tables, "percent": percent, "known": known}
    given["shown"] = shown
    try:
        made = environment.from_string(template.read_text(encoding="utf-8")).render(**given)
    except jinja2.UndefinedError as error:
        raise ValueError(
            f"{template.name} uses values that its tables do not contain ({error.message}): "
            "`make score` writes them again"
        ) from error
    return made


def link(table: str) -> str:
    """Return the link of a page to a table."""
    return f"[{table}](../tables/{table}.csv)"


def known(row: Mapping[str, Any], name: str, form: str) -> str:
    """Return a value of a row with its 95 % interval, in columns NAME, NAME_low and NAME_high."""
    return shown(row[name], row[f"{name}_low"], row[f"{name}_high"], form)


def percent(share: float, digits: int = 0) -> str:
    """Return a share in percent."""
    return f"{100 * share:z.{digits}f} %"


def columns(results: Path = TABLES) -> dict[tuple[str, str], list[str]]:
    """Return the tables that contain each column, by the column's name and meaning.

    A column without a description whose name is that of another one with ``_low`` or ``_high``
    appended is a bound of its 95 % interval, and is left out.

    Raises
    ------
    ValueError
        If a column has no description, or a description belongs to no column.
    """
    key = tomllib.loads((results / KEY).read_text(encoding="utf-8"))
    general = key.pop("columns")
    unused = {("columns", name) for name in general}
    unused |= {(table, name) for table, special in key.items() for name in special}
    found: dict[tuple[str, str], list[str]] = defaultdict(list)
    for path in sorted(results.glob("*.csv")):
        table, names = path.stem, list(read_table(path).columns)
        for name in names:
            place = table if name in key.get(table, {}) else "columns"
            bound = re.sub("_(low|high)$", "", name)
            if place == "columns" and bound != name and bound in names:
                continue
            if place == "columns" and name not in general:
                raise ValueError(f"{KEY} does not describe the column {name} of {table}")
            unused.discard((place, name))
            meaning = key[table][name] if place == table else general[name]
            found[name, meaning].append(table)
    if unused:
        raise ValueError(f"{KEY} describes columns that no table has: {sorted(unused)}")
    return dict(sorted(found.items(), key=lambda item: item[0][0].lower()))


def said(behind: dict[str, Any]) -> str:
    """Return the origin of a table as text, and whether its circuits are up to date."""
    parameters, seed = behind["parameters"], behind["seed"]
    text = "seeds in their files" if seed is None else f"seed {seed}"
    text += f", version {behind['versions']['bgmodel']}"
    trials = parameters.get("trials")
    if trials:
        many = trials if isinstance(trials, list) else [trials]
        text = f"{' to '.join(map(str, many))} trials, {text}"
    if parameters.get("fast"):
        text += ", coarse (`make score FAST=1`)"
    if "circuits" not in parameters:
        return f"{text}; **with what circuit is not known**"
    if not parameters["circuits"]:
        return text
    names = sorted({made["name"] for made in parameters["circuits"].values()})
    text += f", circuit {', '.join(names)}"
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


def main() -> None:
    """Write every page."""
    for template in templates():
        with replacing(page_of(template)) as partial:
            partial.write_text(rendered(template), encoding="utf-8")
        print(page_of(template))


if __name__ == "__main__":
    main()
