"""Every figure has a caption that names its panels, and the gallery shows every figure."""

import ast
import re
import string
from dataclasses import fields, replace

import pytest
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from circuits.anatomy import DEFAULT
from figures import gallery, stamps
from figures.common import FAST, FULL, Settings, captions
from figures.rooms import Caption, rooms, table_path
from figures.stamps import KEY, Stamp, outdated, read_stamp, stamp_of
from tests.helpers import ROOT

WRITTEN = {name: each for room in rooms() for name, each in room.about.get("figures", {}).items()}
SCRIPTS = {name: room for room in rooms() for name in room.figures()}


def drawn_letters(script):
    """Return the letters of a script's panels: a title begins with one and two spaces."""
    path = SCRIPTS[script].folder / f"draw_{script.removeprefix('fig')}.py"
    tree = ast.parse(path.read_text(encoding="utf-8"))
    texts = [x.value for x in ast.walk(tree) if isinstance(x, ast.Constant)]
    matches = [re.match("([a-z])  ", x) for x in texts if isinstance(x, str)]
    return {match[1] for match in matches if match}


def test_every_figure_has_a_caption_and_every_caption_a_figure():
    assert WRITTEN.keys() == SCRIPTS.keys()


@pytest.mark.parametrize("name", WRITTEN)
def test_a_caption_has_every_key(name):
    assert set(WRITTEN[name]) == {"reads", *(field.name for field in fields(Caption))}
    assert all(WRITTEN[name][field.name].strip() for field in fields(Caption))
    assert WRITTEN[name]["question"].count("?") == 1


@pytest.mark.parametrize("name", WRITTEN)
def test_placeholders_are_settings(name):
    known = {field.name for field in fields(Settings)}
    for field in fields(Caption):
        text = WRITTEN[name][field.name]
        asked = {field for _, field, *_ in string.Formatter().parse(text) if field is not None}
        assert asked <= known


@pytest.mark.parametrize("name", WRITTEN)
def test_a_caption_names_the_panels_that_are_drawn(name):
    # A figure that is a panel of the paper's own has no letters inside.
    named = set(re.findall(r"\*\*([a-z])\*\*", WRITTEN[name]["caption"]))
    assert named == drawn_letters(name)


def test_captions_follow_the_settings():
    few = captions(replace(FULL, episodes=1234, xi=50.0))
    assert "1\u202f234 trials of REINFORCE" in few["fig5a"].caption
    assert "costs 50 readings" in few["fig5a"].caption
    assert captions(FAST)["fig5a"] != captions(FULL)["fig5a"]


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


def test_a_small_picture_keeps_its_stamp(tmp_path):
    drawn = picture(tmp_path / "drawn.png")
    gallery.shrink(drawn, tmp_path / "kept.png")
    assert read_stamp(tmp_path / "kept.png") == STAMP
    with Image.open(tmp_path / "kept.png") as small:
        assert small.size == (gallery.WIDTH, gallery.WIDTH // 5)
    with pytest.raises(ValueError, match="draw it again"):
        gallery.shrink(picture(tmp_path / "none.png", None), tmp_path / "kept.png")


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
