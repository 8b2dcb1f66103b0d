"""Memory: asked for before a run, and refused by a sentence where it is not free."""

from types import SimpleNamespace

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from bgmodel.support.files import read_table
from bgmodel.support.processes import (
    CELL_BYTES,
    NoMemoryError,
    check_evidence_memory,
    check_learning_memory,
    check_memory,
)
from bgmodel.tables.evidence import read_evidence_table
from bgmodel.trials.reading import read_trials


@pytest.fixture
def free(monkeypatch):
    """Return a function that sets how many bytes are free."""

    def set_free(count):
        monkeypatch.setattr("psutil.virtual_memory", lambda: SimpleNamespace(available=count))

    return set_free


def test_less_than_100_mb_is_never_refused(free):
    free(0)
    check_memory(0.99e8, "trials")
    with pytest.raises(NoMemoryError, match=r"^trials need 100 MB of memory, 0 bytes are free$"):
        check_memory(1e8, "trials")


@pytest.mark.parametrize(
    ("check", "shape", "needed"),
    [
        # Numbers of eight bytes: four of each reading, ten of each episode.
        (check_evidence_memory, (1000, 1000, 4), 4 * 8 * 4_000_000),
        (check_learning_memory, (30, 50_000), 10 * 8 * 1_500_000),
    ],
)
def test_memory_that_is_just_enough_is_allowed(free, check, shape, needed):
    free(needed)
    check(*shape)
    free(needed - 1)
    with pytest.raises(NoMemoryError, match=f"need {needed / 1e6:.0f} MB of memory"):
        check(*shape)


@pytest.mark.parametrize("read", [read_table, read_evidence_table, read_trials])
@pytest.mark.parametrize("ending", [".parquet", ".csv"])
def test_a_table_that_does_not_fit_is_refused_before_it_is_read(
    free, tmp_path, monkeypatch, read, ending
):
    rows, columns = 2_000_000, ("trial", "step", "ll_a", "ll_b")
    path = tmp_path / f"big{ending}"
    if ending == ".csv":
        needed = 200_000_000
        with path.open("wb") as stream:
            stream.truncate(needed // 2)
    else:
        needed = CELL_BYTES * rows * len(columns)
        pq.write_table(pa.table({name: pa.nulls(rows) for name in columns}), path)

    def taken(*arguments, **more):
        raise KeyboardInterrupt

    for reader in ("pandas.read_parquet", "pandas.read_csv"):
        monkeypatch.setattr(reader, taken)
    free(needed - 1)
    with pytest.raises(NoMemoryError, match=r"'big\..* need .* of memory"):
        read(path)
    if read is read_table:
        free(needed)
        with pytest.raises(KeyboardInterrupt):
            read(path)


@pytest.mark.parametrize(
    ("count", "size"),
    [(999, "999 bytes"), (1000, "1 kB"), (2.5e9, "2.5 GB"), (1e12, "1 TB"), (3e16, "30 PB")],
)
def test_sizes_are_said_in_the_largest_unit_that_they_reach(free, count, size):
    free(count)
    with pytest.raises(NoMemoryError, match=f", {size} are free$"):
        check_memory(1e18, "trials")
