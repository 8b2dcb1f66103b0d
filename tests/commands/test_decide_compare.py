"""The command `compare`."""

import json
import re
from unittest.mock import Mock

import numpy as np
import pandas as pd

from bgmodel.evidence import Evidence
from bgmodel.names import MACAQUE
from bgmodel.support.files import provenance_path
from circuits.anatomy import DEFAULT
from tests.helpers import long_table, run, words

FIXED_POINT = words("--engine algebra --task d_prime=1 t_max=20 --accuracies 0.9")
SMALL = words("--circuit macaque_small --task trials=100 d_prime=1 t_max=20 --edits 'neurons 100'")


def test_compare_writes_the_same_bytes_for_any_number_of_workers(tmp_path, capsys):
    out = tmp_path / "a.csv"
    assert run("compare", "--save", out, *SMALL, "--accuracies", 0.9) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 24
    assert max(map(len, lines)) <= 100
    table = pd.read_csv(out, comment="#")
    assert {"circuit", "cortical decoder", "race", "LCA"} <= set(table["model"])
    behind = json.loads(provenance_path(out).read_text())
    assert behind["parameters"]["command"]["gain"] == 0.55
    again = tmp_path / "b.csv"
    assert run("compare", "--save", again, *SMALL, "--accuracies", 0.9, "--workers", 1) == 0
    assert out.read_bytes() == again.read_bytes()
    assert run("compare", "--save", out, *FIXED_POINT, "--task", "trials=100", "--force") == 0
    # Each has its thresholds near this accuracy, and one trial may fall between the two.
    assert re.search(r"at 0[.]9: same choice (1[.]000|0[.]99)", capsys.readouterr().out)


def test_compare_draws_a_figure_and_warns_next_to_the_verdict(tmp_path, capsys):
    drawing = tmp_path / "a.svg"
    asked = (*FIXED_POINT[:-1], 0.9, 0.999, "--task", "trials=100", "--plot", drawing)
    assert run("compare", "--save", tmp_path / "a.csv", *asked) == 0
    told = capsys.readouterr()
    assert "at 0.999: not reached\n    warning: " in told.out
    assert "no comparison is possible" not in told.err
    assert "<text" in drawing.read_text()
    assert f"-> {drawing}" in told.out
    assert run("compare", "--save", tmp_path / "b.csv", *asked[:-1], tmp_path / "a.doc") == 2
    assert "plot must end in" in capsys.readouterr().err


def test_a_comparison_says_how_many_circuits_run(tmp_path, refusal, monkeypatch):
    stop = ValueError("started")
    monkeypatch.setattr("bgmodel.commands.decide.comparing.compare", Mock(side_effect=stop))
    for engine, more, length in (
        ("population", (), ""),
        ("population", ("--noise-ceiling",), "2 circuits, "),
        ("population", ("--noise-ceiling", "--edits", "lesion D2 10%"), "3 circuits, "),
        ("algebra", ("--noise-ceiling",), ""),
    ):
        asked = ("compare", "--save", tmp_path / "a.csv", "--task", "trials=9000", *more)
        announced = refusal(*asked, "--engine", engine)
        assert f"comparing macaque on {engine}, {length}9000 trials" in announced


def test_json_is_all_that_stdout_holds(tmp_path, capsys):
    out = tmp_path / "a.csv"
    small = (*FIXED_POINT, "--task", "trials=100", "--json")
    assert run("compare", "--save", out, *small) == 0
    told = capsys.readouterr()
    printed, kept = json.loads(told.out), pd.read_csv(out)
    assert printed["trials"] == 100
    assert list(printed["records"][0]) == list(kept)
    values = [np.nan if r["value"] is None else r["value"] for r in printed["records"]]
    np.testing.assert_allclose(values, kept["value"], rtol=1e-9, atol=1e-12)
    assert f"-> {out}" in told.err
    assert "left out" not in told.err
    assert "json" not in json.loads(provenance_path(out).read_text())["parameters"]["command"]


def test_a_circuit_that_decides_without_evidence_is_not_compared(tmp_path, refusal):
    """Half of ctx->STN: OUT rests below every threshold."""
    compared = words("compare --task channels=3 d_prime=0.8 trials=100 t_max=10 --edits")
    compared += ["scale ctx->STN 0.5", "neurons 40"]
    assert "decide without evidence" in refusal(*compared, "--save", tmp_path / "a.csv")
    assert not list(tmp_path.iterdir())


def test_what_the_deadline_decides_is_not_compared(tmp_path, capsys):
    mine = tmp_path / "zero.csv"
    long_table(Evidence(np.zeros((100, 2, 2))), truth=False).to_csv(mine, index=False)
    options = ("--task", mine, "--engine", "algebra", "--accuracies", 0.6)
    assert run("compare", "--save", tmp_path / "a.csv", *options) == 0
    told = capsys.readouterr()
    assert "read 100 trials of 2 readings, hypotheses a, b" in told.out
    assert "not reached" in told.out
    assert "are left out: the zero of this evidence is arbitrary" in told.err
    assert pd.read_csv(tmp_path / "a.csv").query("measure == 'agreement'")["value"].isna().all()


def test_an_edited_circuit_is_also_held_to_the_intact_one(tmp_path, capsys):
    small = (*FIXED_POINT, "--task", "trials=200")
    assert run("compare", "--save", tmp_path / "a.csv", *small, "--edits", "lesion STN 10%") == 0
    shown = capsys.readouterr().out
    assert re.search(r"MSPRT at its gain:(\n  .+)+\n  circuit minus intact +-?0\.\d{3} \[", shown)
    table = pd.read_csv(tmp_path / "a.csv").query("reference == 'MSPRT at its gain'")
    values = table.pivot(index=["accuracy", "measure"], columns="model", values="value")
    assert run("compare", "--save", tmp_path / "b.csv", *small) == 0
    assert "minus intact" not in capsys.readouterr().out
    intact = pd.read_csv(tmp_path / "b.csv").query("reference == 'MSPRT at its gain'")
    intact = intact[intact["model"] == "circuit"].set_index(["accuracy", "measure"])["value"]
    change = (values["circuit"] - intact).reindex(values.index)
    np.testing.assert_allclose(values["circuit minus intact"], change, atol=1e-9)
    extra = table.query("model == 'circuit minus intact' and measure == 'extra_ms'")
    assert extra["low"].notna().all()


def test_commands_take_the_default_circuit_of_the_tables():
    assert MACAQUE == DEFAULT
