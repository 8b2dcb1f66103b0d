"""The glossary agrees with the code."""

import importlib
import re

import pytest

from bgmodel import cli
from tests.helpers import ROOT, imported

TEXT = (ROOT / "docs/glossary.md").read_text()
NAMES = sorted(set(re.findall(r"`((?:bgmodel|circuits)\.[\w.]+)`", TEXT)))


def is_there(dotted):
    """Whether a module, what it holds, or a field of a class has this name."""
    try:
        importlib.import_module(dotted)
    except ModuleNotFoundError:
        owner, _, name = dotted.rpartition(".")
        if not owner or not is_there(owner):
            return False
        held = imported(owner)
        return hasattr(held, name) or name in getattr(held, "__annotations__", {})
    return True


@pytest.mark.parametrize("name", NAMES)
def test_a_name_in_code_that_the_glossary_mentions_exists(name):
    assert is_there(name)


def test_an_option_that_the_glossary_mentions_exists():
    known = {
        name
        for _, app in cli.commands()
        for argument in app.assemble_argument_collection()
        for name in argument.names
    }
    assert set(re.findall(r"`(--[\w-]+)`", TEXT)) <= known


def test_every_entry_says_what_it_is_called_in_the_code():
    entries = [block for block in TEXT.split("\n\n") if block.startswith("**")]
    assert len(entries) == len(re.findall(r"^\*\*.+?\*\*: ", TEXT, re.MULTILINE)) > 50
    assert [e for e in entries if not re.search(r"^> .*\bcode\b", e, re.MULTILINE)] == []
