"""Users' circuit files, wherever the name of a circuit is accepted."""

import json
from dataclasses import replace

import pytest

from bgmodel.support.files import provenance_path
from circuits import anatomy
from circuits.declaration import table_writer
from circuits.declaration.table_writer import digest
from circuits.errors import EditWarning
from tests.helpers import GOOD, run

SMALL = ["--task", "trials=100", "t_max=6", "--engine", "rate"]


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def about(path):
    return json.loads(provenance_path(path).read_text())["parameters"]


def test_show_saves_a_table_as_edited_and_shows_it_again(here, capsys):
    edits = ["--channels", 3, "--edits", "lesion STN 50%", "lesion GPe[1] 25%"]
    assert run("circuit", "show", "spiking_msprt", *edits, "--save", "mine.toml") == 0
    first = capsys.readouterr().out
    assert first.splitlines()[-1] == "spiking_msprt, 3 channels -> mine.toml"
    lesioned = anatomy.spiking_msprt(3).lesion("STN", 0.5).lesion("GPe", 0.25, channel=1)
    assert anatomy.load_circuit(here / "mine.toml") == replace(lesioned, name="mine")
    assert run("circuit", "show", "mine.toml") == 0
    shown = first[: first.index("\n\nedited")].strip()
    # Lines break elsewhere after another name.
    assert capsys.readouterr().out.split() == shown.replace("spiking_msprt", "mine", 1).split()


def test_a_saved_table_is_written_over_only_when_forced_and_never_while_it_is_read(here, refusal):
    assert run("circuit", "show", "gpr", "--save", "mine.toml") == 0
    before = (here / "mine.toml").read_bytes()
    four = ("circuit", "show", "gpr", "--save", "mine.toml", "--channels", 4)
    assert "'mine.toml' already exists" in refusal(*four)
    onto_itself = ("circuit", "show", "mine.toml", "--save", "mine.toml", "--force")
    assert "circuit and save are the same file" in refusal(*onto_itself)
    assert (here / "mine.toml").read_bytes() == before
    assert run(*four, "--force") == 0
    assert anatomy.load_circuit("mine.toml").channels == 4
    assert [path.name for path in here.iterdir()] == ["mine.toml"]


@pytest.mark.parametrize("command", ["circuit run", "compare"])
def test_a_file_runs_as_the_table_that_it_was_written_from(here, command):
    table_writer.write(anatomy.spiking_msprt(2), "mine.toml")
    for name, output in (("spiking_msprt", "a.csv"), ("mine.toml", "b.csv")):
        assert run(*command.split(), "--save", output, "--circuit", name, *SMALL) == 0
    assert (here / "a.csv").read_bytes() == (here / "b.csv").read_bytes()
    behind = {"name": "spiking_msprt", "sha256": digest(anatomy.spiking_msprt(2))}
    assert about(here / "a.csv")["circuit"] == about(here / "b.csv")["circuit"] == behind
    assert about(here / "a.csv")["command"]["circuit"] == "spiking_msprt"
    assert about(here / "b.csv")["command"]["circuit"]["file"] == "mine.toml"


def test_a_file_is_exact_only_if_its_rows_are_and_rows_that_fit_any_number_are_no_mistake(here):
    exact = anatomy.bogacz_gurney(2)
    rows = tuple(replace(p, weight=p.weight / 2) if p.name == "STN->SNr" else p
                 for p in exact.projections)  # fmt: skip
    table_writer.write(replace(exact, projections=rows), "mine.toml")
    with pytest.warns(EditWarning, match="OUT is not -ln P: sum: .*off by -0.5$") as caught:
        assert not anatomy.load_circuit("mine.toml").exact
    assert len(caught) == 1  # biases of bogacz_gurney are the same for any number of channels
    for exact in (anatomy.bogacz_gurney(3), anatomy.appendix_b(4)):
        table_writer.write(replace(exact, name="other"), f"{exact.name}.toml")
        assert anatomy.load_circuit(f"{exact.name}.toml").exact


def test_the_hash_in_a_result_is_that_of_the_circuit_as_edited(here):
    assert run("circuit", "run", "--save", "a.csv", *SMALL, "--edits", "lesion D2 50%") == 0
    assert about(here / "a.csv")["circuit"]["sha256"] == digest(anatomy.macaque().lesion("D2", 0.5))


def test_an_experiment_names_a_file_as_seen_from_its_own(here, refusal):
    (here / "in" / "tables").mkdir(parents=True)
    table_writer.write(anatomy.spiking_msprt(2), here / "in" / "tables" / "mine.toml")
    file, text = here / "in" / "experiment.toml", GOOD.replace("spiking_msprt", "tables/mine.toml")
    file.write_text(text)
    assert run("experiment", "in/experiment.toml", "--save", "a.csv") == 0
    behind = about(here / "a.csv")
    assert behind["experiment"]["circuit"]["file"] == "mine.toml"
    assert behind["experiment"]["gain"] == 0.7
    assert behind["control"]["sha256"] == digest(anatomy.spiking_msprt())
    assert behind["manipulation"]["sha256"] == digest(anatomy.spiking_msprt().lesion("STN", 0.2))
    file.write_text(GOOD)
    assert run("experiment", file, "--save", "b.csv") == 0
    assert (here / "a.csv").read_bytes() == (here / "b.csv").read_bytes()
    file.write_text(text.replace("tables/", ""))
    asked = ("experiment", file, "--save", "c.csv")
    assert "mine.toml' can't be read: No such file" in refusal(*asked)
