"""Runs in the background: the newest state counts; and the ranking of losses."""

import threading
import time

import pytest

from bgmodel.explorer import runs as module
from bgmodel.explorer.panels import TITLES
from bgmodel.explorer.runs import RANKING, PanelRuns, ranked
from bgmodel.support import processes
from tests.explorer.helpers import small

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")


def test_a_newer_state_cancels_the_run_of_an_older_one(monkeypatch):
    begun, panels, over = threading.Event(), [], threading.Event()
    first, second = small(), small("macaque", "algebra", "dopamine 0.9")

    def slow(state, memory, workers):
        if state is first:
            begun.set()
            while True:
                processes.advance(1)
                time.sleep(0.001)
        yield from original(state, memory, workers=workers)

    original = module.panels
    monkeypatch.setattr(module, "panels", slow)
    runs = PanelRuns(panels.append, lambda state, ranked: over.set(), workers=1)
    runs.show(first)
    assert begun.wait(20)
    runs.show(second)
    assert over.wait(60)
    assert {panel.key for panel in panels} == {second.key}
    assert {panel.name for panel in panels} == set(TITLES)


def test_a_ranking_waits_for_the_panels_and_ends_when_it_is_cancelled(monkeypatch):
    begun, over, panels = threading.Event(), threading.Event(), []
    state = small()

    def endless(state, workers):
        begun.set()
        while True:
            processes.advance(1)
            time.sleep(0.001)
        yield

    monkeypatch.setattr(module, "ranked", endless)
    runs = PanelRuns(panels.append, lambda state, ranked: over.set(), workers=1)
    runs.show(state)
    runs.rank(state)
    assert begun.wait(60)
    assert over.is_set()
    assert {panel.name for panel in panels} == set(TITLES)
    runs.cancel()
    over.clear()
    runs.show(state)
    assert over.wait(60)
    assert len(panels) == 2 * len(TITLES)


@pytest.fixture(scope="module")
def last():
    """Return a state with an edit, and the last panel of its ranking."""
    state = small("macaque", "population", "lesion STN 10%")
    panels = [*ranked(state, workers=1)]
    return state, panels[-1]


def rows(panel):
    """Return the losses and the changes of the mean time."""
    (table,) = panel.tables
    return [(line, float(change.split()[0])) for line, change in table.to_numpy()[:, :2]]


def test_the_loss_that_slows_decisions_most_comes_first(last):
    _, panel = last
    changes = [change for _, change in rows(panel)]
    assert len(changes) > 10
    assert changes == sorted(changes, reverse=True)
    assert changes[0] > 0 > changes[-1]


def test_each_row_is_the_change_that_an_experiment_measures(last):
    state, panel = last
    line, change = rows(panel)[0]
    experiment = state.as_control().edited(line).experiment
    measures = experiment.run().measures
    chosen = (measures["condition"] == "change") & (measures["measure"] == "mean_ms")
    assert change == round(float(measures.loc[chosen, "value"].item()))


def test_a_loss_that_is_refused_is_left_out_with_its_reason(last):
    state, panel = last
    assert (panel.name, panel.key, panel.digest) == (RANKING, state.key, state.digest)
    assert not {"lesion ctx 10%", "lesion STN 10%"} & {line for line, _ in rows(panel)}
    assert "'lesion ctx 10%'" in panel.text
