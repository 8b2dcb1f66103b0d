"""The explorer in a notebook, ``bg.explore``."""

import pytest

import bgmodel as bg
from bgmodel.explorer import notebook
from bgmodel.explorer.notebook import state_of


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
