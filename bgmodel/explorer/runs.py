"""Computation in the background: a new state cancels the run of an older one."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor

from bgmodel.explorer.panels import Memory, Panel, panels
from bgmodel.explorer.ranking import ranked
from bgmodel.explorer.state import State
from bgmodel.support import progress
from circuits.errors import quiet


class Superseded(Exception):
    """Cancelled: superseded by a newer request, or the page was closed."""


class Runs:
    """One thread that computes the panels of the newest state.

    ``deliver`` receives each panel, and ``ended`` the state when all are computed; both are called
    in that thread.
    """

    def __init__(
        self,
        deliver: Callable[[Panel], None],
        ended: Callable[[State], None],
        *,
        workers: int = 2,
    ) -> None:
        self.memory = Memory()
        self._deliver, self._ended, self._workers = deliver, ended, workers
        self._newest = self._ranking = 0
        """Numbers of the requests that are still wanted."""
        self._thread = ThreadPoolExecutor(1, "explorer")

    def show(self, state: State) -> None:
        """Compute the panels of a state, and cancel what is being computed for an older one."""
        self._newest += 1
        wanted = self._newest
        self._submit(
            state,
            lambda: panels(state, self.memory, workers=self._workers),
            lambda: wanted == self._newest,
        )

    def rank(self, state: State) -> None:
        """Rank the losses of a state after its panels."""
        self._ranking += 1
        wanted = self._newest, self._ranking
        self._submit(
            state,
            lambda: ranked(state, workers=self._workers),
            lambda: wanted == (self._newest, self._ranking),
        )

    def cancel(self) -> None:
        """Cancel the ranking."""
        self._ranking += 1

    def stop(self, *, wait: bool = False) -> None:
        """Cancel all runs and end the thread."""
        self._newest += 1
        self._thread.shutdown(wait=wait, cancel_futures=True)

    def _submit(
        self, state: State, compute: Callable[[], Iterator[Panel]], wanted: Callable[[], bool]
    ) -> None:
        """Queue a run; an unexpected error is logged with its traceback."""
        future = self._thread.submit(self._run, state, compute, wanted)
        future.add_done_callback(_raise)

    def _run(
        self, state: State, compute: Callable[[], Iterator[Panel]], wanted: Callable[[], bool]
    ) -> None:
        def check(_: int = 0) -> None:
            """Cancel the run if it is no longer wanted; engines call this after each batch."""
            if not wanted():
                raise Superseded

        try:
            check()
            with quiet(), progress.shown_by(check):  # panels collect their own warnings
                for panel in compute():
                    check()
                    self._deliver(panel)
            self._ended(state)
        except Superseded:
            pass
        finally:
            # Figures refer to themselves: without this, memory would grow between collections.
            gc.collect()


def _raise(future: Future[None]) -> None:
    """Raise the error of a finished run; ``concurrent.futures`` logs it."""
    if not future.cancelled():
        future.result()
