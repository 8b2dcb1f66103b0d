"""Users' tables: their files, columns of other names or units, and those of PyDDM and HSSM."""

import numpy as np
import pytest

from bgmodel.trials.reader import Columns, read_trials
from bgmodel.trials.record import Trials
from tests.helpers import refused, unwarned
from tests.read import read
from tests.trials.test_reader import READ, people, silent

OTHER = {"rt": "latency", "response": "key", "participant_id": "who"}
NAMED = {"rt": "latency", "response": "key", "participant": "who"}


def same(actual, expected):
    """Whether two tables of choices hold the same trials."""
    return actual.checksum == expected.checksum


def test_columns_of_other_names_are_the_same_trials():
    table = people()
    with unwarned():
        trials = read(table.rename(columns=OTHER), **READ, **NAMED)
    assert same(trials, read_trials(table, **READ))
    other = table.assign(rt=table["rt"] + 0.01).rename(columns=OTHER)
    assert not same(read(other, **READ, **NAMED), trials)


def test_milliseconds_are_the_same_times():
    table = people()
    trials = read_trials(table.assign(rt=1000 * table["rt"]), **READ, columns=Columns(rt_unit="ms"))
    assert trials.rt_s == pytest.approx(table["rt"].to_numpy(), rel=1e-12)
    with refused(r"rt must be in seconds, .*rt_unit='ms'"):
        read_trials(table.assign(rt=1000 * table["rt"]), **READ)
    with refused("rt must be in ms, got a median of"):
        read_trials(table, **READ, columns=Columns(rt_unit="ms"))
    with refused("rt_unit must be one of s, ms, got 'min'"):
        read_trials(table, **READ, columns=Columns(rt_unit="min"))
    with refused("rt must be above 0 ms, got '-5.0' in row 3"):
        wrong = (1000 * table["rt"]).where(table.index != 3, -5.0)
        read_trials(table.assign(rt=wrong), **READ, columns=Columns(rt_unit="ms"))


@pytest.mark.parametrize("to", [Trials.to_pyddm, Trials.to_hssm])
@pytest.mark.parametrize("missing", [[], [4, 9]])
def test_frames_of_other_tools_come_back_as_they_were(to, missing):
    options = {**READ, "columns": Columns(deadline_s=4.0)} if missing else READ
    expected = read_trials(silent(people(), missing), **options)
    frame = to(expected).rename(columns={"strength": "coherence"})
    assert same(read_trials(frame, **options), expected)


def test_a_sample_of_pyddm_has_its_own_names():
    pyddm = pytest.importorskip("pyddm")
    table = people()
    sample = pyddm.Sample.from_pandas_dataframe(
        table[["rt", "response", "coherence"]], "rt", "response"
    )
    frame = sample.to_pandas_dataframe(drop_undecided=True)
    assert {"RT", "choice"} <= set(frame)
    trials = read_trials(frame, strength="coherence")
    order = np.lexsort((trials.response, trials.rt_s))
    mine = np.lexsort((table["response"], table["rt"]))
    assert trials.rt_s[order] == pytest.approx(table["rt"].to_numpy()[mine])
    assert trials.response[order].tolist() == table["response"].to_numpy()[mine].tolist()


def test_minus_one_without_a_time_or_beside_0_is_no_response_of_hssm():
    table = people()
    late = table.assign(response=table["response"].where(table.index != 3, -1))
    with refused("response must be 1 or 0, got '-1' in row 3"):
        read_trials(late, **READ)
    coded = table.assign(response=np.where(table["response"] == 1, 1, -1))
    absent = coded.assign(rt=coded["rt"].where(coded.index != 3))
    with refused("response must be 1 or 0"):
        read_trials(absent, **READ)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"rt": "lag"}, "rt must be one of the columns who, trial, latency, key"),
        ({"rt": "latency", "response": "latency"}, "columns must be named once each"),
        ({"response": 3}, "response must be the name of a column"),
        ({"participant": "name"}, "participant must be one of the columns"),
    ],
)
def test_a_column_that_there_is_not_is_refused(options, says):
    with refused(says):
        read(people().rename(columns=OTHER), **{**READ, **NAMED, **options})


def test_a_column_that_has_our_name_already_is_not_overwritten():
    table = people().assign(latency=1.0)
    with refused("rt is 'latency', but there is also a column rt"):
        read_trials(table, **READ, columns=Columns(rt="latency"))


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("a.csv", "", "path can't be read as .csv"),
        ("a.csv", "rt,response\n0.5,1,2\n", "path a row has more cells"),
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
