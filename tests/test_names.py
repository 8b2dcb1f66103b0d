"""Names of circuits and engines, as every command takes them."""

import pytest

from circuits import anatomy
from circuits.engines import ENGINES
from tests.helpers import run


@pytest.mark.parametrize(
    "command", [("run", "a.csv"), ("compare-edits", "a.csv"), ("learn", "a.csv"), ("show",)]
)
def test_an_unknown_circuit_or_engine_is_answered_with_all_there_are(command, capsys, monkeypatch):
    """The lists are those of the circuits: one more is known to every command."""
    monkeypatch.setitem(anatomy.CIRCUITS, "mine", anatomy.bogacz_gurney)
    monkeypatch.setitem(ENGINES, "pen", "by hand")
    circuit = ("cortex",) if command == ("show",) else ("--circuit", "cortex")
    assert run("circuit", *command, *circuit) == 2
    said = capsys.readouterr().err
    assert all(name in said for name in anatomy.CIRCUITS), said
    assert len(said.splitlines()) == 1
    if command != ("show",):
        assert run("circuit", *command, "--engine", "quill") == 2
        timed = set(ENGINES) - ({"algebra"} if command[0] == "learn" else set())
        said = capsys.readouterr().err
        assert all(name in said for name in timed), said
