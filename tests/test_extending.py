"""The recipes of docs/extending.md, followed to the letter."""

import os
import re
import shlex
import shutil
import sys
from contextlib import chdir, redirect_stderr, redirect_stdout
from io import StringIO

import pytest
from sybil.document import Document
from sybil.parsers.markdown import CodeBlockParser

from bgmodel.cli import main
from tests.helpers import ROOT, program_run

TEXT = (ROOT / "docs/extending.md").read_text()
RECIPES = dict(
    section.split("\n", 1) for section in re.split(r"^## ", TEXT, flags=re.MULTILINE)[1:]
)


def blocks(text, language, path):
    """Return the code blocks of a text in one language."""
    path.write_text(text)
    parser = CodeBlockParser(language, lambda example: None)
    return [str(example.parsed) for example in Document.parse(str(path), parser).examples()]


def save(folder, text):
    """Save the blocks whose first line names a file."""
    for language in ("python", "toml"):
        for block in blocks(text, language, folder / "recipe.md"):
            name = block.splitlines()[0].removeprefix("# ")
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_text(block)


def ran(words, folder):
    """Run a command in a folder, `bgmodel` in this process; return status, stdout and stderr."""
    if words[0] == "bgmodel":
        with (
            chdir(folder),
            redirect_stdout(StringIO()) as printed,
            redirect_stderr(StringIO()) as told,
        ):
            status = main(words[1:])
        return status, printed.getvalue(), told.getvalue()
    where = os.pathsep.join([str(folder), str(ROOT), os.environ.get("PYTHONPATH", "")])
    program = [sys.executable] if words[0] == "python" else words[:1]
    settings = {"PYTHONPATH": where, "MPLBACKEND": "Agg", "BGMODEL_RECORDINGS": ""}
    done = program_run(*program, *words[1:], cwd=folder, env=os.environ | settings)
    return done.returncode, done.stdout, done.stderr


def follow(folder, text):
    """Run the commands, and compare what the recipe shows with what they print."""
    script = "\n".join(blocks(text, "console", folder / "recipe.md"))
    for part in script.split("$ ")[1:]:
        command, _, shown = part.partition("\n")
        status, printed, told = ran(shlex.split(command), folder)
        assert status == 0, f"{command}\n{printed}\n{told}"
        if shown.strip():
            assert printed == shown


@pytest.mark.parametrize("recipe", RECIPES)
def test_a_recipe_works_as_it_stands(recipe, tmp_path):
    if recipe == "A figure":
        shutil.copytree(ROOT / "figures", tmp_path / "figures", ignore=lambda *_: ["out", "fast"])
    save(tmp_path, RECIPES[recipe])
    follow(tmp_path, RECIPES[recipe])


def test_every_kind_of_thing_has_its_recipe():
    kinds = ("cell type", "transfer function", "engine", "circuit", "baseline model")
    kinds = (*kinds, "model of trials", "figure")
    assert list(RECIPES) == [f"A{'n' if kind[0] == 'e' else ''} {kind}" for kind in kinds]
