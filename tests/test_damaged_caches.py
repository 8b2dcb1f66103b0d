"""Damaged files of caches are treated as absent: made again and written whole, never misread."""

import numba
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as some

from circuits.arrays import read_arrays
from circuits.compiled_code import compile_cached
from tests.damage import DAMAGES, doubled, flipped

SOURCES = "0123456789abcdef"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    return tmp_path


def made():
    """Return a function as in a new process, its results, and how many came from the cache."""
    function = compile_cached(doubled, SOURCES)
    return function(21), function(0.25), sum(function.stats.cache_hits.values())


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
@pytest.mark.parametrize("ending", [".nbi", ".1.nbc", ".2.nbc"])
def test_damaged_code_is_compiled_again_and_written_whole(folder, ending, damage):
    assert made() == (42, 0.5, 0)
    assert made() == (42, 0.5, 2)
    (file,) = folder.rglob(f"*{ending}")
    contents = file.read_bytes()
    file.write_bytes(damage(contents))
    value, other, hits = made()
    assert (value, other) == (42, 0.5)
    assert hits <= (2 if ending == ".nbi" else 1)  # not every byte of an index matters
    assert made() == (42, 0.5, 2)


def test_code_of_another_function_is_not_loaded(folder):
    made()
    first, second = sorted(folder.rglob("*.nbc"))
    first.write_bytes(second.read_bytes())
    assert made() == (42, 0.5, 1)


ARRAYS = {"x": np.arange(5.0), "of": np.array([[1, 2]], np.int16), "name": np.array("one")}


@given(share=some.floats(0, 1, exclude_max=True), cut=some.booleans())
@example(share=0.88, cut=False)  # hides an entry of the directory
def test_arrays_with_a_changed_byte_are_read_as_written_or_not_at_all(tmp_path_factory, share, cut):
    path = tmp_path_factory.getbasetemp() / "some.npz"
    np.savez(path, **ARRAYS)
    contents = path.read_bytes()
    path.write_bytes(contents[: int(share * len(contents))] if cut else flipped(contents, share))
    try:
        arrays = read_arrays(path)
    except (OSError, ValueError):
        return
    assert arrays.keys() == ARRAYS.keys()
    for name, values in ARRAYS.items():
        assert arrays[name].tobytes() == values.tobytes()
        assert (arrays[name].dtype, arrays[name].shape) == (values.dtype, values.shape)
