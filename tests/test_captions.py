"""The gallery shows every figure, and a stamp says from what a picture was drawn."""

import re
from dataclasses import replace

from PIL import Image
from PIL.PngImagePlugin import PngInfo

from circuits.anatomy import DEFAULT
from figures import gallery, stamps
from figures.common import FAST, FULL
from figures.rooms import rooms, table_path
from figures.stamps import KEY, Stamp, outdated, read_stamp, stamp_of
from tests.helpers import ROOT

WRITTEN = {name: each for room in rooms() for name, each in room.about.get("figures", {}).items()}
STAMP = Stamp("0.1", repr(FULL), {"LICENSE": "another file"})


def picture(path, stamp=STAMP, size=(1500, 300)):
    """Write a picture with a stamp."""
    text = PngInfo()
    if stamp:
        text.add_text(KEY, stamp.text())
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", size, "white").save(path, pnginfo=text)
    return path


def test_the_gallery_shows_every_figure_once_and_says_which_are_missing(tmp_path):
    picture(tmp_path / "pictures" / "figC3.png")
    gallery.write(tmp_path)
    page = (tmp_path / "gallery.md").read_text(encoding="utf-8")
    parts = page.split("\n### ")[1:]
    assert len(parts) == len(WRITTEN)
    for name, text in WRITTEN.items():
        [part] = [part for part in parts if f"$ bgmodel figures {name}\n" in part]
        assert text["question"] in part
        shown = re.search(r"!\[(.+)\]\((.+)\)", part)
        assert (shown is not None) == (name == "figC3")
        assert ("no picture yet" in part) == (shown is None)
    assert "Drawn by version 0.1; different now: `LICENSE`." in page


def test_every_figure_has_a_small_picture_with_a_stamp_in_the_documentation():
    pictures = {path.stem: path for path in gallery.KEPT.glob("*.png")}
    assert pictures.keys() == WRITTEN.keys()
    assert sum(path.stat().st_size for path in pictures.values()) < 3.5e6
    assert [name for name, path in pictures.items() if read_stamp(path) is None] == []


def test_a_stamp_notices_a_changed_script_table_circuit_or_number(tmp_path, monkeypatch):
    read = table_path("loss_behaviour")
    stamp = stamp_of(ROOT / "figures/learning/draw_L4.py", [read, tmp_path / "own.parquet"], FULL)
    names = {"figures/learning/draw_L4.py", "figures/style.mplstyle"}
    assert stamp.sources.keys() == {*names, "figures/lesions/tables/loss_behaviour.csv", DEFAULT}
    assert stamp.changed() == []
    drawn = picture(tmp_path / "one.png", stamp)
    assert outdated(drawn, FULL) == ""
    assert "numbers of the run" in outdated(drawn, FAST)
    for name in stamp.sources:
        other = replace(stamp, sources=stamp.sources | {name: "0"})
        assert other.changed() == [name]
        assert f"`{name}`" in outdated(picture(tmp_path / "two.png", other), FULL)
    assert "not known" in outdated(picture(tmp_path / "three.png", None), FULL)


def test_words_in_a_script_change_no_stamp(tmp_path, monkeypatch):
    monkeypatch.setattr(stamps, "ROOT", tmp_path)
    script = tmp_path / "one.py"
    stamp = Stamp("0.1", "", {})
    script.write_text('"""A."""\n\n\ndef f():\n    """B."""\n    return 1  # C\n')
    stamp = replace(stamp, sources={"one.py": stamps._digest("one.py")})
    script.write_text('"""D."""\ndef f():\n    """E."""\n    return 1\n')
    assert stamp.changed() == []
    script.write_text("def f():\n    return 2\n")
    assert stamp.changed() == ["one.py"]
