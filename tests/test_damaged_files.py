"""Files from which a run resumes: damaged ones count as absent and never give other numbers."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as some

from bgmodel.commands import touch
from bgmodel.support.files import read_provenance, read_table, write_table
from tests.damage import flipped

RNG = np.random.default_rng(24_711)
TABLE = pd.DataFrame(
    {
        "rt": RNG.normal(size=40),
        "bin": RNG.integers(0, 300, 40).astype("int16"),
        "who": [f"p{k % 7}" for k in range(40)],
        "right": RNG.random(40) < 0.5,
    }
)


@given(share=some.floats(0, 1, exclude_max=True), cut=some.booleans())
def test_a_table_with_a_changed_byte_is_read_as_written_or_refused(tmp_path_factory, share, cut):
    path = tmp_path_factory.getbasetemp() / "some.parquet"
    write_table(TABLE, path, seed=3, rows=[1, 2])
    contents, about = path.read_bytes(), read_provenance(path)
    path.write_bytes(contents[: int(share * len(contents))] if cut else flipped(contents, share))
    try:
        table, behind = read_table(path), read_provenance(path)
    except (OSError, ValueError):
        return
    pd.testing.assert_frame_equal(table, TABLE)
    assert behind == about


def test_tables_of_every_type_are_read_back(tmp_path):
    wide = pd.DataFrame(
        {
            "day": pd.to_datetime(["2020-01-01", None]),
            "kind": pd.Categorical(["a", "b"]),
            "maybe": pd.array([1, None], dtype="Int64"),
            "single": np.float32([1, 2]),
            "text": ["x", None],
            "none": [None, None],
            "list": [[1], [2, 3]],
        }
    )
    for number, table in enumerate((wide, wide.head(0), pd.DataFrame())):
        path = write_table(table, tmp_path / f"{number}.parquet")
        assert list(read_table(path)) == list(table)
        assert len(read_table(path)) == len(table)


def made(*, output, **options):
    """Make a file as a command does, and count."""
    output.save.write_text("whole")
    with output.save.with_suffix(".calls").open("a") as calls:
        calls.write("1")


@pytest.mark.parametrize("damage", ["result", "record"])
def test_a_step_is_made_again_if_its_result_or_the_record_is_damaged(tmp_path, damage):
    result = tmp_path / "x"
    for _ in range(2):
        touch.step(tmp_path, "x", made, seed=1)
    assert result.with_suffix(".calls").read_text() == "1"
    if damage == "result":
        result.write_text("whale")
    else:
        (record,) = (tmp_path / "steps").iterdir()
        record.write_bytes(record.read_bytes()[:-9])
    for _ in range(2):
        touch.step(tmp_path, "x", made, seed=1)
    assert result.with_suffix(".calls").read_text() == "11"
    assert result.read_text() == "whole"
