"""Undo and redo: a list of states, of which one is shown."""

from __future__ import annotations

from bgmodel.explorer.state import State

LONGEST = 200
"""Largest number of states that are kept."""


class History:
    """The states of one user, from the first to the last, and which of them is shown."""

    def __init__(self, first: State) -> None:
        first.check()
        self.first = first
        self._states = [first]
        self._at = 0

    @property
    def state(self) -> State:
        """The state that is shown."""
        return self._states[self._at]

    def go(self, state: State) -> None:
        """Show a new state; states that were undone are forgotten."""
        if state == self.state and state.key == self.state.key:
            return  # Keys differ if a circuit's file has changed.
        state.check()
        self._states = [*self._states[: self._at + 1], state][-LONGEST:]
        self._at = len(self._states) - 1

    def undo(self) -> None:
        """Show the state before, if there is one."""
        self._at = max(0, self._at - 1)

    def redo(self) -> None:
        """Show the state that was undone last, if there is one."""
        self._at = min(len(self._states) - 1, self._at + 1)

    def reset(self) -> None:
        """Show the first state again; this can be undone."""
        self.go(self.first)

    @property
    def can_undo(self) -> bool:
        """Whether there is a state before."""
        return self._at > 0

    @property
    def can_redo(self) -> bool:
        """Whether a state was undone."""
        return self._at < len(self._states) - 1
