"""The recipes of docs/extending.md, followed to the letter."""

import os
import re
import shlex
import shutil
import subprocess
import sys

import pytest
from sybil.document import Document
from sybil.parsers.markdown import CodeBlockParser

from tests.helpers import ROOT

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


def follow(folder, text):
    """Run the commands, and compare what the recipe shows with what they print."""
    script = "\n".join(blocks(text, "console", folder / "recipe.md"))
    where = os.pathsep.join([str(folder), str(ROOT), os.environ.get("PYTHONPATH", "")])
    for part in script.split("$ ")[1:]:
        command, _, shown = part.partition("\n")
        words = shlex.split(command)
        programs = {"python": [sys.executable], "bgmodel": [sys.executable, "-m", "bgmodel"]}
        done = subprocess.run(
            [*programs.get(words[0], words[:1]), *words[1:]],
            cwd=folder,
            env=os.environ | {"PYTHONPATH": where, "MPLBACKEND": "Agg"},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
        if shown.strip():
            assert done.stdout == shown


@pytest.mark.parametrize("recipe", RECIPES)
def test_a_recipe_works_as_it_stands(recipe, tmp_path):
    if recipe == "A figure":
        shutil.copytree(ROOT / "figures", tmp_path / "figures", ignore=lambda *_: ["out", "fast"])
    save(tmp_path, RECIPES[recipe])
    follow(tmp_path, RECIPES[recipe])


def test_every_kind_of_thing_has_its_recipe():
    kinds = ("law of cells", "transfer", "table", "rival", "task", "experiment", "figure")
    assert list(RECIPES) == [f"A{'n' if kind == 'experiment' else ''} {kind}" for kind in kinds]
