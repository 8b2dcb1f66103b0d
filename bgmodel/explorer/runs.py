"""Runs in the background: a new state cancels the run of an older one."""

from __future__ import annotations

import gc
import threading
from collections.abc import Callable, Iterator

from bgmodel.explorer.html import Panel
from bgmodel.explorer.panels import Memory, panels
from bgmodel.explorer.ranking import ranked
from bgmodel.explorer.state import State
from bgmodel.support import progress
from circuits.errors import quiet

Deliver = Callable[[Panel], None]
"""Receives each panel of the newest state, in the thread of the runs."""


class Superseded(Exception):
    """A newer state has been asked for, or nobody looks any more."""


class Runs:
    """One thread that computes the panels of the newest state."""

    def __init__(
        self,
        deliver: Deliver,
        ended: Callable[[State], None],
        *,
        workers: int = 2,
        memory: Memory | None = None,
    ) -> None:
        self.memory = Memory() if memory is None else memory
        self._deliver, self._ended, self._workers = deliver, ended, workers
        self._wanted: State | None = None
        self._to_rank: State | None = None
        self._stopped = self._cancelled = False
        self._change = threading.Condition()
        self._thread = threading.Thread(target=self._loop, name="explorer", daemon=True)
        self._thread.start()

    def show(self, state: State) -> None:
        """Compute the panels of a state; what is being computed for an older one is cancelled."""
        with self._change:
            self._wanted, self._to_rank = state, None
            self._change.notify()

    def rank(self, state: State) -> None:
        """Rank the losses of a state, once its panels are computed."""
        with self._change:
            self._to_rank = state
            self._change.notify()

    def cancel(self) -> None:
        """End the ranking."""
        with self._change:
            self._to_rank, self._cancelled = None, True

    def stop(self, *, wait: bool = False) -> None:
        """Cancel what is being computed, and end the thread; if asked to, wait for its end."""
        with self._change:
            self._stopped, self._wanted = True, None
            self._change.notify()
        if wait:
            self._thread.join()

    def _loop(self) -> None:
        while (job := self._next()) is not None:
            try:
                self._run(*job)
            except Superseded:
                continue
            except RuntimeError:
                # Python starts no threads while it ends.
                if not self._stopped:
                    raise

    def _next(self) -> tuple[State, bool] | None:
        """Wait for a state, and return it and whether to rank its losses; None at the end."""
        with self._change:
            while self._wanted is None and self._to_rank is None and not self._stopped:
                self._change.wait()
            self._cancelled = False
            if self._stopped:
                return None
            if (state := self._wanted) is not None:
                self._wanted = None
                return state, False
            state, self._to_rank = self._to_rank, None
            return None if state is None else (state, True)

    def _check(self, _: int = 0) -> None:
        """End the run if it is no longer wanted; engines call it after each batch of trials."""
        if self._wanted is not None or self._stopped:
            raise Superseded

    def _check_ranking(self, _: int = 0) -> None:
        """End the ranking if it was cancelled, as well."""
        self._check()
        if self._cancelled:
            raise Superseded

    def _panels(self, state: State, rank: bool) -> Iterator[Panel]:
        if rank:
            return ranked(state, workers=self._workers)
        return panels(state, self.memory, workers=self._workers)

    def _run(self, state: State, rank: bool) -> None:
        check = self._check_ranking if rank else self._check
        with quiet(), progress.shown_by(check):  # panels collect their own warnings
            for panel in self._panels(state, rank):
                check()
                self._deliver(panel)
        self._ended(state)
        # Figures refer to themselves: until Python looks for such rings, memory would grow.
        gc.collect()
