"""The state of the explorer: its edits, its settings, and its texts."""

import pytest

from bgmodel.experiments.experiment import shipped
from bgmodel.explorer.state import MOST_TRIALS, ExplorerState, History, opened
from circuits.errors import InputError
from tests.explorer.helpers import small
from tests.helpers import refused


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
    from circuits.anatomy import load_circuit
    from circuits.declaration.table_writer import write

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
