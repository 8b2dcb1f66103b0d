"""The panels of a state, as records."""

import re
from xml.etree import ElementTree

import pytest

from bgmodel.deciding.measures import MEASURES as MEASURED
from bgmodel.deciding.measures import OF_ALL, OF_DIFFUSION
from bgmodel.experiments.experiment import Experiment
from bgmodel.explorer.panels import CIRCUIT, KEPT, MEASURES, Memory, panels
from bgmodel.explorer.state import State, opened
from bgmodel.plots import labelled
from circuits.laws.stability import growth
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


def test_each_figure_is_a_whole_svg_in_which_text_is_text(shown):
    _, by = shown
    for panel in by.values():
        if panel.svg:
            root = ElementTree.fromstring(panel.svg)
            assert root.tag.endswith("svg")
            assert list(root.iter("{http://www.w3.org/2000/svg}text"))
    ids = {group.get("id") for group in ElementTree.fromstring(by[CIRCUIT].svg).iter()}
    assert {"STN", "STN->GPe", "D1->GPe"} <= ids


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
    verdicts = [text.removeprefix("the model ") for text in by[MEASURES].tables[0]["Verdict"]]
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
    text = small("macaque", "algebra", "dopamine 0.9").experiment.to_toml()
    few = text.replace("trials = 120", "trials = 60")
    assert few != text
    state = State(Experiment.from_text(few))
    by = {panel.name: panel for panel in panels(state, Memory(), workers=1)}
    assert by[MEASURES].refused
    assert not by[CIRCUIT].refused
    file = tmp_path / "few.toml"
    file.write_text(few)
    assert run("experiment", file) == 2
    assert capsys.readouterr().err.strip() == f"bgmodel: {by[MEASURES].text}"


def test_the_rows_stay_and_a_diffusion_that_is_unknown_has_its_reason():
    """A short deadline cuts off many trials, so that a diffusion would be wrong."""
    short = small("macaque", "algebra", "lesion D1 20%").with_setting("t_max", 4)
    by = {p.name: p for p in panels(short, Memory(), workers=1)}
    assert [*by[MEASURES].tables[0]["Measure"]] == [*map(labelled, MEASURED)]
    assert re.search("^drift,", by[MEASURES].text, re.MULTILINE)
    three = small("macaque", "algebra").with_setting("channels", 3)
    by = {p.name: p for p in panels(three, Memory(), workers=1)}
    rows = [labelled(name) for name in MEASURED if name not in OF_DIFFUSION]
    assert [*by[MEASURES].tables[0]["Measure"]] == rows


@pytest.mark.parametrize(("level", "oscillates"), [(0.3, "no"), (0.1, "yes")])
def test_the_circuit_says_whether_it_oscillates(level, oscillates):
    """Its fixed point loses stability at a level of dopamine between these two."""
    state = small("macaque", "algebra", f"dopamine {level}")
    assert (growth(state.circuit.steady).real < 0) == (oscillates == "no")
    (panel,) = (p for p in panels(state, Memory(), workers=1) if p.name == CIRCUIT)
    _, *cells = panel.tables[0].iloc[0]
    assert [cell.split(",")[0] for cell in cells] == ["no", oscillates]


def test_names_are_text_and_not_mathematics_or_markup(tmp_path):
    from circuits.anatomy import load_circuit
    from circuits.declaration.table_writer import text

    name = "<script>alert(1)</script> $x^$ & "
    file = tmp_path / "odd.toml"
    file.write_text(text(load_circuit("macaque")).replace('name = "macaque"', f'name = "{name}"'))
    state = small(str(file))
    for panel in panels(state, Memory(), workers=1):
        assert not panel.refused
        assert "<script>" not in panel.svg + panel.folded


def test_what_is_remembered_does_not_grow():
    memory = Memory()
    for k in range(20):
        state = small("bogacz_gurney").with_setting("seed", k)
        memory.evidence(state)
    assert len(memory.others.kinds["evidence"]) == KEPT
    assert memory.evidence(state) is memory.evidence(state)
