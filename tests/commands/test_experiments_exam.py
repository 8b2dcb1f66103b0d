"""The command of the exam: lists, results in three kinds of files, and refusals."""

import json

import pandas as pd
import pytest

from bgmodel.exam.exam import Exam
from bgmodel.support.files import read_provenance, read_table
from tests.helpers import run

FEW = ("--domains", "resting rates", "--share", "0.05", "--workers", "1")


def test_it_lists_numbers_and_tasks(capsys):
    assert run("exam") == 0
    assert "rest.stn" in capsys.readouterr().out
    assert run("exam", "--json") == 0
    listed = json.loads(capsys.readouterr().out)
    assert len(listed["records"]) == len(Exam.shipped().numbers)
    assert run("exam", "--tasks") == 0
    assert "rate_hz" in capsys.readouterr().out


def test_a_circuit_takes_the_exam_and_its_marks_are_written(tmp_path, capsys, monkeypatch):
    taken, take = [], Exam.take

    def once(*arguments, **named):
        taken.append(take(*arguments, **named) if not taken else taken[0])
        return taken[0]

    monkeypatch.setattr("bgmodel.commands.experiments.Exam.take", once)
    files = [tmp_path / "exam.json", tmp_path / "exam.csv"]
    picture = tmp_path / "exam.png"
    assert run("exam", "macaque", "--save", files[0], "--plot", picture, *FEW, "--json") == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["domains"][0]["domain"] == "resting rates"
    assert picture.stat().st_size > 10_000
    assert json.loads(files[0].read_text())["examinee"] == "macaque"
    assert run("exam", "macaque", "--save", files[1], *FEW) == 0
    assert len(read_table(files[1])) == len(shown["records"])
    assert read_provenance(files[1])["parameters"]["circuits"]["2"]["name"] == "macaque"


def test_rates_from_elsewhere_are_marked(tmp_path, capsys):
    table = {"task": "rest", "nucleus": "STN", "window": "rest", "rate_hz": [18.0, 20.0] * 20}
    pd.DataFrame(table).to_csv(tmp_path / "rates.csv", index=False)
    assert run("exam", "--rates", tmp_path / "rates.csv", "--json") == 0
    rows = pd.DataFrame(json.loads(capsys.readouterr().out)["records"]).set_index("id")
    assert rows["outcome"]["rest.stn"] == "agrees"
    assert rows["outcome"]["dbs.none"] == "not answered"


def test_contradictions_are_refused_in_one_sentence(tmp_path, refusal):
    pd.DataFrame({"task": ["rest"], "rate": [1]}).to_csv(tmp_path / "rates.csv", index=False)
    for circuit in (("macaque",), ()):
        assert len(refusal("exam", *circuit, "--rates", tmp_path / "rates.csv").splitlines()) == 1


@pytest.mark.parametrize("motifs", [True, False])
def test_motifs_are_left_out_on_request(motifs, capsys):
    asked = () if motifs else ("--no-motifs",)
    assert run("exam", "macaque", *FEW, *asked, "--json") == 0
    assert json.loads(capsys.readouterr().out)["motifs"] is motifs
