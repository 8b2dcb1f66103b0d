"""The page's widgets and panels, without a browser."""

import time

import pytest

pytest.importorskip("panel", reason="the explorer needs Panel: pip install '.[explore]'")

from bgmodel.explorer.controls import NUMBERS
from bgmodel.explorer.page import Explorer
from bgmodel.explorer.panels import TITLES
from bgmodel.explorer.runs import RANKING
from bgmodel.explorer.state import ExplorerState
from tests.explorer.helpers import FEW, small

pytestmark = pytest.mark.filterwarnings("ignore")
WAIT_S = 120
VALUES = {
    "d_prime": 0.7, "channels": 3, "conflict": 0.4, "t_max": 30, "step_ms": 40.0, "trials": 130,
    "seed": 5, "posterior": 0.8, "threshold": 0.4, "gain": 0.5, "trial": 3, "stop": True,
    "stop.share": 0.3, "stop.delay_ms": 20.0, "dopamine": 0.9, "lesion": 10.0, "cut": 20.0,
    "scale": 0.5, "value": "-1.5",
}  # fmt: skip
"""Another value of each widget that shows a part of the state."""
ROWS = {"cut": "STN->GPe", "scale": "STN->GPe"}
"""Rows of the widgets that belong to pathways."""


@pytest.fixture(scope="module")
def explorer():
    """Return an explorer of a small state; its runs end with the tests."""
    running = Explorer(small("bogacz_gurney"), "http://127.0.0.1:1/")
    yield running
    running.runs.stop(wait=True)


@pytest.fixture(autouse=True)
def reset(explorer):
    """Show the first state again."""
    explorer.history.go(explorer.history.first)
    explorer._show()
    explorer.controls.choose("STN")


@pytest.fixture
def widgets(explorer):
    return explorer.controls.widgets


def until(condition):
    ends = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < ends
        time.sleep(0.01)


def test_every_widget_changes_the_state_and_follows_it(explorer, widgets, monkeypatch):
    monkeypatch.setattr(explorer.runs, "show", lambda state: None)
    assert set(widgets) == {*VALUES, "evidence", "preset", "file", "line"}
    assert set(NUMBERS) < set(VALUES)
    for name, value in VALUES.items():
        explorer.controls.choose(ROWS.get(name, "STN"))
        before, old = explorer.state, widgets[name].value
        widgets[name].value = value
        assert explorer.state != before, name
        explorer.controls.show(explorer.state)
        assert widgets[name].value == value, name
        assert ExplorerState.from_link(explorer.texts["Link"].value) == explorer.state
        explorer.buttons["Undo"].clicks += 1
        assert (explorer.state, widgets[name].value) == (before, old), name
    explorer.buttons["Redo"].clicks += 1
    assert widgets["value"].value == value
    explorer.buttons["Reset"].clicks += 1
    assert explorer.state == explorer.history.first


def test_a_refusal_is_text_below_its_field_which_keeps_what_was_typed(explorer, widgets):
    before = explorer.state

    def below(widget):
        (card,) = (card for card in explorer.controls.cards if widget in card.objects)
        return card[1 + card.objects.index(widget)]

    for name, value in (("line", "lesion <b>STM</b>"), ("d_prime", -1), ("file", "no.toml")):
        widgets[name].value = value
        assert explorer.state is before
        assert widgets[name].value == value
        assert below(widgets[name]) is explorer.refusal
        assert "<b>" not in explorer.refusal.object
    widgets["line"].value = "lesion STN 10%"
    assert below(widgets["preset"]) is not explorer.refusal
    assert all(explorer.refusal not in card.objects for card in explorer.controls.cards)
    assert widgets["d_prime"].value == FEW.d_prime


def test_panels_are_dimmed_until_they_show_the_new_state(explorer, widgets):
    until(lambda: len(explorer.panels) == len(TITLES))
    before = {panel.name: panel.svg or panel.tables[0].to_csv() for panel in explorer.panels}
    widgets["line"].value = "lesion STN 50%"
    for view in map(explorer.views.get, TITLES):
        assert view.body.loading != (view.panel.key == explorer.state.key)
    until(lambda: len(explorer.panels) == len(TITLES))
    for panel in explorer.panels:
        assert panel.digest == explorer.state.digest
        assert panel.digest[:8] in explorer.views[panel.name].card.title
        assert (panel.svg or panel.tables[0].to_csv()) != before[panel.name]


def test_losses_are_ranked_and_the_ranking_of_another_state_says_so(explorer, widgets):
    view = explorer.views[RANKING]
    explorer.begin.clicks += 1  # before the panels are there
    assert explorer.begin.disabled
    until(lambda: view.panel and not explorer.begin.disabled)
    assert "lesion STN 10%" in [*view.panel.tables[0]["Additional loss"]]
    widgets["line"].value = "lesion STN 5%"
    assert "another state" in view.card.title
    explorer.buttons["Undo"].clicks += 1
    assert "another state" not in view.card.title


@pytest.mark.parametrize("name", ["lesion", "dopamine", "d_prime"])
def test_an_emptied_number_is_no_traceback(explorer, widgets, name):
    widgets["line"].value = "lesion STN 10%"
    widgets[name].value = None
    assert explorer.state.edits == (() if name == "lesion" else ("lesion STN 10%",))
