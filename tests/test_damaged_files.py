"""Files from which a run resumes: damaged ones count as absent and never give other numbers."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as some

from bgmodel.commands import touch
from bgmodel.fitting.pieces import Piece, read_piece, write_piece
from bgmodel.fitting.simulated.crossings import FirstPassageTimes
from bgmodel.fitting.simulated.stored import read_crossings, write_crossings
from bgmodel.support.files import read_provenance, read_table, write_table
from bgmodel.sweeps import shards
from bgmodel.sweeps.plan import Plan
from bgmodel.tactile.library import _load, _save
from bgmodel.task import Gaussian
from tests.damage import DAMAGES, flipped
from tests.tactile.plans import TINY

RNG = np.random.default_rng(24_711)
TABLE = pd.DataFrame(
    {
        "rt": RNG.normal(size=40),
        "bin": RNG.integers(0, 300, 40).astype("int16"),
        "who": [f"p{k % 7}" for k in range(40)],
        "right": RNG.random(40) < 0.5,
    }
)
TABLES = Piece(TABLE, TABLE.head(3), pd.DataFrame({"caution": ["a", "b"]}))
LEVELS, DRIFTS = np.array([0.3, 0.6]), (0.0, 1.0)
PASSAGES = FirstPassageTimes(
    LEVELS,
    np.array(DRIFTS),
    RNG.integers(0, 9, (2, 30)).astype("int16"),
    RNG.integers(0, 2, (2, 30)).astype("int8"),
    RNG.normal(size=(2, 30)),
)
CELLS = TINY.stored_cells
FIELDS = {
    period: RNG.normal(size=(TINY.solved_phases(period), 2, CELLS, CELLS, 5)).astype(np.float32)
    for period in TINY.periods_mm
}
(POINT,) = Plan(
    task=Gaussian(trials=40, t_max=10), engine="algebra", gain=0.7, grid={"lesion STN": (0.0,)}
).all_points()
(SHARD,) = POINT.shards()


def tables(folder):
    piece = read_piece(folder, "a", {"k": 1})
    return piece and [each.to_csv() for each in piece]


def passages(folder):
    crossings = read_crossings(folder / "x.parquet", LEVELS, DRIFTS)
    return crossings and [np.asarray(each).tolist() for each in (crossings.bins, crossings.choice)]


def library(folder):
    fields = _load(folder / "x.npz", TINY)
    return fields and [each.tobytes() for each in fields.values()]


def decisions(folder):
    if shards.state(SHARD, folder) != "done":
        return None
    behaviour, remark = shards.read(POINT, folder)
    return remark, behaviour.decision.time_ms.tolist(), behaviour.posterior.tolist()


STORES = {
    "fits": (lambda folder: write_piece(folder, "a", {"k": 1}, TABLES, seed=1), tables),
    "crossings": (lambda f: write_crossings(PASSAGES, f / "x.parquet", seed=1), passages),
    "contacts": (lambda folder: _save(folder / "x.npz", TINY, FIELDS), library),
    "shards": (lambda folder: shards.compute(SHARD, folder), decisions),
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
@pytest.mark.parametrize(("write", "read"), STORES.values(), ids=STORES)
def test_a_damaged_file_counts_as_absent_until_it_is_written_again(tmp_path, write, read, damage):
    assert read(tmp_path) is None
    write(tmp_path)
    written = read(tmp_path)
    (file, *_) = sorted(tmp_path.rglob("*.*z")) or sorted(tmp_path.rglob("*.parquet"))
    file.write_bytes(damage(file.read_bytes()))
    assert read(tmp_path) in (None, written)  # some bytes of a file mean nothing
    write(tmp_path)
    assert read(tmp_path) == written


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


@pytest.mark.parametrize("damage", ["result", "cut", "[" * 100_000, "3"])
def test_a_step_is_made_again_if_its_result_or_the_record_is_damaged(tmp_path, damage):
    result, record = tmp_path / "x", tmp_path / "steps.json"
    for _ in range(2):
        touch._Steps(tmp_path)._make("x", made, seed=1)
    assert result.with_suffix(".calls").read_text() == "1"
    if damage == "result":
        result.write_text("whale")
    else:
        record.write_text(record.read_text()[:-9] if damage == "cut" else damage)
    for _ in range(2):
        touch._Steps(tmp_path)._make("x", made, seed=1)
    assert result.with_suffix(".calls").read_text() == "11"
    assert result.read_text() == "whole"
