"""A room says what it is about: captions, columns and metadata; and one runs from its folder."""

import json
import os
import shutil
import sys

import pandas as pd
import pytest

import figures
from figures import __main__ as runner
from figures import common, pieces, rooms
from figures.rooms import METADATA, Room, read_metadata, write
from tests.helpers import ROOT, refused

TEMPLATE = ROOT / "tests" / "figures" / "template"
"""A room as small as can be: one number, one figure, one page."""


@pytest.mark.parametrize("room", rooms.rooms(), ids=lambda room: room.name)
def test_every_room_has_captions_columns_and_metadata(room):
    room.check()
    assert room.about["question"].endswith("?")
    assert room.page.is_file() or not room.tables()


def test_every_file_that_a_step_makes_is_read_and_every_one_read_is_made():
    steps = [step for room in rooms.rooms() for step in room.steps()]
    made = {name for _, _, _, makes in steps for name in makes}
    read = {name for _, _, reads, _ in steps for name in reads if not name.endswith(".csv")}
    assert made == read - {os.path.abspath(os.environ.get("BGMODEL_RECORDINGS", ""))}


@pytest.fixture
def new(tmp_path, monkeypatch):
    """Return a new room, made from the template in a temporary folder."""
    folder = tmp_path / "figures" / "new_room"
    shutil.copytree(TEMPLATE, folder)
    (folder.parent / "index.md.j2").write_text("# Index\n")
    (tmp_path / "results").mkdir()
    monkeypatch.setattr(pieces, "OUT", tmp_path / "out")
    monkeypatch.setattr(figures, "__path__", [*figures.__path__, str(folder.parent)])
    yield Room(folder)
    for name in [name for name in sys.modules if name.startswith("figures.new_room")]:
        del sys.modules[name]


def run(new, *arguments):
    """Run a step of the room."""
    folder = new.folder.parent
    runner.main([*arguments, new.name], folder, folder.parent / "results")


def drawn(room, folder):
    """Draw the figures of a room from what it measured; return their paths."""
    for module, step, reads, _ in room.steps():
        path = folder / f"fig{module.removeprefix('draw_')}.png"
        script = f"figures/{room.name}/{module}.py"
        common.make(script, step, reads, str(path), True)
        yield path


def test_a_new_room_is_measured_drawn_and_written(new, tmp_path):
    run(new, "measure", "page")
    new.check()
    page = (tmp_path / "results" / "new_room.md").read_text()
    assert page.startswith("# What is six times seven?\n\nIt is 42.")
    assert read_metadata(new.folder / "tables")["answer_numbers"]["seed"] == 1
    [picture] = drawn(new, tmp_path)
    assert picture.is_file()


def edited(room, before, after):
    """Replace a text in ``room.toml``."""
    path = room.folder / "room.toml"
    text = path.read_text()
    assert before in text
    path.write_text(text.replace(before, after))
    return Room(room.folder)


def test_a_room_without_a_caption_or_the_meaning_of_a_column_is_refused(new):
    with refused("figures"):
        edited(new, "[figures.figX1]", "[figures.figX2]").check()
    edited(new, "[figures.figX2]", "[figures.figX1]")
    write(pd.DataFrame({"value": [1]}), new.folder / "tables" / "t.csv", trials=1, circuits={})
    new.check()
    with refused("columns"):
        edited(new, "value =", "other =").check()


def test_a_table_without_metadata_is_refused_and_nothing_is_overwritten(new):
    path = write(pd.DataFrame({"value": [1]}), new.folder / "tables" / "t.csv", trials=1)
    place = path.with_name(METADATA)
    place.write_text(json.dumps({"gone": read_metadata(path.parent)["t"]}))
    kept = place.read_text(), path.read_text()
    with refused("tables"):
        new.check()
    with refused("tables"):
        run(new, "measure")
    assert (place.read_text(), path.read_text()) == kept
