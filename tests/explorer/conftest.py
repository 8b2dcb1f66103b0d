"""No run of the explorer outlives its test."""

import pytest

from bgmodel.explorer import runs


@pytest.fixture(autouse=True)
def _ended_runs(monkeypatch):
    """End the threads of a test: one that still runs would change how later tests see warnings."""
    started, begin = [], runs.PanelRuns.__init__

    def recorded(self, *arguments, **named):
        begin(self, *arguments, **named)
        started.append(self)

    monkeypatch.setattr(runs.PanelRuns, "__init__", recorded)
    yield
    for each in started:
        each.stop(wait=True)
