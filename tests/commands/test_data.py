"""The command `data`."""

import json

import pandas as pd
import pytest

from bgmodel.support.files import provenance_path, read_provenance
from bgmodel.tables.choices import read_choices, shipped
from bgmodel.tables.shipped import OTHERS, every_set
from tests.helpers import ROOT, run

NO_LICENCE = "No repository states a licence for the data apart from its code."
SHIPPED = shipped()


def test_the_list_names_every_set_with_its_citation_and_licence(capsys):
    assert run("data") == 0
    shown = capsys.readouterr().out
    for one in SHIPPED.values():
        assert f"{one.name}: {one.trials} trials of {one.people} participants" in shown
        assert one.citation in shown
        assert f"{one.licence} (bgmodel/data/{one.licence_file}). {NO_LICENCE}" in shown
        assert (ROOT / "bgmodel" / "data" / one.licence_file).read_text().count("Redistribution")
    assert run("data", "--json") == 0
    listed = json.loads(capsys.readouterr().out)["records"]
    assert [row["name"] for row in listed] == [*SHIPPED, *OTHERS]
    assert [row["participants"] for row in listed] == [2, 6, 14, 28, 126, 56]


def test_a_set_is_shown_by_participant_and_condition(capsys):
    assert run("data", "roitman_shadlen_2002") == 0
    shown = capsys.readouterr().out
    row = next(line.split() for line in shown.splitlines() if line.split()[:2] == ["b", "0.000"])
    assert row == ["b", "0.000", "432", "0", "NaN", "0.788", "0.197", "0.559", "0.763", "1.037"]
    assert run("data", "cavanagh_2011", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["checksum"] == read_choices("cavanagh_2011", conditions=CONDITIONS).checksum
    assert len(found["records"]) == 14 * 4
    assert sum(row["trials"] for row in found["records"]) == 3988


CONDITIONS = ("conflict", "stimulation")


@pytest.mark.parametrize(("name", "cells"), [(OTHERS[0], 126), (OTHERS[1], 28 * 3 + 28 * 2 * 3)])
def test_a_set_that_is_no_choices_is_shown_by_its_trials_and_responses(
    tmp_path, capsys, name, cells
):
    out = tmp_path / "mine.csv"
    assert run("data", name, "--out", out, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    one = every_set()[name]
    assert len(found["records"]) == cells
    assert sum(row["trials"] for row in found["records"]) == one.trials == len(pd.read_csv(out))
    assert sum(row["responses"] for row in found["records"]) == one.table["rt"].count()
    assert set(found["columns"]) == set(one.columns)
    assert run("data", name) == 0
    assert "CC0-1.0. " in capsys.readouterr().out


@pytest.mark.parametrize("name", SHIPPED)
@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_written_set_is_read_back_as_the_shipped_one(tmp_path, capsys, name, ending):
    out = tmp_path / f"mine.{ending}"
    assert run("data", name, "--out", out) == 0
    assert f"{SHIPPED[name].trials} trials -> {out}" in capsys.readouterr().out
    known = {"strength": SHIPPED[name].strength, "conditions": SHIPPED[name].conditions}
    assert read_choices(out, **known).checksum == read_choices(name, **known).checksum
    kept = read_provenance(out)["parameters"]
    assert (kept["citation"], kept["note"]) == (SHIPPED[name].citation, NO_LICENCE)


def test_nothing_is_written_over_a_file_that_is_there(tmp_path, refusal):
    out = tmp_path / "mine.csv"
    out.write_text("dear diary")
    assert "already exists" in refusal("data", "palmer_huk_shadlen_2005", "--out", out)
    assert out.read_text() == "dear diary"
    assert run("data", "palmer_huk_shadlen_2005", "--out", out, "--force") == 0
    assert len(pd.read_csv(out)) == 3373
    assert provenance_path(out).exists()


def test_a_set_that_can_not_be_written_whole_is_not_written(tmp_path, monkeypatch):
    def stop(*given, **named):
        raise OSError("the disk is full")

    monkeypatch.setattr(pd.DataFrame, "to_csv", stop)
    assert run("data", "cavanagh_2011", "--out", tmp_path / "mine.csv") == 2
    assert list(tmp_path.iterdir()) == []
