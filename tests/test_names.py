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
        sentence = refusal(*command.split(), option, "quill")
        assert all(name in sentence for name in known), sentence
        assert sentence.count("\n") == 1
