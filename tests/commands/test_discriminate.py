"""The command that searches for the experiment that tells two models apart."""

import json

import pytest

import bgmodel as bg
from bgmodel.support.files import read_provenance, read_table
from circuits.declaration import table_files
from tests.helpers import run

SPACE = """
channels = [2]
d_prime = [1.0]
accuracy = [0.85]
deadline_ms = [1000.0]
"""
FEW = ("--trials", 200, "--check-trials", 200, "--workers", 1)


@pytest.fixture
def space(tmp_path):
    path = tmp_path / "space.toml"
    path.write_text(SPACE)
    return path


def test_without_a_model_it_prints_the_space(capsys, tmp_path):
    assert run("discriminate") == 0
    path = tmp_path / "space.toml"
    path.write_text(capsys.readouterr().out)
    assert run("discriminate", "msprt", "msprt", "--space", path) == 2
    assert "one model" in capsys.readouterr().err


def test_it_writes_result_drawing_and_an_experiment_that_runs(space, tmp_path, capsys):
    table, drawing, plan = (tmp_path / name for name in ("tasks.csv", "map.png", "plan.toml"))
    edits = ("--second-edits", "lesion STN 100%", "compensate")
    options = (table, "--drawing", drawing, "--plan", plan, "--space", space, *FEW, "--json")
    assert run("discriminate", "macaque", "macaque", *options, *edits) == 0
    said = json.loads(capsys.readouterr().out)
    assert len(said["records"]) == len(read_table(table)) == 1
    assert {row["truth"] for row in said["sequential"]} == {
        "macaque", "macaque, lesion STN 100%; compensate",
    }  # fmt: skip
    assert read_provenance(table)["seed"] == 99_101
    assert drawing.stat().st_size > 1000
    bg.Experiment.from_toml(plan).check_differs()


def test_a_plan_of_two_files_edits_the_first_and_moves_with_them(space, tmp_path, monkeypatch):
    circuit = bg.load_circuit("macaque").edited("set STN.bias_nats -1.9")
    other = circuit.edited("lesion STN 20%", "set D1->SNr.weight -0.9")
    (tmp_path / "work" / "plans").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "work")
    for name, made in (("one", circuit), ("other", other)):
        table_files.write(made, f"{name}.toml")
    options = ("--plan", "plans/plan.toml", "--space", space, *FEW)
    assert run("discriminate", "one.toml", "other.toml", *options) == 0
    (tmp_path / "work").rename(tmp_path / "moved")
    plan = bg.Experiment.from_toml(tmp_path / "moved" / "plans" / "plan.toml")
    read = bg.load_circuit(plan.circuit)
    control, manipulation = (read.edited(*plan.edits, *each.edits) for each in plan.conditions)
    assert control.populations == circuit.populations
    assert manipulation.projection("D1", "SNr").weight == -0.9
    assert manipulation.population("STN").intact == 0.8


@pytest.mark.parametrize("second", ["msprt", "appendix_b"])
def test_a_plan_that_no_edits_make_is_refused_before_the_search(space, tmp_path, capsys, second):
    plan = ("--plan", tmp_path / "plan.toml", "--space", space)
    assert run("discriminate", "macaque", second, *plan, *FEW) == 2
    error = capsys.readouterr().err
    assert "check of" not in error
    assert error.count("\n") == 1
    assert not (tmp_path / "plan.toml").exists()


def test_recorded_spikes_are_a_third_measure_and_no_part_of_a_plan(space, tmp_path, capsys):
    loss = ("macaque", "--second-edits", "lesion STN 10%", "--space", space, *FEW)
    assert run("discriminate", *loss, "--nucleus", "STN", "--cells", 20, "--json") == 0
    assert json.loads(capsys.readouterr().out)["records"][0]["nats"] > 0.01
    for options in (
        ("--cells", 3),
        ("--nucleus", "SNc"),
        ("--nucleus", "STN", "--plan", tmp_path / "plan.toml"),
    ):
        assert run("discriminate", *loss, *options) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert "check of" not in error


def test_json_has_null_where_no_number_of_trials_is_enough(space, capsys):
    def refuse(constant):
        raise ValueError(constant)

    two = ("msprt", "max vs average", "--space", space)
    assert run("discriminate", *two, *FEW, "--json") == 0
    said = json.loads(capsys.readouterr().out, parse_constant=refuse)
    assert {row["median"] for row in said["sequential"]} == {None}
