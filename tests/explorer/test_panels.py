"""The panels of a state, as records."""

import re

import pytest

from bgmodel.deciding.measures import MEASURES as MEASURED
from bgmodel.deciding.measures import OF_ALL, OF_DIFFUSION
from bgmodel.experiments.experiment import Experiment
from bgmodel.explorer.panels import CIRCUIT, MEASURES, Memory, panels
from bgmodel.explorer.state import ExplorerState, opened
from bgmodel.plots import labelled
from circuits.anatomy import load_circuit
from circuits.declaration.table_writer import text
from tests.explorer.helpers import small
from tests.helpers import run

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")


@pytest.fixture(scope="module")
def memory():
    return Memory()


@pytest.fixture(scope="module")
def shown(memory):
    """Return the panels of an edited circuit by name."""
    state = small("macaque", "population", "lesion STN 10%", "add D1->GPe weight=-0.1 delay_ms=4")
    return state, {panel.name: panel for panel in panels(state, memory, workers=1)}


def test_the_numbers_are_those_that_the_command_prints(shown, tmp_path, capsys):
    state, by = shown
    file = tmp_path / "copied.toml"
    file.write_text(state.experiment.to_toml())
    assert run("experiment", file, "--workers", 1) == 0
    printed = capsys.readouterr().out
    (table,) = by[MEASURES].tables
    assert [*table["Measure"]] == [*map(labelled, MEASURED)]
    for measure, (_, *cells) in zip(MEASURED, table.to_numpy(), strict=True):
        line = re.search(rf"^{measure} .*$", printed, re.MULTILINE)
        if line is None:
            # The command leaves out what is unknown, or repeats another measure.
            assert measure in (*OF_ALL, *OF_DIFFUSION)
            continue
        assert line[0].split()[1:] == " ".join(cells).split()


def test_an_experiment_shows_its_source_and_the_verdicts_of_the_command(tmp_path, capsys):
    state = small("stn_conflict", "algebra", *opened("stn_conflict").edits)
    file = tmp_path / "copied.toml"
    file.write_text(state.experiment.to_toml())
    assert run("experiment", file, "--workers", 1) == 0
    printed = capsys.readouterr().out
    by = {panel.name: panel for panel in panels(state, Memory(), workers=1)}
    verdicts = [told.removeprefix("the model ") for told in by[MEASURES].tables[0]["Verdict"]]
    assert len(verdicts) == len(state.experiment.predictions) > 0
    assert verdicts == re.findall(r"the model (agrees|disagrees|leaves it open)$", printed, re.M)
    assert state.experiment.source in by[MEASURES].text


def test_the_python_that_is_copied_computes_the_same(shown, memory):
    state, _ = shown
    code = state.experiment.to_python().replace("print(", "found = (")
    names = {}
    exec(code, names)
    assert names["experiment"] == state.experiment
    assert names["found"].equals(memory.outcome[1].summary())


def test_a_run_that_is_refused_says_so_in_the_sentence_of_the_command(tmp_path, capsys):
    many = small("macaque", "algebra", "dopamine 0.9").experiment.to_toml()
    few = many.replace("trials = 120", "trials = 60")
    assert few != many
    state = ExplorerState(Experiment.from_text(few))
    by = {panel.name: panel for panel in panels(state, Memory(), workers=1)}
    assert by[MEASURES].refused
    assert not by[CIRCUIT].refused
    file = tmp_path / "few.toml"
    file.write_text(few)
    assert run("experiment", file) == 2
    assert capsys.readouterr().err.strip() == f"bgmodel: {by[MEASURES].text}"


@pytest.mark.parametrize(("level", "oscillates"), [(0.3, "no"), (0.1, "yes")])
def test_the_circuit_says_whether_it_oscillates(level, oscillates):
    state = small("macaque", "algebra", f"dopamine {level}")
    (panel,) = (p for p in panels(state, Memory(), workers=1) if p.name == CIRCUIT)
    _, *cells = panel.tables[0].iloc[0]
    assert [cell.split(",")[0] for cell in cells] == ["no", oscillates]


def test_names_are_text_and_not_mathematics_or_markup(tmp_path):
    name = "<script>alert(1)</script> $x^$ & "
    file = tmp_path / "odd.toml"
    file.write_text(text(load_circuit("macaque")).replace('name = "macaque"', f'name = "{name}"'))
    state = small(str(file))
    for panel in panels(state, Memory(), workers=1):
        assert not panel.refused
        assert "<script>" not in panel.svg + panel.folded
