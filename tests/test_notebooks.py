"""The tutorials are stored with outputs, with the version they come from, and without errors."""

import json
import re

import pytest

from bgmodel.version import __version__
from circuits import errors
from tests.helpers import ROOT

NOTEBOOKS = sorted((ROOT / "docs" / "tutorials").glob("*.ipynb"))
PLACES = re.compile(r"(?:/home|/root|/tmp|/work|/Users|/usr|/opt|[A-Z]:\\\\)[/\\]?\w|ipykernel_\d")
"""Paths of a machine."""


@pytest.fixture(params=NOTEBOOKS, ids=lambda path: path.stem)
def notebook(request):
    return json.loads(request.param.read_text(encoding="utf-8"))


def code(notebook):
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def test_every_code_cell_was_executed_in_order_with_an_output(notebook):
    cells = code(notebook)
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    assert [cell["id"] for cell in cells if not cell["outputs"]] == []
    kinds = {output["output_type"] for cell in cells for output in cell["outputs"]}
    assert "error" not in kinds


def test_no_output_names_a_place_on_a_machine(notebook):
    for cell in code(notebook):
        for output in cell["outputs"]:
            shown = {k: v for k, v in output.get("data", {}).items() if not k.startswith("image")}
            assert not PLACES.search(json.dumps([shown, output.get("text")])), cell["id"]


def test_warnings_are_those_of_the_package(notebook):
    """A warning of another library tells the reader nothing."""
    lines = [
        line
        for cell in code(notebook)
        for output in cell["outputs"]
        if output.get("name") == "stderr"
        for line in "".join(output["text"]).splitlines()
    ]
    assert [line for line in lines if getattr(errors, line.split(":")[0], None) is None] == []


def test_a_notebook_was_executed_with_this_version(notebook):
    version = notebook["metadata"]["bgmodel"]["version"]
    assert re.fullmatch(r"\d+\.\d+\.\d+\S*", version)
    if version != __version__:
        pytest.skip(f"executed with bgmodel {version}, this is {__version__}: run make notebooks")
