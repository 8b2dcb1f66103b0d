"""The version is defined in one place; all other mentions agree."""

import re
import tomllib

import bgmodel
from bgmodel.support.files import provenance
from tests.helpers import ROOT


def test_the_package_is_built_with_the_version_in_the_code():
    told = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert "version" not in told["project"]
    assert "version" in told["project"]["dynamic"]
    assert told["tool"]["setuptools"]["dynamic"]["version"]["attr"] == "bgmodel.version.__version__"


def test_results_carry_the_version_of_the_code_that_ran():
    assert provenance()["versions"]["bgmodel"] == bgmodel.__version__


def test_the_changelog_begins_with_this_version():
    newest = re.search(r"^## \[(.+?)\]", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert newest is not None
    assert newest[1] == bgmodel.__version__


def test_the_citation_names_this_version():
    assert f"\nversion: {bgmodel.__version__}\n" in (ROOT / "CITATION.cff").read_text()
