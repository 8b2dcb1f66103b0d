"""The store; tests/test_stores.py tests what all of its users rely on."""

import os
from dataclasses import replace

import numpy as np
import pytest

from circuits.store import Entry, Latest, safe


def entry(folder, key="key", **options):
    return Entry(folder, "1", key, dict, dict, **options)


def test_a_key_is_the_same_in_any_order_and_must_be_json(tmp_path):
    one, other = entry(tmp_path, {"a": 1, "b": [2.5]}), entry(tmp_path, {"b": [2.5], "a": 1})
    assert one.path == other.path
    with pytest.raises(TypeError):
        _ = entry(tmp_path, {"a": np.zeros(2)}).path


def test_titles_become_names_that_no_folder_is_left_by(tmp_path):
    assert safe("b macaque") == "b macaque"
    titles = ["../x", "a/b", "a_b", "a:b", "a\\b", "a\nb"]
    names = [entry(tmp_path, title=title).path.name for title in titles]
    assert len(set(names)) == len(titles)
    assert not any(set(name) & set("/\\:\n") for name in names)


def test_an_error_of_the_function_is_not_said_to_follow_another(tmp_path):
    def fails():
        raise ValueError("no theory")

    with pytest.raises(ValueError, match="no theory") as caught:
        entry(tmp_path).once(fails)
    assert caught.value.__context__ is None


def test_the_oldest_of_a_folder_are_forgotten(tmp_path):
    every = [entry(tmp_path, number, most=3) for number in range(4)]
    for number, each in enumerate(every):
        each.put({"x": np.full(2, number)})
        os.utime(each.path, (number, number))
    other = replace(every[0], folder=tmp_path / "other")
    other.put({"x": np.zeros(2)})
    assert [each.get() is None for each in (*every, other)] == [True, False, False, False, False]


def test_the_latest_of_each_kind_stay_in_memory():
    memory, made = Latest(3), []
    for name in "abcade":
        assert memory.once("kind", name, lambda name=name: made.append(name) or name) == name
    assert made == [*"abcde"]
    assert [*memory.kinds["kind"]] == [*"cde"]
    memory.once("other", "a", lambda: None)
    memory.once("kind", None, lambda: None)
    assert [*memory.kinds["kind"]] == [*"cde"]
