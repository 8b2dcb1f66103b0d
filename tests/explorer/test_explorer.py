"""Random sequences of a user's steps: no traceback, no stale panel, the command's sentences."""

import tomllib

import pytest
import tomlkit
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from bgmodel.cli import main
from bgmodel.explorer import drawing
from bgmodel.explorer.panels import TITLES, Memory, panels
from bgmodel.explorer.state import MOST_TRIALS, ExplorerState, History
from circuits.anatomy import load_circuit
from circuits.declaration.table_writer import digest
from tests.explorer.helpers import STEPS, small

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")
HERE_ALONE = (f"must be at most {MOST_TRIALS} here", "trial must be within", "learning must")
"""Parts of the refusals of the explorer that the command does not share."""


def moved(history, step):
    """Take a user's step; return the sentence of the refusal, or an empty string."""
    kind, *what = step
    state = history.state
    try:
        if kind == "edit":
            history.go(state.edited(*what))
        elif kind == "set":
            history.go(state.with_setting(*what))
        elif kind == "baseline":
            history.go(state.as_control())
        elif kind == "remove":
            history.go(state.without(*state.edits[:1]))
        else:
            getattr(history, kind)()
    except (ValueError, OSError) as error:
        return str(error)
    return ""


def said_by_the_command(state, step, tmp_path, capsys):
    """Return what `bgmodel experiment` says of the file that has the step's change."""
    # Conditions that are alike would be refused for that alone.
    asked = state.edited("set ctx.cite compared") if state.alike else state
    file = tomllib.loads(asked.experiment.to_toml())
    kind, name, *value = step
    task = file.setdefault("task", {})
    if kind == "edit":
        try:
            edits = list(state.edits.replacing([name]))
        except ValueError:
            edits = [*state.edits, name]
        file["manipulation"] = file.get("manipulation", {}) | {"edits": edits}
    elif name == "evidence":
        file["task"] = {"evidence": value[0]}
    elif name.startswith("stop"):
        file["stop"] = {name.partition(".")[2]: value[0]}
    else:
        other = {"posterior": "threshold", "threshold": "posterior"}.get(name)
        file.pop(other, None)
        of = task if name in vars(state.experiment.task) else file
        of[name] = value[0]
    path = tmp_path / "asked.toml"
    path.write_text(tomlkit.dumps(file))
    capsys.readouterr()
    assert main(["experiment", str(path)]) == 2
    # A file's paths are relative to its folder.
    return capsys.readouterr().err.replace(f"{tmp_path}/", "")


def follow(steps, tmp_path, capsys, monkeypatch, *, drawn):
    history = History(small())
    for step in steps:
        before = history.state
        sentence = moved(history, step)
        if not sentence:
            continue
        assert history.state is before
        assert "\n" not in sentence
        comparable = len(step) > 1 and step[-1] is not None
        if comparable and not any(part in sentence for part in HERE_ALONE):
            output = said_by_the_command(before, step, tmp_path, capsys)
            assert sentence in output
    state = history.state
    if not drawn:
        for name in ("times", "tradeoff", "trial", "circuit"):
            monkeypatch.setattr(drawing, name, lambda *_, **__: "<svg/>")
    shown = {panel.name: panel for panel in panels(state, Memory(), workers=1)}
    assert set(shown) == set(TITLES)
    known = load_circuit(state.experiment.circuit, state.experiment.hypotheses)
    expected = digest(known.edited(*state.experiment.edits, *state.edits))
    for panel in shown.values():
        assert panel.key == state.key
        assert panel.digest == expected
        assert panel.text
        assert panel.refused != bool(panel.svg or panel.tables)
    assert ExplorerState.from_link(state.link()) == state


@given(steps=st.lists(STEPS, max_size=6))
@settings(max_examples=7, phases=[Phase.generate], suppress_health_check=[*HealthCheck])
def test_random_sequences(steps, tmp_path, capsys, monkeypatch):
    follow(steps, tmp_path, capsys, monkeypatch, drawn=False)
