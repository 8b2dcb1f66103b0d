"""One set of guards: what one reader of trials refuses or doubts, all of them do."""

import numpy as np
import pandas as pd
import pytest

from bgmodel.stopping.people import read_people
from bgmodel.trials.reader import read_trials
from circuits.errors import DataWarning
from tests.helpers import refused

ROWS = 48
READERS = {
    "choices": lambda data: read_trials(data, strength="coherence"),
    "stop signals": read_people,
    "pairs": read_trials,
}


def table_of(kind, **changes):
    """Return the trials of two people, half of the rows each."""
    rng = np.random.default_rng(2)
    columns = {
        "choices": {"coherence": np.tile([-0.3, 0.3, 0.1], 16),
                    "response": np.tile([0, 1, 1, 0], 12)},
        "stop signals": {"ssd": np.tile([np.nan, np.nan, 0.2], 16)},
        "pairs": {"pair": np.tile(["AB", "CD"], 24), "response": np.tile([1, 0, 1, 1], 12),
                  "reward": np.tile([1, 0, 0], 16)},
    }  # fmt: skip
    rt = np.round(rng.uniform(0.35, 0.9, ROWS), 4)
    who = np.repeat(["a", "b"], ROWS // 2)
    return pd.DataFrame({"participant_id": who, "rt": rt, **columns[kind]}).assign(**changes)


def first(value, rest):
    return [value, *[rest] * (ROWS - 1)]


def written(table, folder, ending):
    path = folder / f"trials{ending}"
    if ending == ".parquet":
        table.to_parquet(path)
    else:
        table.to_csv(path, index=False, sep="\t" if ending == ".tsv" else ",")
    return path


def seen(data):
    """Return people and times of what a reader returns."""
    if isinstance(data, dict):
        times = {who: getattr(one, "rt_s", None) for who, one in data.items()}
        return {who: data[who].rt_ms / 1000 if t is None else t for who, t in times.items()}
    return {who: data.rt_s[data.participant == who] for who in data.people()}


@pytest.mark.parametrize("kind", READERS)
@pytest.mark.parametrize("ending", [".csv", ".tsv", ".parquet"])
def test_a_frame_and_its_file_are_the_same_trials(kind, ending, tmp_path):
    table = table_of(kind)
    frame, file = (seen(READERS[kind](each)) for each in (table, written(table, tmp_path, ending)))
    assert [*frame] == [*file] == ["a", "b"]
    for who, times in frame.items():
        np.testing.assert_allclose(file[who], times)


BAD = {
    "a time of 0": ({"rt": first(0.0, 0.5)}, "rt above 0 s, got '0.0' in row 0.*leave rt and"),
    "a time before the stimulus": ({"rt": first(-0.08, 0.5)}, "rt above 0 s, got .-0.08. in row 0"),
    "times in ms": ({"rt": np.linspace(400, 800, ROWS)}, "rt must be in seconds"),
    "a decimal comma": ({"rt": first("0,41", "0.5")}, "rt finite number, got '0,41' in row 0"),
    "a word": ({"rt": first("omission", "0.5")}, "rt finite number, got .omission. in row 0"),
    "no participant": (
        {"participant_id": first("", "a")},
        "participant_id every trial, got nothing",
    ),
    "blanks": ({"participant_id": first("a ", "a")}, "participant_id differ only in blanks"),
    "two units": ({"rt": [*[0.5] * 24, *[40.0] * 24]}, "rt seconds in every trial"),
}


@pytest.mark.parametrize("kind", READERS)
@pytest.mark.parametrize("ending", [None, ".csv"])
@pytest.mark.parametrize("case", BAD)
def test_what_one_reader_refuses_all_refuse(kind, ending, case, tmp_path):
    change, says = BAD[case]
    table = table_of(kind, **change)
    data = table if ending is None else written(table, tmp_path, ending)
    with refused(says) as caught:
        READERS[kind](data)
    assert str(caught.value).startswith("a table: " if ending is None else "trials.csv: ")


@pytest.mark.parametrize("kind", READERS)
def test_ids_are_text_as_written(kind, tmp_path):
    table = table_of(kind, participant_id=np.repeat(["NA", "01"], ROWS // 2))
    for data in (table, written(table, tmp_path, ".csv")):
        assert [*seen(READERS[kind](data))] == ["01", "NA"]
    numbered = table_of(kind, participant_id=np.repeat(["01", "1"], ROWS // 2))
    with pytest.warns(DataWarning, match="in how a number is written"):
        assert len(seen(READERS[kind](written(numbered, tmp_path, ".csv")))) == 2


@pytest.mark.parametrize("kind", READERS)
def test_one_person_under_two_names_is_doubted(kind):
    table = table_of(kind)
    half = table[: ROWS // 2]
    twice = pd.concat([half, half.assign(participant_id="b")], ignore_index=True)
    with pytest.warns(DataWarning, match="the same times and responses"):
        READERS[kind](twice)


@pytest.mark.parametrize("kind", READERS)
def test_names_of_columns_are_those_of_this_package_or_named(kind):
    with refused("rt there is no column rt"):
        READERS[kind](table_of(kind).rename(columns={"rt": "rt_ms"}))
    with refused("participant"):
        READERS[kind](table_of(kind).rename(columns={"participant_id": "subject"}))
    with refused(r"rt .*Columns\(rt=\.\.\., participant=\.\.\.\)"):
        READERS[kind](table_of(kind).rename(columns={"rt": "rt_ms", "participant_id": "subject"}))
