"""Computation in the background: a new state cancels the run of an older one."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

from bgmodel.explorer.panels import Memory, Panel, panels
from bgmodel.explorer.ranking import ranked
from bgmodel.explorer.state import State
from bgmodel.support import processes
from circuits.errors import quiet


class Superseded(Exception):
    """Cancelled: superseded by a newer request, or the page was closed."""


class Runs:
    """One thread that computes the panels of the newest state.

    ``deliver`` receives each panel, and ``ended`` the state when all are computed; both are called
    in that thread.
    """

    def __init__(
        self, deliver: Callable[[Panel], None], ended: Callable[[State], None], workers: int = 2
    ) -> None:
        self.memory = Memory()
        self._deliver, self._ended, self._workers = deliver, ended, workers
        self._shows = self._ranks = 0
        """Numbers of requests; only the newest is wanted."""
        self._thread = ThreadPoolExecutor(1, "explorer")

    def show(self, state: State) -> None:
        """Compute the panels of a state, and cancel the computation for an older one."""
        self._shows += 1
        self._submit(state, lambda: panels(state, self.memory, workers=self._workers))

    def rank(self, state: State) -> None:
        """Rank the losses of a state after its panels."""
        self._ranks += 1
        self._submit(state, lambda: ranked(state, workers=self._workers), self._ranks)

    def cancel(self) -> None:
        """Cancel the ranking."""
        self._ranks += 1

    def stop(self, *, wait: bool = False) -> None:
        """Cancel all runs and end the thread."""
        self._shows += 1
        self._thread.shutdown(wait=wait, cancel_futures=True)

    def _submit(
        self, state: State, compute: Callable[[], Iterator[Panel]], ranks: int | None = None
    ) -> None:
        """Queue a run, with the number of its ranking; an unexpected error is logged."""
        shows = self._shows

        def check(_: int = 0) -> None:
            """Cancel the run if it is no longer wanted; engines call this after each batch."""
            if shows != self._shows or ranks not in (None, self._ranks):
                raise Superseded

        def run() -> None:
            with suppress(Superseded):
                check()
                with quiet(), processes.shown_by(check):  # panels collect their own warnings
                    for panel in compute():
                        check()
                        self._deliver(panel)
                self._ended(state)
            # Figures refer to themselves: without this, memory would grow between collections.
            gc.collect()

        future = self._thread.submit(run)
        future.add_done_callback(lambda done: done.cancelled() or done.result())
