"""What is drawn on one axis has one unit, that of its label."""

import json
import re

import pytest

from circuits.plots import FROM_ONSET
from tests.helpers import ROOT
from tests.units import mixed

CONSTANTS = {"FROM_ONSET": FROM_ONSET}
CODE = [
    path for folder in ("bgmodel", "circuits", "figures") for path in (ROOT / folder).rglob("*.py")
]
DRAWING = [path for path in CODE if re.search(r"set\(.*label=|set_[xy]label\(", path.read_text())]
PAGES = [*(ROOT / "docs" / "guides").glob("*.md"), ROOT / "README.md", ROOT / "docs/extending.md"]
SECONDS = re.compile(r"\((?:ms|readings|nats)\)")


def name(path):
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize("path", sorted(DRAWING), ids=name)
def test_code_draws_one_unit_on_an_axis(path):
    assert mixed(path.read_text(encoding="utf-8"), CONSTANTS) == []


@pytest.mark.parametrize("path", sorted((ROOT / "docs/tutorials").glob("*.ipynb")), ids=name)
def test_a_tutorial_draws_one_unit_on_an_axis(path):
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    assert mixed("\n".join(code), CONSTANTS) == []


@pytest.mark.parametrize("path", sorted(PAGES), ids=name)
def test_a_page_draws_one_unit_on_an_axis(path):
    for block in re.findall(r"```python\n(.*?)```", path.read_text(encoding="utf-8"), re.DOTALL):
        assert mixed(block, CONSTANTS) == []


def test_a_label_of_another_unit_is_found_wherever_the_unit_of_a_line_is_known():
    texts = [path.read_text(encoding="utf-8") for path in DRAWING]
    labels = [mixed(SECONDS.sub("(mm)", text), {"FROM_ONSET": "Time (mm)"}) for text in texts]
    assert sum(map(len, labels)) > 15
