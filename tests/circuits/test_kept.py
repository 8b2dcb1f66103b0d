"""Arrays kept between runs."""

import os

import numpy as np
import pytest

from circuits import kept as module
from circuits.kept import kept, recall, remember


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "cache_folder", lambda _: tmp_path)
    return tmp_path


def counted():
    calls = []

    def make():
        calls.append(1)
        return {"x": np.arange(3.0), "none": np.zeros((0, 0))}

    return calls, make


def test_arrays_are_made_once_for_a_key_and_a_version(folder):
    calls, make = counted()
    for sources, key in (("a", "k"), ("a", "k"), ("b", "k"), ("a", "other")):
        arrays = kept(sources, key, make)
        np.testing.assert_array_equal(arrays["x"], [0, 1, 2])
        assert arrays["none"].shape == (0, 0)
    assert len(calls) == 3
    assert len(list(folder.rglob("*.npz"))) == 3


@pytest.mark.parametrize("content", [b"", b"no file of arrays", b"PK\x03\x04 cut short"])
def test_a_file_that_cannot_be_read_is_made_anew(folder, content):
    calls, make = counted()
    kept("a", "k", make)
    (path,) = folder.rglob("*.npz")
    path.write_bytes(content)
    np.testing.assert_array_equal(kept("a", "k", make)["x"], [0, 1, 2])
    kept("a", "k", make)
    assert len(calls) == 2


def test_a_folder_that_cannot_be_written_costs_only_time(folder, monkeypatch):
    def full(*_, **__):
        raise OSError("no space left on device")

    monkeypatch.setattr(np, "savez", full)
    calls, make = counted()
    for _ in range(2):
        np.testing.assert_array_equal(kept("a", "k", make)["x"], [0, 1, 2])
    assert len(calls) == 2
    assert {path.suffix for path in folder.rglob("*") if path.is_file()} <= {".lock"}
    monkeypatch.setattr(module, "cache_folder", lambda _: None)
    kept("a", "k", make)
    assert len(calls) == 3


def test_an_error_of_the_function_is_not_said_to_follow_another(folder):
    def fails():
        raise ValueError("no theory")

    with pytest.raises(ValueError, match="no theory") as caught:
        kept("a", "k", fails)
    assert caught.value.__context__ is None


def test_the_oldest_of_a_kind_are_forgotten(folder):
    for number in range(4):
        remember("a", "kind", str(number), {"x": np.full(2, number)}, most=3)
        os.utime(max(folder.rglob("*.npz"), key=os.path.getmtime), (number, number))
    remember("a", "other", "0", {"x": np.zeros(2)}, most=3)
    recalled = [recall("a", "kind", str(number)) for number in range(4)]
    assert recalled[0] is None
    assert [int(each["x"][0]) for each in recalled[1:]] == [1, 2, 3]
    assert recall("b", "kind", "3") is None
    assert recall("a", "other", "0") is not None


def test_without_a_folder_nothing_is_stored(monkeypatch):
    monkeypatch.setattr(module, "cache_folder", lambda _: None)
    remember("a", "kind", "0", {"x": np.zeros(2)}, most=3)
    assert recall("a", "kind", "0") is None
