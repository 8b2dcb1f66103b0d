"""What a release states about itself: dates, dependencies, numbers of the paper."""

import ast
import re
import sys
import tomllib
from collections import Counter
from itertools import chain

import pytest
import yaml
from packaging.requirements import Requirement

import bgmodel
from bgmodel.support.files import provenance, read_table
from figures.rooms import table_path
from tests.cpu_times import LONG, SLOW, listed
from tests.helpers import ROOT
from tests.validation.faults import drawn, edited

CONDA = {"matplotlib": "matplotlib-base"}
"""Packages with another name on conda-forge."""
NEWER = {"brian2"}
"""Packages that the recipe needs in a newer version; it says why."""


def test_changelog_citation_build_and_results_have_one_version_and_date():
    newest = re.search(r"^## \[(.+?)\] - (\S+)$", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert newest[1] == bgmodel.__version__ == provenance()["versions"]["bgmodel"]
    citation = (ROOT / "CITATION.cff").read_text()
    assert f"\nversion: {newest[1]}\n" in citation
    assert f"\ndate-released: {newest[2]}\n" in citation
    told = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert "version" not in told["project"]
    assert told["tool"]["setuptools"]["dynamic"]["version"]["attr"] == "bgmodel.support.__version__"


def test_the_recipe_needs_what_the_core_needs():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    core = [Requirement(text) for text in project["dependencies"]]
    wanted = {CONDA.get(each.name, each.name): each.specifier for each in core}
    recipe = yaml.safe_load((ROOT / "conda-recipe" / "recipe.yaml").read_text())
    assert recipe["context"]["version"] == bgmodel.__version__
    runs = dict(text.split(maxsplit=1) for text in recipe["requirements"]["run"])
    assert set(runs) - {"python"} == set(wanted)
    same = set(wanted) - NEWER
    assert {n: runs[n] for n in same} == {n: str(wanted[n]) for n in same}


def sentences():
    """Yield what the paper says of each table, from the tables."""
    table = read_table(table_path("raw_decisions"))
    row = table.query(
        "evidence == \"Gaussian, d' 0.5, N = 4\" and engine == 'population' and accuracy == 0.9"
    ).iloc[0]
    yield f"in {row.agreement:.1%} of {row.trials:.0f} trials".replace("%", " %")
    yield f"({row.agreement_chance:.1%} expected by chance)".replace("%", " %")
    yield f"r = {row.pearson_r:.3f}, and the circuit took {row.extra_ms:.0f} ms longer"
    table = read_table(table_path("experiments_predictions"))
    of = Counter(table["outcome"])
    yield f"contain {len(table)} predictions"
    yield f"agreed with {of['agrees']} and disagreed with {of['disagrees']}"
    verb = "was" if of["left open"] == 1 else "were"
    lost = of["decides without evidence"]
    yield f"{of['left open']} {verb} left open, and {lost} concerned lesions"
    row = read_table(table_path("crosschecks_grid")).set_index("solution").loc["PyDDM"]
    yield f"at {row.points:.0f} combinations"
    yield f"was {row.z_mean_most:.1f} standard errors"
    inside = read_table(table_path("hssm_check"))["inside"]
    yield f"{inside.sum()} of {len(inside)} intervals"


def test_the_paper_gives_the_numbers_of_the_tables():
    text = " ".join((ROOT / "paper" / "paper.md").read_text().split())
    assert [each for each in sentences() if each not in text] == []


def test_the_paper_cites_what_its_bibliography_holds():
    text = (ROOT / "paper" / "paper.md").read_text()
    keys = re.findall(r"^@\w+\{(\w+),", (ROOT / "paper" / "paper.bib").read_text(), re.MULTILINE)
    assert len(keys) == len(set(keys))
    assert set(re.findall(r"@([a-z]+\d*)\b", text)) == set(keys)


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


@pytest.mark.parametrize("path", [SLOW, LONG], ids=lambda path: path.stem)
def test_every_listed_test_is_there(path):
    for name in listed(path):
        file, _, function = name.partition("::")
        text = (ROOT / file).read_text(encoding="utf-8")
        assert re.search(rf"^(def )?{re.escape(function.partition('[')[0])}\b", text, re.M), name


def test_no_test_is_in_both_lists():
    assert not listed(SLOW) & listed(LONG)


def test_a_place_written_anew_leaves_the_module_as_it_was_and_a_fault_does_not():
    """Of statements over many lines too: else no test would be seen to pass without the fault."""
    over_lines = 0
    for path, (_, place, new) in drawn(ROOT, 1, 300):
        source = (ROOT / path).read_text()
        was = ast.dump(ast.parse(source))
        assert ast.dump(ast.parse(edited(source, place, place))) == was
        assert ast.dump(ast.parse(edited(source, place, new))) != was
        over_lines += isinstance(place, ast.stmt) and "\n" in ast.unparse(place)
    assert over_lines
