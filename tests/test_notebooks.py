"""The tutorials are stored with outputs, without errors and without places on a machine."""

import json
import re

import pytest

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
