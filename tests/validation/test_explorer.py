"""Random sequences of a user's steps in the explorer, and a live notebook: make validate."""

import re

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from tests.explorer.helpers import STEPS
from tests.explorer.test_explorer import follow

pytestmark = pytest.mark.validate


@pytest.mark.timeout(7200)
@pytest.mark.filterwarnings("ignore::UserWarning")
@given(steps=st.lists(STEPS, max_size=15))
@settings(max_examples=300, phases=[Phase.generate], suppress_health_check=[*HealthCheck])
def test_three_hundred_random_sequences(steps, tmp_path, capsys, monkeypatch):
    follow(steps, tmp_path, capsys, monkeypatch, drawn=True)


CELLS = (
    "import bgmodel as bg\nlayout = bg.explore('bogacz_gurney')\nlayout",
    """
import time
explorer = layout.explorer
explorer.controls.widgets["line"].value = "lesion STN 10%"
ends = time.monotonic() + 200
while len(explorer.panels) < 5:
    assert time.monotonic() < ends
    time.sleep(0.05)
print(*explorer.state.edits)
print(*explorer.views["measures"].panel.tables[0])
""",
)


def test_a_live_notebook_shows_an_edit_and_has_its_scripts():
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    cells = [nbformat.v4.new_code_cell(cell) for cell in CELLS]
    book = nbformat.v4.new_notebook(cells=cells)
    nbclient.NotebookClient(book, timeout=600).execute()
    first, second = (str(cell.outputs) for cell in book.cells)
    assert "Nucleus or pathway" in first
    assert re.findall(r"js_urls = \[([^\]]*)\]", first) != []
    assert {*re.findall(r"js_urls = \[([^\]]*)\]", first)} == {""}
    assert "lesion STN 10%" in second
    assert "Change" in second
