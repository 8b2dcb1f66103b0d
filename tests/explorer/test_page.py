"""The page's widgets and panels, without a browser."""

import time

import pytest

pytest.importorskip("panel", reason="the explorer needs Panel: pip install '.[explore]'")

from bgmodel.explorer.html import TITLES
from bgmodel.explorer.page import Explorer
from bgmodel.explorer.state import State
from tests.explorer.helpers import FEW, small

pytestmark = pytest.mark.filterwarnings("ignore")
WAIT_S = 120


@pytest.fixture(scope="module")
def explorer():
    """Return an explorer of a small state; its runs end with the tests."""
    found = Explorer(small("bogacz_gurney"), "http://127.0.0.1:1/")
    yield found
    found.runs.stop(wait=True)


@pytest.fixture(autouse=True)
def reset(explorer):
    """Show the first state again."""
    explorer.history.go(explorer.history.first)
    explorer._show()
    explorer.controls.choose("STN")


def shown(explorer):
    """Wait until all panels show the state."""
    ends = time.monotonic() + WAIT_S
    while {panel.key for panel in explorer.shown.values()} != {explorer.state.key} or set(
        explorer.shown
    ) != set(TITLES):
        assert time.monotonic() < ends
        time.sleep(0.01)
    return explorer.shown


def test_every_widget_changes_the_state_and_shows_it(explorer):
    controls = explorer.controls
    controls.line.value = "lesion STN 10%"
    assert explorer.state.edits == ("lesion STN 10%",)
    assert controls.line.value == ""
    assert controls.quick["lesion"].value == 10
    controls.quick["lesion"].value = 20
    controls.row.value = "STN->GPe"
    controls.quick["scale"].value = 0.5
    controls.row.value = "GPe->STN"
    controls.field.value = "weight"
    controls.value.value = "-0.9"
    edits = ("lesion STN 20%", "scale STN->GPe 0.5", "set GPe->STN.weight -0.9")
    assert explorer.state.edits == edits
    controls.numbers["d_prime"].value = 0.7
    controls.numbers["trial"].value = 3
    assert explorer.state.experiment.task.d_prime == 0.7
    assert explorer.state.trial == 3
    explorer.undo.clicks += 1
    explorer.undo.clicks += 1
    assert controls.numbers["d_prime"].value == FEW.d_prime
    explorer.redo.clicks += 1
    assert controls.numbers["d_prime"].value == 0.7
    assert State.from_link(explorer.export.link.value) == explorer.state
    explorer.reset.clicks += 1
    assert explorer.state.edits == ()


def test_a_change_that_changes_nothing_leaves_the_run_alone(explorer, monkeypatch):
    """A browser reports an Enter twice: as a new text, and as a key."""
    asked = []
    monkeypatch.setattr(explorer.runs, "show", asked.append)
    explorer.controls.line.value = "lesion STN 10%"
    explorer.controls.line.value = "lesion STN 10%"
    assert asked == [explorer.state]
    assert explorer.controls.line.value == ""


def test_a_pathway_is_added_and_an_edit_removed_by_a_button(explorer):
    controls = explorer.controls
    controls.source.value, controls.target.value = "D1", "GPe"
    controls.add.clicks += 1
    assert explorer.state.edits == ("add D1->GPe weight=-0.1 delay_ms=4",)
    explorer.list[0].clicks += 1
    assert explorer.state.edits == ()


def test_a_click_in_the_drawing_chooses_its_row(explorer):
    explorer.drawing.chosen = "GPe->STN"
    explorer.drawing.clicks += 1
    assert explorer.controls.row.value == "GPe->STN"
    explorer.drawing.chosen = "figure_1"
    explorer.drawing.clicks += 1
    assert explorer.controls.row.value == "GPe->STN"


