"""Rooms: one question, one folder, with what measures it, draws it, and the page that answers it.

A room ``figures/QUESTION`` holds ``measure_NAME.py`` (numbers into ``tables``), ``draw_NAME.py``
(figure ``figNAME``), ``page.md.j2``, and ``room.toml``: the question, the steps and captions of its
figures, and the meaning of the columns of its tables. ``tables/metadata.json`` says what each table
was made from. ``python -m figures measure|draw|page ROOM`` runs one or all of them.
"""

from __future__ import annotations

import json
import os
import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from bgmodel.support.files import provenance, read_table, replacing
from circuits.errors import InputError

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "figures"
OUT = Path(os.environ.get("BENCHMARKS_OUT") or ROOT / "benchmarks" / "out")
"""Folder for unfinished measurements: another one where the environment names it."""
METADATA = "metadata.json"
RECORDINGS = "recordings"
"""In the reads of a step: the folder of recorded taps, if there is one."""


@dataclass(frozen=True)
class Caption:
    """The caption of one figure in parts; MyST Markdown, without line breaks."""

    title: str
    """A few words."""
    question: str
    """The question that the figure answers, in a neuroscientist's words."""
    caption: str
    """Panels (``**a**``), marks, numbers of trials and intervals."""
    answer: str
    """The figure's answer to the question."""


@dataclass(frozen=True)
class Room:
    """The folder of a question."""

    folder: Path

    @property
    def name(self) -> str:
        """The name of the folder."""
        return self.folder.name

    @cached_property
    def about(self) -> dict[str, Any]:
        """What ``room.toml`` says."""
        return tomllib.loads((self.folder / "room.toml").read_text(encoding="utf-8"))

    @property
    def page(self) -> Path:
        """The template of its page."""
        return self.folder / "page.md.j2"

    def modules(self, kind: str) -> list[str]:
        """Return the names of its modules that measure or draw."""
        return sorted(path.stem for path in self.folder.glob(f"{kind}*.py"))

    def figures(self) -> list[str]:
        """Return the names of its figures."""
        return [f"fig{module.removeprefix('draw_')}" for module in self.modules("draw")]

    def tables(self) -> list[Path]:
        """Return the paths of its tables."""
        return sorted((self.folder / "tables").glob("*.csv"))

    def captions(self, numbers: dict[str, str]) -> dict[str, Caption]:
        """Return the caption of each figure, with numbers of a run filled in.

        InputError if a figure has no caption, or a caption no figure.
        """
        written = self.about.get("figures", {})
        for name in {*self.figures()} ^ {*written}:
            has = "a caption of no figure" if name in written else "no caption of the figure"
            raise InputError(f"{self.name}/room.toml has {has} {name}", "figures", name)
        parts = [field.name for field in fields(Caption)]
        return {
            name: Caption(*(_line(written[name][part], numbers) for part in parts))
            for name in written
        }

    def steps(self) -> Iterator[tuple[str, str, list[str], list[str]]]:
        """Yield module, step, what it reads and what it makes; a step ``draw`` makes the figure.

        What is read is a table of the room, by its file's name, or what another step made.
        """
        for module, step, reads, makes in self.about.get("steps", []):
            yield module, step, self._places(reads), makes
        for figure, about in self.about.get("figures", {}).items():
            yield f"draw_{figure.removeprefix('fig')}", "draw", self._places(about["reads"]), []

    def _places(self, reads: list[str]) -> list[str]:
        recorded = os.environ.get("BGMODEL_RECORDINGS", "")
        places = {RECORDINGS: os.path.abspath(recorded)} if recorded else {}
        places |= {path.name: str(path) for path in self.tables()}
        return [places.get(name, name) for name in reads if name != RECORDINGS or recorded]

    def columns(self) -> dict[str, dict[str, str]]:
        """Return the meaning of the columns of each table, by its name.

        A column without a meaning whose name is that of another one with ``_low`` or ``_high``
        appended is a bound of its 95 % interval, and is left out. InputError if another column has
        no meaning, or a meaning belongs to no column.
        """
        general, special = self.about.get("columns", {}), self.about.get("tables", {})
        unused = {("columns", name) for name in general}
        unused |= {(table, name) for table, names in special.items() for name in names}
        every: dict[str, dict[str, str]] = {}
        for path in self.tables():
            names = list(read_table(path).columns)
            specific = special.get(path.stem, {})
            every[path.stem] = {}
            for name in names:
                middle = re.sub("_(low|high)$", "", name)
                if name not in specific and middle != name and middle in names:
                    continue
                if name not in specific and name not in general:
                    what = f"{self.name}/room.toml does not describe the column {name}"
                    raise InputError(f"{what} of {path.stem}", "columns", name)
                unused.discard((path.stem if name in specific else "columns", name))
                every[path.stem][name] = specific.get(name) or general[name]
        if unused:
            what = f"{self.name}/room.toml describes columns that no table has"
            raise InputError(f"{what}: {sorted(unused)}", "columns", sorted(unused))
        return every

    def check(self, measured: bool = True) -> None:
        """Raise InputError if a caption, metadata or (once measured) a meaning is missing."""
        self.captions({})
        if measured:
            self.columns()
        known = read_metadata(self.folder / "tables")
        for name in {*known} ^ {path.stem for path in self.tables()}:
            says = "of a table that is not there" if name in known else "nothing of the table"
            raise InputError(f"{self.name}/tables/{METADATA} says {says}: {name}", "tables", name)


def rooms(folder: Path = FOLDER) -> list[Room]:
    """Return all rooms, by name."""
    return [Room(path.parent) for path in sorted(folder.glob("*/room.toml"))]


def table_path(name: str, folder: Path = FOLDER) -> Path:
    """Return the path of a table in any room; InputError if no room, or more than one, has it."""
    paths = [*folder.glob(f"*/tables/{name}.csv")]
    if len(paths) != 1:
        raise InputError(f"the table {name} is in {len(paths)} rooms, not in one", "table", name)
    return paths[0]


def read_metadata(folder: Path) -> dict[str, dict[str, Any]]:
    """Return the parameters, seed and versions of each table, by name; empty without a file."""
    path = folder / METADATA
    metadata: dict[str, dict[str, Any]] = json.loads(path.read_text()) if path.is_file() else {}
    return metadata


def origin(path: Path) -> dict[str, Any]:
    """Return the parameters, seed and versions that a table of a room was made from.

    InputError if its room does not say so.
    """
    entry = read_metadata(path.parent).get(path.stem)
    if entry is None:
        raise InputError(f"{METADATA} says nothing of the table {path.stem}", "table", path.stem)
    return entry


def write(rows: pd.DataFrame, path: Path, *, seed: int | None = None, **parameters: Any) -> Path:
    """Write a table of a room and its metadata, both or neither."""
    path.parent.mkdir(parents=True, exist_ok=True)
    known = read_metadata(path.parent) | {path.stem: provenance(seed, **parameters)}
    with replacing(path) as partial, replacing(path.with_name(METADATA)) as beside:
        rows.to_csv(partial, index=False)
        beside.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n")
    return path


def _line(text: str, numbers: dict[str, str]) -> str:
    return " ".join(text.split()).format_map(numbers) if numbers else " ".join(text.split())
