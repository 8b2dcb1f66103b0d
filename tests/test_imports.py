"""Imports run one way, importing the package is cheap, and tests lie as what they test."""

import ast
import re
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest

from tests.helpers import ROOT

# Each module may import only from modules on lower levels.
LEVELS = [
    {
        "bgmodel.arrays",
        "bgmodel.facts",
        "bgmodel.memory",
        "bgmodel.ours",
        "bgmodel.places",
        "bgmodel.progress",
        "bgmodel.seeds",
        "bgmodel.version",
    },
    {"bgmodel.checks", "bgmodel.compiling", "bgmodel.readings"},
    {
        "bgmodel.comparison",
        "bgmodel.crossing",
        "bgmodel.data",
        "bgmodel.evidence",
        "bgmodel.experiments",
        "bgmodel.toml_files",
        "bgmodel.files",
        "bgmodel.fitting",
        "bgmodel.fitting.parameters",
        "bgmodel.fitting.passage",
        "bgmodel.fitting.responses",
        "bgmodel.fitting.weights",
        "bgmodel.integrators",
        "bgmodel.learning",
        "bgmodel.learning.policies",
        "bgmodel.plots",
        "bgmodel.readout",
        "bgmodel.sweeps",
        "bgmodel.tables",
        "bgmodel.theory",
        "bgmodel.web",
        "bgmodel.theory.empirical",
    },
    {
        "bgmodel.decision",
        "bgmodel.fitting.network",
        "bgmodel.tables.columns",
        "bgmodel.tables.shipped",
        "bgmodel.tables.text_files",
        "bgmodel.theory.first_passage",
    },
    {"bgmodel.calibration", "bgmodel.fitting.window", "bgmodel.tables.cautions"},
    {"bgmodel.fitting.pieces", "bgmodel.learning.reward", "bgmodel.tables.choices"},
    {
        "bgmodel.comparison.pairs",
        "bgmodel.fitting.sides",
        "bgmodel.integrators.sprt",
        "bgmodel.tables.exports",
        "bgmodel.tables.statistics",
        "bgmodel.tables.trials",
        "bgmodel.theory.sprt",
    },
    {
        "bgmodel.comparison.compare",
        "bgmodel.fitting.crossings",
        "bgmodel.fitting.design",
        "bgmodel.comparison.decoder",
        "bgmodel.integrators.basal_ganglia",
        "bgmodel.integrators.recursive",
        "bgmodel.integrators.rivals",
        "bgmodel.learning.reinforce",
        "bgmodel.tables.evidence",
    },
    {
        "bgmodel.comparison.cautions",
        "bgmodel.comparison.page",
        "bgmodel.fitting.control",
        "bgmodel.fitting.drawing",
        "bgmodel.fitting.stored",
        "bgmodel.fitting.algorithms",
        "bgmodel.comparison.steady",
        "bgmodel.edits",
        "bgmodel.experiments.measures",
        "bgmodel.learning.worlds",
        "bgmodel.intervals",
        "bgmodel.stimuli",
        "bgmodel.web.model",
    },
    {
        "bgmodel.experiments.predictions",
        "bgmodel.fitting.criteria",
        "bgmodel.fitting.optimum",
        "bgmodel.learning.gap",
        "bgmodel.web.page",
    },
    {
        "bgmodel.comparison.circuits",
        "bgmodel.fitting.circuit",
        "bgmodel.fitting.identify",
        "bgmodel.fitting.means",
        "bgmodel.fitting.slow",
    },
    {"bgmodel.fitting.simulation"},
    {
        "bgmodel.comparison.designed",
        "bgmodel.comparison.with_msprt",
        "bgmodel.demo",
        "bgmodel.dopamine",
        "bgmodel.fitting.misfit",
        "bgmodel.fitting.posterior",
        "bgmodel.fitting.predicted",
        "bgmodel.experiments.experiment",
        "bgmodel.sweeps.plan",
    },
    {
        "bgmodel.comparison.levels",
        "bgmodel.experiments.outcomes",
        "bgmodel.fitting.fit",
        "bgmodel.learning.level",
        "bgmodel.sweeps.shards",
    },
    {"bgmodel.fitting.settings", "bgmodel.sweeps.outcome"},
    {"bgmodel.sweeps.sweep"},
    {
        "bgmodel",
        "bgmodel.commands",
        "bgmodel.commands.checks",
        "bgmodel.commands.names",
        "bgmodel.commands.one_run",
    },
    {"bgmodel.commands.fitted"},
    {
        "bgmodel.commands.circuit",
        "bgmodel.commands.data",
        "bgmodel.commands.decisions",
        "bgmodel.commands.designed",
        "bgmodel.commands.figures",
        "bgmodel.commands.fits",
        "bgmodel.commands.page",
        "bgmodel.commands.taps",
        "bgmodel.commands.demo",
        "bgmodel.commands.experiments",
        "bgmodel.commands.sweeps",
    },
    {"bgmodel.commands.comparing", "bgmodel.commands.dopamine"},
    {"bgmodel.cli"},
    {"bgmodel.__main__"},
]
TACTILE_MAY = {
    "bgmodel.arrays",
    "bgmodel.checks",
    "bgmodel.compiling",
    "bgmodel.evidence",
    "bgmodel.files",
    "bgmodel.seeds",
    "bgmodel.data",
}


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


