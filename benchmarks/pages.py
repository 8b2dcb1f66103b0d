"""Pages of results from their tables: python -m benchmarks.pages.

A page is a template, ``docs/NAME.md.j2``, and every number in it comes from a table in
``docs/results``, which a score wrote with its parameters, seed, versions and the hash of its
circuits. What was measured with another circuit than today's says so by itself.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jinja2

from bgmodel.files import read_provenance, read_table, replacing
from bgmodel.integrators.basal_ganglia import identity
from circuits.anatomy import circuit

DOCS = Path(__file__).parents[1] / "docs"
RESULTS = DOCS / "results"
"""Tables that pages read: they are kept with the code."""
ENDING = ".md.j2"
PLACEHOLDER = re.compile(r"\{\{.*?\}\}|\{%.*?%\}|\{#.*?#\}", re.DOTALL)
DECIMAL = re.compile(r"\d*\.\d+")


def templates(docs: Path = DOCS) -> list[Path]:
    """Return the templates of pages."""
    return sorted(docs.glob(f"*{ENDING}"))


def page_of(template: Path) -> Path:
    """Return the path of the page of a template."""
    return template.with_name(template.name.removesuffix(".j2"))


def written_numbers(text: str) -> list[str]:
    """Return the decimal numbers that a template states itself, outside its placeholders."""
    return DECIMAL.findall(PLACEHOLDER.sub("", text))


def rendered(template: Path, results: Path = RESULTS) -> str:
    """Return the page of a template.

    Raises
    ------
    ValueError
        If a table is not there or can't be read.
    jinja2.UndefinedError
        If a column is not there.
    """
    environment = jinja2.Environment(
        undefined=jinja2.StrictUndefined, keep_trailing_newline=True, trim_blocks=True
    )

    def rows(name: str) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = read_table(results / f"{name}.csv").to_dict("records")
        return found

    def measured(name: str) -> str:
        return said(read_provenance(results / f"{name}.csv"))

    text = template.read_text(encoding="utf-8")
    made: str = environment.from_string(text).render(rows=rows, measured=measured, percent=percent)
    return made


def percent(share: float, digits: int = 0) -> str:
    """Return a share in percent."""
    return f"{100 * share:.{digits}f} %"


def said(behind: dict[str, Any]) -> str:
    """Return the origin of a table as text, and whether its circuits are today's."""
    parameters, version = behind["parameters"], behind["versions"]["bgmodel"]
    text = f"seed {behind['seed']}, version {version}"
    trials = parameters.get("trials")
    if trials:
        text = f"{trials} trials, {text}"
    if not parameters.get("circuits"):
        return f"{text}; **with what circuit is not known**"
    others = sorted(_others(parameters["circuits"]))
    if others:
        text += f"; **measured with another circuit than today's**: {', '.join(others)}"
    return text


def _others(circuits: dict[str, Any]) -> Iterator[str]:
    for channels, made in circuits.items():
        if identity(circuit(made["name"], int(channels))) != made:
            yield f"{made['name']}, N = {channels} ({made['sha256'][:8]})"


def main() -> None:
    """Write every page."""
    for template in templates():
        with replacing(page_of(template)) as partial:
            partial.write_text(rendered(template), encoding="utf-8")
        print(page_of(template))


if __name__ == "__main__":
    main()
