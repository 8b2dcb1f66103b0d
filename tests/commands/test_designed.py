"""The command `circuit designed`."""

import json

import pandas as pd

from bgmodel.support.files import provenance_path
from tests.helpers import run

COMMAND = ("circuit", "designed")
QUICK = ("--engine", "algebra", "--thresholds", 0.3)


def test_it_prints_a_table_with_a_legend_and_json_holds_the_same(tmp_path, capsys):
    assert run(*COMMAND, "--circuit", "bogacz_gurney", *QUICK) == 0
    shown = capsys.readouterr().out
    assert "1 close, 2 hopeless    same lead" in shown
    assert "MSPRT: follows, at most 0 ms" in shown
    assert "same average: of the competitors: max vs average predicts none." in shown
    out = tmp_path / "a.csv"
    assert run(*COMMAND, "--circuit", "bogacz_gurney", *QUICK, "--json", "--output", out) == 0
    told = capsys.readouterr()
    found, kept = json.loads(told.out), pd.read_csv(out, comment="#")
    assert found["outcomes"]["max vs average"] == "told apart"
    assert (found["circuit"], found["trials"]) == ("bogacz_gurney", 1)
    assert len(found["records"]) == len(kept) == 15
    assert "1 trials per design -> " in told.err
    behind = json.loads(provenance_path(out).read_text())["parameters"]
    assert behind["circuit"]["name"] == "bogacz_gurney"
    assert behind["command"]["thresholds"] == [0.3]
    # This table has no default gain: in nats any gain works, and 1 is used.
    assert behind["command"]["gain"] == 1


def test_it_takes_a_table_of_ones_own_edits_and_noise(tmp_path, capsys):
    mine = tmp_path / "mine.toml"
    assert run("circuit", "show", "macaque", "--channels", 5, "--save", mine) == 0
    capsys.readouterr()
    given = ("--trials", 3, "--thresholds", 0.3, "--edits", "dopamine 1.01", "--seed", 2)
    assert run(*COMMAND, "--circuit", mine, *given) == 0
    one = capsys.readouterr().out
    assert "1 close, 3 hopeless" in one
    assert run(*COMMAND, "--circuit", mine, *given, "--workers", 1) == 0
    assert capsys.readouterr().out == one
