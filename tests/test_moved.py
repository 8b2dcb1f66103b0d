"""An old name answers with the new one."""

import importlib
import re
import subprocess
import sys

import pytest

import bgmodel.moved
import circuits.moved
from tests.helpers import ROOT, found

CHANGELOG = ROOT / "CHANGELOG.md"
MOVED = bgmodel.moved.MOVED | circuits.moved.MOVED


@pytest.mark.parametrize("old", MOVED)
def test_importing_an_old_name_raises_one_sentence_with_the_new_one(old):
    sentence = re.escape(f"{old} is now {MOVED[old]}")
    module, _, name = old.rpartition(".")
    with pytest.raises(ImportError, match=f"^{sentence}$"):
        exec(f"from {module} import {name}")
    if found(module).__spec__.submodule_search_locations is not None:
        with pytest.raises(ImportError, match=f"^{sentence}$"):
            importlib.import_module(old)


@pytest.mark.parametrize("old", MOVED)
def test_the_new_name_is_there(old):
    for new in re.findall(r"(?:bgmodel|circuits)\.[\w.]*\w", MOVED[old]):
        assert found(new) is not None


def test_the_changelog_lists_every_old_name():
    text = CHANGELOG.read_text()
    assert [old for old in MOVED if f"`{old}`" not in text] == []


def test_circuits_tell_their_old_names_without_bgmodel():
    code = "import circuits.spiking"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.endswith("circuits.spiking is now circuits.engines.brian2.run\n")


def test_a_name_that_never_was_is_no_old_name():
    with pytest.raises(ImportError, match="cannot import name 'nothing'"):
        from bgmodel.theory import nothing  # noqa: F401
    with pytest.raises(ModuleNotFoundError, match=r"No module named .circuits\.nothing."):
        importlib.import_module("circuits.nothing")
    assert not hasattr(importlib.import_module("bgmodel.learning"), "nothing")


def test_a_module_answers_for_the_names_it_held():
    code = "from circuits.moved import tell\n"
    code += "tell({'bgmodel.dopamine.spring': 'bgmodel.dopamine.summer'})\n"
    code += "from bgmodel.dopamine import criterion\nfrom bgmodel.dopamine import spring"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.endswith("bgmodel.dopamine.spring is now bgmodel.dopamine.summer\n")
