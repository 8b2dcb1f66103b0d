"""One set of guards: what one reader of trials refuses or doubts, all of them do."""

import numpy as np
import pandas as pd
import pytest

from bgmodel.stopping.people import read_people
from bgmodel.trials.evidence_table import read_evidence_table
from bgmodel.trials.reader import read_trials
from circuits.errors import DataWarning
from tests.helpers import refused
from tests.read import ROWS, table_of, written

READERS = {
    "choices": lambda data: read_trials(data, strength="coherence"),
    "stop signals": read_people,
    "pairs": read_trials,
}
EACH = pytest.mark.parametrize("kind", READERS)


def first(value, rest):
    return [value, *[rest] * (ROWS - 1)]


def seen(data):
    """Return people and times of what a reader returns."""
    if isinstance(data, dict):
        return {who: one.rt_ms / 1000 for who, one in data.items()}
    return {who: data.rt_s[data.participant == who] for who in data.people()}


@EACH
@pytest.mark.parametrize("ending", [".csv", ".tsv", ".parquet"])
def test_a_frame_and_its_file_are_the_same_trials(kind, ending, tmp_path):
    table = table_of(kind)
    file = written(table, tmp_path / f"trials{ending}")
    frame, again = (seen(READERS[kind](each)) for each in (table, file))
    assert [*frame] == [*again] == ["a", "b"]
    for who, times in frame.items():
        np.testing.assert_allclose(again[who], times)


BAD = {
    "rt above 0 s, got '0.0' in row 0.*leave rt and": {"rt": first(0.0, 0.5)},
    "rt above 0 s, got .-0.08. in row 0": {"rt": first(-0.08, 0.5)},
    "rt must be in seconds, got a median of 600: divide by 1000": {
        "rt": np.linspace(400, 800, ROWS)
    },
    "rt finite number, got '0,41' in row 0": {"rt": first("0,41", "0.5")},
    "rt finite number, got .omission. in row 0": {"rt": first("omission", "0.5")},
    "rt seconds in every trial": {"rt": [*[0.5] * 24, *[40.0] * 24]},
    "participant_id every trial, got nothing": {"participant_id": first("", "a")},
    "participant_id differ only in blanks": {"participant_id": first("a ", "a")},
}


@EACH
@pytest.mark.parametrize("ending", [None, ".csv"])
@pytest.mark.parametrize("says", BAD)
def test_what_one_reader_refuses_all_refuse(kind, ending, says, tmp_path):
    table = table_of(kind, **BAD[says])
    data = table if ending is None else written(table, tmp_path / f"trials{ending}")
    with refused(says) as caught:
        READERS[kind](data)
    assert str(caught.value).startswith("a table: " if ending is None else "trials.csv: ")


FILES = [
    ("a.csv", "", "path can't be read as .csv"),
    ("a.csv", "trial,step\n0,0,1\n", "path a row has more cells than the header"),
    ("a.csv", "\ntrial,step\n007,0\n", "path first line is blank"),
    ("a.csv", "\ufeff\r\ntrial,step\r\n007,0\r\n", "path first line is blank"),
    ("a.csv", "trial;step\n0;0\n", "path separated by ';'.*a point as the decimal"),
    ("a.csv", "trial\tstep\n0\t0\n", "path separated by"),
    ("a.tsv", "trial,step\n0,0\n", "path separated by ','"),
    ("a.csv", "trial,ll_a\n0,1,5\n", "path decimal sign a comma"),
    ("a.csv", "trial,ll_a\n0,1\n0,1,5\n", "path decimal sign a comma"),
    ("a.csv", "rt,ssd,rt\n0.5,1,1\n", "columns each column may occur once"),
    ("a.csv", "trial,step,ll_a,ll_b,rt,ssd\n", "table at least one trial"),
    ("a.csv", "rt,übung\n".encode("latin-1"), "path it is not text in UTF-8"),
    ("a.parquet", "rt\n0.5\n", r"path can't be read as \.parquet"),
    ("a.txt", "rt\n0.5\n", "path a table is read from"),
    ("absent.csv", None, "path there is no table .*"),
    ("absent.parquet", None, "path there is no table .*"),
]


@pytest.mark.parametrize("reader", [read_trials, read_people, read_evidence_table])
@pytest.mark.parametrize(("name", "text", "says"), FILES)
def test_a_bad_file_gets_one_sentence_with_its_name(reader, name, text, says, tmp_path):
    if text is not None:
        (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    with refused(says) as raised:
        reader(tmp_path / name)
    assert name in str(raised.value)


@EACH
def test_ids_are_text_as_written(kind, tmp_path):
    table = table_of(kind, participant_id=np.repeat(["NA", "01"], ROWS // 2))
    for data in (table, written(table, tmp_path / "trials.csv")):
        assert [*seen(READERS[kind](data))] == ["01", "NA"]
    numbered = table_of(kind, participant_id=np.repeat(["01", "1"], ROWS // 2))
    with pytest.warns(DataWarning, match="in how a number is written"):
        assert len(seen(READERS[kind](written(numbered, tmp_path / "trials.csv")))) == 2


@EACH
def test_one_person_under_two_names_is_doubted(kind):
    half = table_of(kind)[: ROWS // 2]
    twice = pd.concat([half, half.assign(participant_id="b")], ignore_index=True)
    with pytest.warns(DataWarning, match="the same times and responses"):
        READERS[kind](twice)


@EACH
def test_names_of_columns_are_those_of_this_package_or_named(kind):
    for names, says in (
        ({"rt": "rt_ms"}, "rt there is no column rt; there are participant_id, rt_ms"),
        ({"rt": "RT [ms]"}, r"rt there is no column rt; there are participant_id, RT \[ms\]"),
        ({"rt": "RT"}, "rt column 'RT' is not 'rt'"),
        ({"participant_id": "subject"}, "participant 'subject' seems to hold participants"),
        (
            {"rt": "rt_ms", "participant_id": "subject"},
            r"rt .*Columns\(rt=\.\.\., participant=\.\.\.\)",
        ),
    ):
        with refused(says):
            READERS[kind](table_of(kind).rename(columns=names))
