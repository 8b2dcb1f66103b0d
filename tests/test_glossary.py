"""The glossary agrees with the code."""

import importlib
import re
from dataclasses import fields, is_dataclass

import pytest

from bgmodel.commands.table import COMMANDS
from bgmodel.conditions import Condition
from tests.helpers import ROOT, found

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
        held = found(owner)
        return hasattr(held, name) or name in getattr(held, "__annotations__", {})
    return True


def options(commands):
    """Yield the options of all commands, as typed."""
    for command in commands.values():
        kind = command[1] if isinstance(command, tuple) else command
        if is_dataclass(kind):
            names = [field.name for one in (kind, Condition) for field in fields(one)]
            yield from (f"--{name.replace('_', '-')}" for name in names)
        else:
            yield from options(kind)


@pytest.mark.parametrize("name", NAMES)
def test_a_name_in_code_that_the_glossary_mentions_exists(name):
    assert is_there(name)


def test_an_option_that_the_glossary_mentions_exists():
    assert set(re.findall(r"`(--[\w-]+)`", TEXT)) <= set(options(COMMANDS))


def test_every_entry_says_what_it_is_called_in_the_code():
    entries = [block for block in TEXT.split("\n\n") if block.startswith("**")]
    assert len(entries) == len(re.findall(r"^\*\*.+?\*\*: ", TEXT, re.MULTILINE)) > 50
    assert [e for e in entries if not re.search(r"^> .*\bcode\b", e, re.MULTILINE)] == []
