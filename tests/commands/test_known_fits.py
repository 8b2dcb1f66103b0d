"""The command `fit` with --evidence."""

import json
from pathlib import Path

import pytest

from bgmodel.commands.known_fits import TABLES
from bgmodel.support.files import read_provenance
from tests.fitting.known.test_table import tables
from tests.helpers import run
from tests.known_trials import simulated

QUICK = ["--models", "msprt", "run", "--evidence", "forced=true"]


@pytest.fixture(autouse=True)
def mine(tmp_path, monkeypatch):
    """Write valid tables in a new working folder."""
    monkeypatch.chdir(tmp_path)
    data, evidence = tables(simulated(60, 61))
    data.to_csv("trials.csv", index=False)
    evidence.to_csv("evidence.csv", index=False)


def test_it_writes_tables_and_a_figure_and_prints_json(capsys):
    assert run("fit", "trials.csv", "--evidence", "evidence.csv", *QUICK, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert {row["model"] for row in found["records"]} == {"msprt", "run"}
    assert found["parameters"]
    folder = Path("fits/trials")
    assert {path.name for path in folder.iterdir()} >= {*TABLES, "known_all.png"}
    behind = read_provenance(folder / TABLES[0])["parameters"]
    assert behind["evidence_sha256"]
    assert behind["forced"] is True
    assert run("fit", "trials.csv", "--evidence", "evidence.csv", *QUICK) == 2
    assert run("fit", "trials.csv", "--evidence", "evidence.csv", *QUICK, "--force") == 0


@pytest.mark.parametrize(
    "arguments",
    [
        ["--evidence", "evidence.csv", *QUICK, "--strength", "x"],
        ["--evidence", "evidence.csv", *QUICK, "--draws"],
        ["--evidence", "nothing.csv", *QUICK],
        ["--evidence", "evidence.csv", "--models", "ddm"],
        ["--evidence", "evidence.csv", *QUICK, "--evidence", "step_ms=50"],
        ["--evidence", "step_ms=50"],
        ["--evidence", "forced=true"],
    ],
)
def test_mistakes_end_with_one_sentence_and_no_file(capsys, arguments):
    assert run("fit", "trials.csv", *arguments) == 2
    assert capsys.readouterr().err.splitlines()[-1].startswith("bgmodel: ")
    assert not Path("fits").exists()
