"""What is released: every file of the packages, and commands that there are (`make dist` tries)."""

import tomllib
from pathlib import PurePath

import pytest

from bgmodel.cli import parsed
from tests import dist
from tests.helpers import ROOT


def test_every_file_of_the_packages_is_named_as_code_or_as_data():
    told = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    patterns = {name.replace(".", "/"): endings for name, endings in told["package-data"].items()}
    folders = {name.replace(".", "/") for name in told["packages"]}
    for name in dist.tracked():
        path = PurePath(name)
        code = path.suffix == ".py" and str(path.parent) in folders
        data = any(
            path.is_relative_to(folder) and path.relative_to(folder).match(pattern)
            for folder, endings in patterns.items()
            for pattern in endings
        )
        assert code or data, f"{name} would not be in the wheel"


@pytest.mark.parametrize("command", dist.COMMANDS[1:])
def test_what_tries_a_release_is_a_command(command):
    parsed(command.split())


def test_a_file_that_an_archive_lacks_is_named():
    assert dist.absent(["a.py", "x/b.toml"], ["a.py", "c.js"]) == ["c.js"]