def test_a_refusal_is_text_below_its_field_and_leaves_state_and_what_was_typed(explorer):
    before, said, controls = explorer.state, explorer.refusal.pane, explorer.controls
    controls.line.value = "lesion <b>STM</b>"
    assert explorer.state is before
    assert "Refused" in said.object
    assert "<b>" not in said.object
    assert controls.line.value == "lesion <b>STM</b>"
    assert below(explorer, "edits", controls.line) is said
    controls.numbers["d_prime"].value = -1
    assert controls.numbers["d_prime"].value == -1
    assert below(explorer, "task", controls.numbers["d_prime"]) is said
    assert said not in explorer.parts["edits"]
    controls.file.value = "no.toml"
    assert "can" in said.object
    assert explorer.state is before
    controls.line.value = "lesion STN 10%"
    assert said.object == ""
    assert all(said not in column for column in explorer.columns)
    assert controls.numbers["d_prime"].value == before.experiment.task.d_prime


def below(explorer, part, widget):
    """Return what is below a widget."""
    column = explorer.parts[part]
    return column[1 + column.index(widget)]


@pytest.mark.parametrize("name", ["lesion", "dopamine", "d_prime"])
def test_an_emptied_number_is_no_traceback(explorer, name):
    controls = explorer.controls
    controls.line.value = "lesion STN 10%"
    controls.row.value = "STN"
    found = {**controls.quick, **controls.numbers, "dopamine": controls.dopamine}[name]
    found.value = None
    assert explorer.state.edits == (() if name == "lesion" else ("lesion STN 10%",))


def test_losses_are_ranked_and_the_ranking_of_an_earlier_state_is_dimmed(explorer):
    shown(explorer)
    explorer.ranking.begin.clicks += 1
    assert explorer.ranking.begin.disabled
    ends = time.monotonic() + WAIT_S
    while explorer.ranking.begin.disabled:
        assert time.monotonic() < ends
        time.sleep(0.01)
    while "lesion STN 10%" not in explorer.ranking.table.object:  # a moment after the button
        assert time.monotonic() < ends
        time.sleep(0.01)
    assert explorer.state.digest in explorer.ranking.table.object
    before = explorer.state.digest
    explorer.controls.line.value = "lesion STN 5%"
    assert explorer.ranking.table.css_classes == ["busy"]
    assert before in explorer.ranking.table.object
    explorer.undo.clicks += 1
    assert explorer.ranking.table.css_classes == []


def test_a_file_that_is_shown_as_text_can_be_edited_there(explorer):
    explorer.export.toml.value = explorer.export.toml.value.replace(
        "trials = 120", "trials = 120\nd_prime = 0.9"
    ).replace("d_prime = 1.0\n", "")
    explorer.export.apply.clicks += 1
    assert explorer.state.experiment.task.d_prime == 0.9
    explorer.export.toml.value = "name = 3\n= x"
    explorer.export.apply.clicks += 1
    assert "is not valid TOML" in explorer.refusal.pane.object


def test_panels_are_dimmed_until_they_show_the_new_state(explorer):
    shown(explorer)
    explorer.controls.line.value = "lesion STN 5%"
    late = [pane for pane in explorer.panes.values() if pane.css_classes == ["busy"]]
    assert late or {p.key for p in explorer.shown.values()} == {explorer.state.key}
    panels = shown(explorer)
    for name, panel in panels.items():
        assert panel.digest == explorer.state.digest
        assert f'data-circuit="{panel.digest}"' in explorer.panes[name].object


def test_trials_are_saved_with_both_conditions(explorer):
    explorer.controls.line.value = "lesion STN 5%"
    table = explorer.export.csv("trials").read().decode().splitlines()
    assert len(table) == 1 + 2 * explorer.state.experiment.trials
    assert "condition" in table[0]


def test_the_layouts_of_page_and_notebook_have_every_panel(explorer):
    assert set(TITLES) <= set(explorer.parts)
    assert explorer.layout() is not None
    assert explorer.template() is not None
