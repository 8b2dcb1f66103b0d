"""Finished fits are found by all that they were made with."""

import pandas as pd
import pytest

from bgmodel.fitting.pieces import Piece, read_piece, safe, write_piece

KEY = {"participant": "b", "model": {"model": "constant_gap"}, "values": [0.1, 10.0]}
PIECE = Piece(
    pd.DataFrame({"value": [1.5]}),
    pd.DataFrame({"strength": [0.1, 0.2]}),
    pd.DataFrame({"caution": []}, dtype=str),
)


@pytest.fixture
def folder(tmp_path):
    write_piece(tmp_path / "pieces", "b constant_gap", KEY, PIECE, seed=1)
    return tmp_path / "pieces"


def test_a_piece_is_read_back(folder):
    found = read_piece(folder, "b constant_gap", dict(reversed(KEY.items())))
    for one, other in zip(found, PIECE, strict=True):
        pd.testing.assert_frame_equal(one, other)


def test_another_key_is_another_piece_beside_it(folder):
    other = {**KEY, "values": [0.1, 11.0]}
    assert read_piece(folder, "b constant_gap", other) is None
    write_piece(folder, "b constant_gap", other, PIECE, seed=1)
    assert read_piece(folder, "b constant_gap", KEY) is not None
    assert len(list(folder.iterdir())) == 6


@pytest.mark.parametrize("damage", ["cut", "one of three"])
def test_a_damaged_piece_is_none(folder, damage):
    path = sorted(folder.iterdir())[0]
    if damage == "cut":
        path.write_bytes(path.read_bytes()[:80])
    else:
        path.unlink()
    assert read_piece(folder, "b constant_gap", KEY) is None


def test_titles_become_names_that_no_folder_is_left_by():
    assert safe("b macaque") == "b macaque"
    odd = ["../x", "a/b", "a_b", "a:b", "a\\b", "a\nb"]
    made = [safe(title) for title in odd]
    assert len(set(made)) == len(odd)
    assert not any(set(name) & set("/\\:\n") for name in made)
