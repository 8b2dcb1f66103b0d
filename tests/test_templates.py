"""A command writes a whole file as a template, and it runs."""

import re

import pytest

import bgmodel as bg
from tests.helpers import run

KINDS = {"experiment": bg.Experiment, "sweep": bg.Sweep}


@pytest.fixture(params=KINDS)
def command(request):
    return request.param


def test_the_file_is_written_as_shown_and_runs(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "mine.toml"
    assert run(command, path, "--template") == 0
    assert path.read_text() == KINDS[command].template()
    assert KINDS[command].from_toml(path)
    path.write_text(re.sub(r"trials = \d+", "trials = 100", path.read_text()))
    assert run(command, path, "--workers", "1") == 0


@pytest.mark.parametrize("name", ["mine.toml", "mine.txt", "", "none/mine.toml"])
def test_no_file_is_written_over(command, name, tmp_path, monkeypatch, refusal):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text("mine")
    force = ["--force"] if command == "experiment" else []
    sentence = refusal(command, name, "--template", *force)
    assert "must be a new .toml file" in sentence or "none" in sentence
    assert [path.read_text() for path in tmp_path.iterdir()] == ["mine"]
