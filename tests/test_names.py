"""Names of circuits and engines, as every command takes them."""

import pytest

from circuits import anatomy
from circuits.engines import ENGINES


@pytest.mark.parametrize("command", ["circuit run", "compare", "learn --what dopamine"])
def test_an_unknown_circuit_or_engine_is_answered_with_all_there_are(command, refusal, monkeypatch):
    """The lists are those of the circuits: one more is known to every command."""
    monkeypatch.setitem(anatomy.CIRCUITS, "mine", anatomy.bogacz_gurney)
    monkeypatch.setitem(ENGINES, "pen", "by hand")
    timed = set(ENGINES)
    for option, known in (("--circuit", anatomy.CIRCUITS), ("--engine", timed)):
        said = refusal(*command.split(), option, "quill")
        assert all(name in said for name in known), said
        assert said.count("\n") == 1
