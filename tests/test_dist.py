"""What is released: every file of the packages, and commands that there are (`make dist` tries)."""

import pytest

from bgmodel.cli import parsed
from tests import dist


@pytest.mark.parametrize("command", dist.COMMANDS[1:])
def test_what_tries_a_release_is_a_command(command):
    parsed(command.split())


def test_a_file_that_an_archive_lacks_is_named():
    assert dist.absent(["a.py", "x/b.toml"], ["a.py", "c.js"]) == ["c.js"]
