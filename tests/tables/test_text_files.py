"""Text files: cells are read unchanged, or one error message names the file."""

import pytest

from bgmodel.tables.text_files import read_rows
from bgmodel.trials.reading import read_trials
from tests.helpers import refused


def test_cells_stay_as_they_are_written(tmp_path):
    path = tmp_path / "mine.csv"
    path.write_text("\ufeffparticipant_id,rt,tag\n007,0.50,NA\n7, 1e0,\n")
    table = read_rows(path)
    assert table.columns.tolist() == ["participant_id", "rt", "tag"]
    assert table.to_numpy().tolist() == [["007", "0.50", "NA"], ["7", " 1e0", ""]]


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("a.csv", "", "path can't be read as .csv"),
        ("a.csv", "rt,response\n0.5,1,2\n", "path can't be read as .csv"),
        ("a.csv", "rt;response\n0,5;1\n", "path separated by ';'"),
        ("a.csv", "rt\tresponse\n0.5\t1\n", "path separated by .*"),
        ("a.tsv", "rt,response\n0.5,1\n", "path separated by ','"),
        ("a.csv", "rt,rt,response\n0.5,1,1\n", "columns"),
        ("a.csv", "rt,response\n", "table"),
        ("a.txt", "rt,response\n0.5,1\n", "path read from .csv, .tsv or .parquet"),
        ("a.tsv", "rt\tresponse\n0,5\t1\n", "rt"),
    ],
)
def test_a_bad_file_gets_one_sentence_with_its_name(tmp_path, name, text, says):
    path = tmp_path / name
    path.write_text(text)
    with refused(says) as raised:
        read_trials(path)
    assert name in str(raised.value)
    assert "\n" not in str(raised.value)


def test_what_is_no_text_no_table_or_no_file_is_said(tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes("rt,response\nübung,1\n".encode("latin-1"))
    with refused("path it is not text in UTF-8"):
        read_trials(path)
    path.rename(tmp_path / "a.parquet")
    with refused(r"path can't be read as \.parquet"):
        read_trials(tmp_path / "a.parquet")
    with refused("path there is no table .*absent.csv"):
        read_trials(tmp_path / "absent.csv")
    with refused("source"):
        read_trials("roitman")
