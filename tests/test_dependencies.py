"""What is imported is declared, and pinned."""

import ast
import re
import sys
import tomllib
from itertools import chain
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("bgmodel", "circuits", "figures", "benchmarks", "docs")
NAMES = {
    "PIL": "pillow", "cv2": "opencv-python-headless",
    "ssms": "ssm-simulators", "pydantic_core": "pydantic-core",
    "docstring_parser": "docstring-parser", "arviz_stats": "arviz-stats",
}  # fmt: skip
"""Distributions whose modules have another name."""
ELSEWHERE = {"hssm", "_notebooks"}
"""HSSM needs a separate environment; the other is a file of this folder."""


def imported():
    """Return the packages that are imported anywhere, with the first file that does so."""
    paths = {}
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
                if isinstance(node, ast.ImportFrom) and not node.level and node.module:
                    names = [node.module]
                for name in names:
                    paths.setdefault(name.partition(".")[0], path.relative_to(ROOT).as_posix())
    ours = {*FOLDERS, "tests", *sys.stdlib_module_names, *ELSEWHERE}
    return {name: path for name, path in paths.items() if name not in ours}


def declared():
    """Return the names of all distributions in pyproject.toml."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    rows = [*project["dependencies"], *chain(*project["optional-dependencies"].values())]
    return {re.match(r"[\w.-]+", row)[0].lower() for row in rows}


@pytest.mark.parametrize(("name", "path"), sorted(imported().items()))
def test_a_package_that_is_imported_is_declared_and_pinned(name, path):
    distribution = NAMES.get(name, name).lower()
    assert distribution in declared(), path
    pins = (ROOT / "constraints.txt").read_text(encoding="utf-8").lower().replace("_", "-")
    assert re.search(rf"^{re.escape(distribution)}==", pins, re.MULTILINE), path
