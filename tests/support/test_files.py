"""Result files: complete or absent, with their provenance."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bgmodel.simulated_evidence import separated_evidence
from bgmodel.support.files import (
    check_new,
    provenance,
    read_provenance,
    read_table,
    recorded,
    write_table,
)
from bgmodel.support.seeds import stream
from tests.helpers import long_table, refused


@pytest.mark.parametrize("ending", ["parquet", "csv"])
def test_a_table_reads_back_with_its_provenance(tmp_path, decided_trials, ending):
    path = write_table(
        decided_trials, tmp_path / f"t.{ending}", seed=1, delta=np.float64(2), gaps=(1, 2)
    )
    about = read_provenance(path)
    assert about["seed"] == 1
    assert about["parameters"] == {"delta": 2.0, "gaps": [1, 2]}
    assert {"bgmodel", "numpy", "python"} <= set(about["versions"])
    back = read_table(path)
    assert back["rt"].equals(decided_trials["rt"])
    first = path.read_bytes()
    write_table(decided_trials, path, seed=1, delta=np.float64(2), gaps=(1, 2))
    assert path.read_bytes() == first
    assert not list(tmp_path.glob(".*"))


@dataclass(frozen=True)
class Asked:
    level: np.float64
    place: Path


def test_parameters_of_any_kind_are_kept_as_plain_values_and_files_by_name():
    asked = Asked(np.float64(0.5), Path("/somewhere/mine.csv"))
    kept = provenance(
        of=asked,
        more={1: (True, None), "kind": Asked},
        line=np.array([1, 2]),
        path=asked.place,
        whole=np.int64(3),
    )["parameters"]
    assert kept["of"] == {"kind": "Asked", "level": 0.5, "place": "mine.csv"}
    assert kept["more"] == {"1": [True, None], "kind": str(Asked)}
    assert (kept["line"], kept["path"], kept["whole"]) == ([1, 2], "mine.csv", 3)
    assert json.loads(json.dumps(kept)) == kept


def test_a_place_is_taken_by_a_file_or_a_link_to_nothing_unless_by_force(tmp_path):
    file, link = tmp_path / "file.csv", tmp_path / "link.csv"
    file.write_text("mine")
    link.symlink_to(tmp_path / "nothing")
    for path in (file, link):
        with refused("path already exists"):
            check_new(path)
        check_new(path, force=True)
    check_new(tmp_path / "free.csv")
    check_new(tmp_path / ("y" * 196 + ".csv"))
    with refused("path has at most 200 bytes"):
        check_new(tmp_path / ("y" * 197 + ".csv"))


def test_a_folder_is_recorded_by_its_targets_and_images_and_by_nothing_else(tmp_path):
    folder = tmp_path / "part"
    texts = {"targets.csv": "1", "images/1.png": "2", "../frames_bw/3.PNG": "3"}
    for name, text in texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    about = recorded(folder)
    assert about["folder"] == "part"
    for other in ("notes.txt", "model.onnx", "images/log.csv"):
        (folder / other).write_text("other")
        assert recorded(folder) == about
    for name, text in texts.items():
        (folder / name).write_text("0")  # of the same size
        assert recorded(folder) != about
        (folder / name).write_text(text)
    assert recorded(folder.rename(tmp_path / "again")) == about | {"folder": "again"}
    (tmp_path / "again/images/1.png").rename(tmp_path / "again/images/2.png")
    assert recorded(tmp_path / "again")["sha256"] != about["sha256"]


def test_a_failed_write_leaves_the_old_file(tmp_path, decided_trials, monkeypatch):
    path = write_table(decided_trials, tmp_path / "t.parquet")
    before = path.read_bytes()
    monkeypatch.setattr("pyarrow.parquet.write_table", lambda *a, **k: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write_table(decided_trials.head(1), path)
    assert path.read_bytes() == before

    def half(table, partial, **options):
        partial.write_text("half")
        raise OSError("no space")

    monkeypatch.setattr(pd.DataFrame, "to_csv", half)
    with pytest.raises(OSError, match="no space"):
        write_table(decided_trials, tmp_path / "u.csv")
    assert [entry.name for entry in tmp_path.iterdir()] == ["t.parquet"]


def test_files_that_are_no_tables_get_one_clear_sentence(tmp_path):
    good = long_table(separated_evidence(7, 4, 1.0, rng=stream(1, "tables")))
    with refused("path there is no table"):
        read_table(tmp_path / "absent.csv")
    with refused(r"path \.parquet or \.csv"):
        write_table(good, tmp_path / "t.xlsx")
    (tmp_path / "file").write_text("")
    with refused("folder"):
        write_table(good, tmp_path / "file" / "t.csv")


def test_provenance_never_goes_over_a_file_that_is_none(tmp_path, decided_trials):
    foreign = tmp_path / "t.csv.json"
    for text in ('{"mine": 1}', "no JSON", "[]"):
        foreign.write_text(text)
        with refused("path is not a file of parameters"):
            write_table(decided_trials, tmp_path / "t.csv")
        assert foreign.read_text() == text
        assert not (tmp_path / "t.csv").exists()
    foreign.unlink()
    (tmp_path / "t.json").write_text("mine too")
    write_table(decided_trials, tmp_path / "t.csv")
    write_table(decided_trials, tmp_path / "t.csv", other=1)
    assert (tmp_path / "t.json").read_text() == "mine too"
    assert read_provenance(tmp_path / "t.csv")["parameters"] == {"other": 1}


def test_types_that_only_pandas_knows_come_back(tmp_path):
    table = pd.DataFrame({"count": pd.array([1, None], dtype="Int64"), "half": [0.5, 1.5]})
    back = read_table(write_table(table, tmp_path / "t.parquet"))
    pd.testing.assert_frame_equal(back, table)
