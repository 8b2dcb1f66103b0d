"""Imports run one way, importing the package is cheap, and tests lie as what they test."""

import ast
import re
import sys
import tomllib
from functools import cache
from itertools import chain
from pathlib import Path

import pytest

from bgmodel.cli import COMMANDS
from tests.helpers import ROOT, program_run


def modules(package):
    for path in sorted((ROOT / package).rglob("*.py")):
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        yield name.removesuffix(".__init__"), path


@cache
def imports(path):
    return tuple(_imports(path))


def _imports(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name} uses a relative import"
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            yield from (n if n in known() else node.module for n in names)


@cache
def known():
    return {name for package in ("bgmodel", "circuits") for name, _ in modules(package)}


RUNS = ("bgmodel.integrators.basal_ganglia", "bgmodel")
"""The module that runs engines, and the front door, which names them."""


@pytest.mark.parametrize(("name", "path"), list(modules("bgmodel")))
def test_one_module_of_bgmodel_runs_engines(name, path):
    """The others read declarations where they live; of the engines, records and the registry."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            assert not any(alias.name.startswith("circuits.engines") for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and name not in RUNS:
            named = [alias.name for alias in node.names]
            assert node.module != "circuits" or "engines" not in named
            if node.module.startswith("circuits.engines"):
                assert node.module == "circuits.engines"
                assert "run" not in named, f"{name} runs engines"


def test_figures_import_from_the_packages_alone():
    for path in sorted((ROOT / "benchmarks").rglob("*.py")):
        assert not any(i.split(".")[0] == "tests" for i in imports(path)), path
    for path in sorted((ROOT / "figures").rglob("*.py")):
        assert not any(i.split(".")[0] in {"benchmarks", "tests"} for i in imports(path)), path


def test_every_package_is_shipped():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    shipped = set()
    for package, patterns in settings["package-data"].items():
        folder = ROOT.joinpath(*package.split("."))
        shipped |= {path for pattern in patterns for path in folder.glob(pattern)}
    held = {path for package in ("bgmodel", "circuits") for path in (ROOT / package).rglob("*")}
    code = {".py", ".pyc", ".nbi", ".nbc"}
    assert shipped == {path for path in held if path.is_file() and path.suffix not in code}
    every = chain(modules("bgmodel"), modules("circuits"))
    assert set(settings["packages"]) == {name for name, path in every if "__init__" in path.name}


HEAVY = {"torch", "brian2", "matplotlib", "numba", "cv2", "scipy", "tqdm", "platformdirs"}
TABLES = {"pandas", "pyarrow", "circuits.circuit"}


@pytest.mark.parametrize(
    ("code", "heavy"),
    [
        ("import bgmodel; dir(bgmodel)", HEAVY | TABLES | {"cyclopts"}),
        ("from bgmodel.cli import main; main(['--help'])", HEAVY | TABLES),
        ("from bgmodel.cli import main; main(['experiment'])", HEAVY),
        ("from bgmodel.cli import main; main(['circuit', 'show'])", HEAVY),
    ],
)
def test_heavy_packages_load_only_where_they_are_used(code, heavy):
    """A second at most: of that, the imports of scipy and Numba would be more than half."""
    code = f"import atexit, sys; atexit.register(lambda: print(*sys.modules)); {code}"
    done = program_run(sys.executable, "-c", code, check=True)
    *shown, loaded = done.stdout.splitlines()
    assert not heavy & set(loaded.split())
    assert "--help" not in code or all(name in "".join(shown) for name in COMMANDS)


FOREIGN = "import sys, types; sys.modules['circuits'] = types.ModuleType('circuits'); "
SENTENCE = "found a package named 'circuits' that is not part of bgmodel"


def test_a_foreign_package_called_circuits_is_named():
    done = program_run(sys.executable, "-c", FOREIGN + "import bgmodel")
    assert done.stderr.strip().splitlines()[-1].startswith(f"ImportError: {SENTENCE}")


def tail(path):
    return str(path.relative_to(ROOT / "tests"))


@pytest.mark.parametrize("path", sorted((ROOT / "tests").glob("*/**/test_*.py")), ids=tail)
def test_a_file_of_tests_in_a_folder_begins_with_the_name_of_its_module(path):
    """Or, in the folder of long checks, holds nothing else than those."""
    inside = Path(tail(path))
    long = re.search(r"^(@|pytestmark = )pytest\.mark\.validate", path.read_text(), re.MULTILINE)
    assert (inside.parts[0] == "validation") == bool(long)
    if inside.parts[0] != "validation":
        flat = inside.parts[0] in ("circuits", "figures")
        folder = (ROOT if flat else ROOT / "bgmodel") / inside.parent
        name = path.stem.removeprefix("test_")
        words = name.split("_")
        begins = ("_".join(words[:k]) for k in range(1, len(words) + 1))
        assert name == folder.name or any((folder / f"{each}.py").exists() for each in begins)