def level(name):
    return next((i for i, names in enumerate(LEVELS) if name in names), None)


@pytest.mark.parametrize(("name", "path"), list(modules("bgmodel")))
def test_bgmodel_imports_downwards_only(name, path):
    for imported in imports(path):
        root = imported.split(".")[0]
        assert root != "figures"
        if root != "bgmodel":
            continue
        if name.startswith("bgmodel.tactile"):
            assert imported.startswith("bgmodel.tactile") or imported in TACTILE_MAY, imported
        elif imported.startswith("bgmodel.tactile"):
            assert level(name) >= level("bgmodel.stimuli"), f"{name} imports {imported}"
        else:
            assert level(name) is not None, f"{name} has no level"
            assert level(imported) < level(name), f"{name} imports {imported}"


@pytest.mark.parametrize(("name", "path"), list(modules("bgmodel")))
def test_one_module_of_bgmodel_runs_engines(name, path):
    """The others read declarations where they live; of the engines, names in capitals."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            assert not any(alias.name.startswith("circuits.engines") for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and name != "bgmodel.integrators.basal_ganglia":
            named = [alias.name for alias in node.names]
            assert node.module != "circuits" or "engines" not in named
            if node.module.startswith("circuits.engines"):
                assert node.module == "circuits.engines"
                assert all(n.isupper() for n in named), f"{name} imports {named}"


@pytest.mark.parametrize(("name", "path"), list(modules("circuits")))
def test_circuits_know_nothing_of_bgmodel(name, path):
    assert not any(i.split(".")[0] in {"bgmodel", "figures", "torch"} for i in imports(path))


def test_benchmarks_and_figures_import_from_the_packages_alone():
    """What both need is science, and lives in bgmodel."""
    for path in sorted((ROOT / "benchmarks").rglob("*.py")):
        assert not any(i.split(".")[0] in {"figures", "tests"} for i in imports(path)), path
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
    found = {
        n for p in ("bgmodel", "circuits") for n, path in modules(p) if "__init__" in path.name
    }
    assert set(settings["packages"]) == found


HEAVY = {"torch", "brian2", "matplotlib", "numba", "cv2", "scipy", "tqdm", "platformdirs"}
HELP = """
import contextlib, sys, bgmodel.cli
with contextlib.suppress(SystemExit):
    bgmodel.cli.main(["--help"])
"""
SHOW = "import sys, bgmodel.cli\nbgmodel.cli.main(['circuit', 'show'])"


@pytest.mark.parametrize(
    ("code", "heavy"),
    [
        ("import sys, bgmodel", HEAVY | {"pandas", "pyarrow", "tyro", "circuits.spec"}),
        (HELP, HEAVY | {"pandas", "pyarrow", "circuits.spec"}),
        (SHOW, HEAVY),
    ],
    ids=["import bgmodel", "bgmodel --help", "bgmodel circuit show"],
)
def test_heavy_packages_load_only_where_they_are_used(code, heavy):
    code += "\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not heavy & set(done.stdout.splitlines()[-1].split())


def test_circuits_is_ours():
    import circuits

    assert Path(circuits.__file__).parent == ROOT / "circuits"


FOREIGN = "import sys, types; sys.modules['circuits'] = types.ModuleType('circuits'); "
SENTENCE = "the package 'circuits' that was found is not bgmodel's"


@pytest.mark.parametrize("command", ["'circuit', 'show'", "'circuit', 'run', 'a.csv'"])
def test_a_foreign_package_called_circuits_gets_one_clear_sentence(command):
    code = FOREIGN + f"from bgmodel.cli import main; sys.exit(main([{command}]))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith(f"bgmodel: {SENTENCE}")
    assert len(done.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize("module", ["integrators.basal_ganglia", "comparison.circuits"])
def test_a_module_on_a_foreign_package_called_circuits_says_so(module):
    code = FOREIGN + f"import bgmodel.{module}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.strip().splitlines()[-1].startswith(f"ImportError: {SENTENCE}")


def tail(path):
    return str(path.relative_to(ROOT / "tests"))


@pytest.mark.parametrize("path", sorted((ROOT / "tests").glob("*/**/test_*.py")), ids=tail)
def test_a_file_of_tests_in_a_folder_has_the_name_of_its_module(path):
    """Or, in the folder of long checks, holds nothing else than those."""
    inside = Path(tail(path))
    long = re.search(r"^(@|pytestmark = )pytest\.mark\.validate", path.read_text(), re.MULTILINE)
    assert (inside.parts[0] == "validation") == bool(long)
    if inside.parts[0] != "validation":
        folder = (ROOT if inside.parts[0] == "circuits" else ROOT / "bgmodel") / inside.parent
        name = path.stem.removeprefix("test_")
        assert name == folder.name or (folder / f"{name}.py").exists()
