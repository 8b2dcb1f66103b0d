"""Undo and redo."""

import pytest

from bgmodel.explorer.history import History
from circuits.errors import InputError
from tests.explorer.helpers import small


def test_undo_and_redo_lead_to_the_states_before_and_after():
    history = History(small())
    first = history.state
    history.go(first.edited("lesion STN 10%"))
    second = history.state
    history.undo()
    assert history.state is first
    assert not history.can_undo
    history.redo()
    assert history.state is second
    history.undo()
    history.go(first.edited("dopamine 0.9"))
    assert not history.can_redo
    history.reset()
    assert history.state == first
    history.undo()
    assert history.state.edits == ("dopamine 0.9",)


def test_a_refused_state_leaves_the_one_that_is_shown():
    history = History(small())
    with pytest.raises(InputError):
        history.go(history.state.edited("lesion ctx"))
    assert history.state is history.first
    assert not history.can_undo


def test_only_the_last_states_are_kept(monkeypatch):
    monkeypatch.setattr("bgmodel.explorer.history.LONGEST", 4)
    history = History(small())
    for k in range(9):
        history.go(history.state.with_setting("trial", 1 + k))
    while history.can_undo:
        history.undo()
    assert history.state.trial == 6
