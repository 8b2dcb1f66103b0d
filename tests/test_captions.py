"""Every figure has a caption that names its panels, and the gallery shows every figure."""

import ast
import importlib.util
import re
import string
import tomllib
from dataclasses import fields, replace

import pytest

from figures.captions import CAPTIONS, Caption, captions
from figures.common import FAST, FULL, Settings
from tests.helpers import ROOT

WRITTEN = tomllib.loads(CAPTIONS.read_text(encoding="utf-8"))
SCRIPTS = sorted(path.stem for path in (ROOT / "figures").glob("fig*.py"))


def drawn_letters(script):
    """Return the letters of a script's panels: a title begins with one and two spaces."""
    tree = ast.parse((ROOT / "figures" / f"{script}.py").read_text(encoding="utf-8"))
    texts = [x.value for x in ast.walk(tree) if isinstance(x, ast.Constant)]
    found = [re.match("([a-z])  ", x) for x in texts if isinstance(x, str)]
    return {match[1] for match in found if match}


def test_every_figure_has_a_caption_and_every_caption_a_figure():
    assert sorted(WRITTEN) == SCRIPTS


@pytest.mark.parametrize("name", WRITTEN)
def test_a_caption_has_every_key_and_its_own_command(name):
    assert set(WRITTEN[name]) == {field.name for field in fields(Caption)}
    assert all(text.strip() for text in WRITTEN[name].values())
    assert re.match(rf"bgmodel figures {name}\b", WRITTEN[name]["command"])
    assert WRITTEN[name]["question"].count("?") == 1


@pytest.mark.parametrize("name", WRITTEN)
def test_placeholders_are_settings(name):
    known = {field.name for field in fields(Settings)}
    for text in WRITTEN[name].values():
        asked = {field for _, field, *_ in string.Formatter().parse(text) if field is not None}
        assert asked <= known


@pytest.mark.parametrize("name", WRITTEN)
def test_a_caption_names_the_panels_that_are_drawn(name):
    # A figure that is a panel of the paper's own has no letters inside.
    named = set(re.findall(r"\*\*([a-z])\*\*", WRITTEN[name]["caption"]))
    assert named == drawn_letters(name)


def test_panels_of_most_figures_have_letters():
    assert drawn_letters("figC2") == set("abcdef")
    assert drawn_letters("fig1") == set("abcd")
    assert sum(bool(drawn_letters(script)) for script in SCRIPTS) >= 10


def test_captions_follow_the_settings():
    few = captions(replace(FULL, episodes=1234, xi=50.0, calibrated_mm=(1.5, 2.0)))
    assert "1\u202f234 trials of REINFORCE" in few["fig5a"].caption
    assert "costs 50 readings" in few["fig5a"].caption
    assert "1.5, 2 mm" in few["figS1"].caption
    assert captions(FAST)["fig5a"] != captions(FULL)["fig5a"]


@pytest.fixture
def gallery():
    """Return the module that writes the page."""
    spec = importlib.util.spec_from_file_location("_gallery", ROOT / "docs" / "_gallery.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_gallery_shows_every_figure(gallery, tmp_path, monkeypatch):
    monkeypatch.setattr(gallery, "ROOT", tmp_path)
    for folder, name in (("out", "figC2"), ("fast", "figC2"), ("fast", "fig4a")):
        picture = tmp_path / "figures" / folder / f"{name}.png"
        picture.parent.mkdir(parents=True, exist_ok=True)
        picture.write_text(folder)
    docs = tmp_path / "docs"
    docs.mkdir()
    gallery.write(docs)
    page = (docs / "gallery.md").read_text(encoding="utf-8")
    parts = dict(zip(WRITTEN, page.split("\n## ")[1:], strict=True))
    for name, part in parts.items():
        assert f"$ bgmodel figures {name}" in part
        assert WRITTEN[name]["question"] in part
        shown = re.search(r"!\[(.+)\]\((.+)\)", part)
        assert (shown is not None) == (name in ("figC2", "fig4a"))
        assert ("Not drawn yet" in part) == (shown is None)
        assert shown is None or (docs / shown[2]).is_file()
    assert "(coarse run)" in parts["fig4a"]
    assert f"{FAST.sweep_trials:,}".replace(",", "\u202f") in parts["fig4a"]
    assert "coarse run" not in parts["figC2"]
    assert (docs / "_figures" / "figC2.png").read_text() == "out"


def test_the_gallery_is_not_committed():
    ignored = (ROOT / "docs" / ".gitignore").read_text().splitlines()
    assert {"gallery.md", "_figures/"} <= set(ignored)
