"""The stamp of a picture: the version, the code and the tables that it was drawn from.

A stamp is stored in the PNG file, so that a picture stored with the documentation can be compared
with the present code: the gallery says if its script (comments included), one of its result tables
or the default circuit has changed since.
"""

from __future__ import annotations

import ast
import hashlib
import json
import re
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

from PIL import Image

from bgmodel.support import __version__
from circuits.anatomy import DEFAULT, load_circuit
from circuits.declaration.table_writer import identity
from figures.rooms import FOLDER, ROOT

KEY = "bgmodel"
"""Name of the PNG text field that contains the stamp."""
IMPORTED = re.compile(r"^from figures\.(\w+)\.(\w+) import", re.MULTILINE)
"""Modules of a room; those that all rooms share change without changing a picture."""


@dataclass(frozen=True)
class Stamp:
    """What a picture was drawn from."""

    version: str
    """Version of bgmodel."""
    settings: str
    """The numbers of the run, as text: those of a full run, or of a coarse one."""
    sources: dict[str, str]
    """First characters of the SHA-256 of each file, by its path in the repository, and of the
    default circuit, by its name."""

    def text(self) -> str:
        """Return the stamp in its stored form."""
        return json.dumps(asdict(self), sort_keys=True)

    def changed(self) -> list[str]:
        """Return the sources that have changed, or are gone, since the picture was drawn."""
        return [name for name, digest in self.sources.items() if _digest(name) != digest]


def stamp_of(script: Path, inputs: Iterable[Path], settings: object) -> Stamp:
    """Return the stamp of a picture that is about to be drawn with the settings of a run.

    The modules of rooms that the script imports count as well, and the tables of rooms that it
    draws; intermediate tables are computed by the script itself.
    """
    script = script.resolve()
    modules = sorted(set(IMPORTED.findall(script.read_text(encoding="utf-8"))))
    files = [script, FOLDER / "style.mplstyle"]
    files += [FOLDER / room / f"{module}.py" for room, module in modules]
    tables = sorted(path.resolve() for path in inputs)
    files += [path for path in tables if path.is_relative_to(FOLDER) and path.suffix == ".csv"]
    names = [path.relative_to(ROOT).as_posix() for path in files if path.is_relative_to(ROOT)]
    sources = {name: _digest(name) for name in [*names, DEFAULT]}
    return Stamp(__version__, repr(settings), sources)


def read_stamp(picture: Path) -> Stamp | None:
    """Return the stamp of a PNG file, or None if it has none."""
    with Image.open(picture) as image:
        stored = image.info.get(KEY)
    return None if stored is None else Stamp(**json.loads(stored))


def outdated(picture: Path, settings: object) -> str:
    """Return a sentence if a PNG file is not what the present code draws in a full run, or ""."""
    stamp = read_stamp(picture)
    if stamp is None:
        return "It is not known which version drew this picture."
    changed = [f"`{name}`" for name in stamp.changed()]
    if stamp.settings != repr(settings):
        changed.append("the numbers of the run (another version, or a coarse run)")
    return f"Drawn by version {stamp.version}; different now: {', '.join(changed)}." * bool(changed)


def _digest(name: str) -> str:
    if name == DEFAULT:
        return str(identity(load_circuit(DEFAULT, 2))["sha256"])[:12]
    path = ROOT / name
    if not path.is_file():
        return "gone"
    content = _code(path) if path.suffix == ".py" else path.read_bytes()
    return hashlib.sha256(content).hexdigest()[:12]


def _code(script: Path) -> bytes:
    """Return the code of a script without comments and docstrings, which draw nothing."""
    tree = ast.parse(script.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(
            node
        ):
            node.body = node.body[1:] or [ast.Pass()]
    return ast.unparse(tree).encode()
