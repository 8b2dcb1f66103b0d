"""Random sequences of a user's steps: no traceback, no stale panel, the command's sentences."""

import tomllib

import pytest
import tomlkit
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import bgmodel as bg
from bgmodel.cli import main
from bgmodel.experiments.experiment import shipped
from bgmodel.explorer import drawing, notebook
from bgmodel.explorer.notebook import state_of
from bgmodel.explorer.panels import TITLES, Memory, panels
from bgmodel.explorer.state import MOST_TRIALS, ExplorerState, History, opened
from circuits.anatomy import load_circuit
from circuits.declaration.table_writer import digest, write
from circuits.errors import InputError
from tests.explorer.helpers import STEPS, small
from tests.helpers import refused

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")
HERE_ALONE = (f"must be at most {MOST_TRIALS} here", "trial must be within")
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


def test_a_circuit_made_in_python_is_written_to_a_file_that_reads_back(tmp_path, monkeypatch):
    monkeypatch.setattr(notebook.platformdirs, "user_cache_path", lambda _: tmp_path)
    circuit = bg.load_circuit("macaque", 3).lesion("STN", 0.1)
    state = state_of(circuit)
    assert state.control == circuit
    (file,) = tmp_path.rglob("*.toml")
    file.write_bytes(file.read_bytes()[:100])
    assert state_of(circuit) == state
    assert state.control == circuit
    assert [*tmp_path.rglob("*.toml")] == [file]


def test_an_experiment_a_name_and_nothing_are_opened():
    experiment = bg.Experiment.from_toml("stn_conflict")
    assert state_of(experiment).experiment is experiment
    assert state_of("gpe_lesion").edits == bg.Experiment.from_toml("gpe_lesion").manipulation.edits
    assert state_of("").experiment.circuit == "macaque"


@pytest.mark.filterwarnings("ignore")
def test_a_notebook_gets_a_layout_with_its_state():
    pytest.importorskip("panel", reason="the explorer needs Panel: pip install '.[explore]'")
    layout = bg.explore("bogacz_gurney")
    assert layout.explorer.state.experiment.circuit == "bogacz_gurney"
    layout.explorer.runs.stop(wait=True)


def test_an_edit_replaces_the_one_of_the_same_target_and_removes_predictions():
    state = opened("stn_conflict")
    assert state.experiment.predictions
    edited = state.edited("lesion STN 5%", "dopamine 0.9")
    assert edited.edits == ("lesion STN 5%", "dopamine 0.9")
    assert not edited.experiment.predictions
    assert not edited.experiment.published
    assert edited.without("lesion STN 5%").edits == ("dopamine 0.9",)


@pytest.mark.parametrize("name", ["macaque", "stn_conflict", "stop_stn_lesion"])
def test_a_link_has_the_whole_state(name):
    state = opened(name).with_setting("trial", 3)
    assert ExplorerState.from_link(state.link("http://127.0.0.1:1/")) == state
    assert opened(state.link("http://127.0.0.1:1/")) == state


@pytest.mark.parametrize("link", ["?state=", "?state=abc", "?state=eNpNUcFqwzAM", "?other=1", ""])
def test_a_link_that_is_cut_off_is_refused(link):
    with refused("link"):
        ExplorerState.from_link(link)


@pytest.mark.parametrize(
    ("name", "value", "field"),
    [
        ("d_prime", -1.0, "d_prime"),
        ("trials", 10**6, "trials"),
        ("trial", 120, "trial"),
        ("circuit", "gpr", "unit"),
        ("circuit", "nobody", "circuit"),
        ("posterior", 0.3, None),
        ("engine", "spiking", "engine"),
        ("colour", 1, "name"),
        ("stop.share", 2.0, "share"),
    ],
)
def test_a_setting_out_of_range_is_refused_and_names_its_field(name, value, field):
    with pytest.raises(InputError) as refused:
        small().with_setting(name, value).check()
    assert field in (refused.value.field, None)


def test_a_circuit_of_a_file_opens_with_its_alternatives(tmp_path):
    path = write(load_circuit("macaque", 3), tmp_path / "mine.toml")
    state = opened(path)
    assert state.experiment.task.channels == 3
    path.write_text("name = 'x'\n= 3")
    with pytest.raises(InputError, match="not valid TOML"):
        opened(path)


def test_undo_and_redo_lead_to_the_states_before_and_after():
    history = History(small())
    first = history.state
    history.go(first.edited("lesion STN 10%"))
    second = history.state
    history.undo()
    assert history.state is first
    assert not history.past
    history.redo()
    assert history.state is second
    history.undo()
    history.go(first.edited("dopamine 0.9"))
    assert not history.undone
    history.reset()
    assert history.state == first
    history.undo()
    assert history.state.edits == ("dopamine 0.9",)


def test_every_included_experiment_opens_with_few_enough_trials():
    for name, experiment in shipped().items():
        state = opened(name)
        assert state.experiment.trials <= MOST_TRIALS
        assert state.experiment.manipulation == experiment.manipulation
