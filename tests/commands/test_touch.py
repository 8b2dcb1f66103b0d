"""The command `touch`: what it refuses before any work, and which files it overwrites."""

from unittest.mock import Mock

import pandas as pd
import pytest

from tests.helpers import run

COMMANDS = ("simulate", "train", "decode")
FILES = ("training.npz", "held_out.npz", "decoder.safetensors", "decoded.parquet", "index.html")


@pytest.fixture
def steps(monkeypatch):
    """Replace the steps by ones that write their settings; return a list of those taken."""
    taken = []

    def replaced(name):
        def command(*inputs, output, **options):
            output.save.parent.mkdir(exist_ok=True)
            output.save.write_text(f"{[each.read_text() for each in inputs]} {options}")
            taken.append(output.save.name)

        command.__name__ = name
        return command

    for name in COMMANDS:
        monkeypatch.setattr(f"bgmodel.commands.touch.{name}", replaced(name))
    numbers = pd.DataFrame({"measure": ["test_accuracy"], "value": [0.9]})
    result = Mock(remarks=(), learned=(), summary=lambda: numbers)
    monkeypatch.setattr("bgmodel.from_taps.touch", lambda *_, **options: result)
    monkeypatch.setattr("bgmodel.from_taps.page", lambda *_: "a page")
    return taken


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_it_did_not_make_is_overwritten_only_by_force(name, steps, tmp_path, refusal):
    mine = tmp_path / name
    mine.write_text("mine")
    assert f"{name}' was not made by this command" in refusal("touch", tmp_path)
    assert [*tmp_path.iterdir()] == [mine]
    assert mine.read_text() == "mine"
    assert run("touch", tmp_path, "--force") == 0
    assert sorted(steps) == sorted(FILES[:-1])
    assert mine.read_text() != "mine"


def test_the_same_command_resumes_and_another_one_is_refused(steps, tmp_path, refusal):
    asked = ("touch", tmp_path, "--task", "same-different")
    assert run(*asked) == 0
    assert run(*asked, "--workers", 1) == 0
    assert steps == [*FILES[:-1]]
    for name in ("decoded.parquet", "index.html"):  # as if it had been interrupted
        (tmp_path / name).unlink()
    assert run(*asked) == 0
    assert steps == [*FILES[:-1], "decoded.parquet"]
    before = {name: (tmp_path / name).read_text() for name in FILES}
    changes = {("--trials", 130): "index.html", ("--taps", 80): "training.npz",
               ("--held-out-taps", 90): "held_out.npz", ("--gain", 0.3): "index.html"}  # fmt: skip
    for change, name in changes.items():
        assert f"{name}' was not made by" in refusal(*asked, *change)
        assert before == {name: (tmp_path / name).read_text() for name in FILES}
    (tmp_path / "decoder.safetensors").write_text("trained further")
    assert "decoder.safetensors' was not made by" in refusal(*asked)


@pytest.mark.parametrize(
    ("options", "wanted"),
    [
        (("--trials", 5), "trials must be 10 or more, one per fold, got 5"),
        (("--folds", 2000), "trials must be 2000 or more, one per fold, got 1200"),
        (("--folds", 1), "folds must be a whole number >= 2, got 1"),
        (("--trials", 50, "--folds", 2), "trials must be 100 or more for an interval, got 50"),
        (("--held-out-taps", 3), "needs at least 40 taps of each kind, got 2"),
        (("--held-out-taps", 100, "--folds", 60), "a fold has no reading of some hypotheses"),
        (("--taps", 10), "training needs at least 128 taps plus those for validation, got 80"),
        (("--workers", 0), "workers must be at least 1, got 0"),
    ],
)
def test_impossible_settings_are_refused_before_any_work(options, wanted, steps, tmp_path, refusal):
    assert wanted in refusal("touch", tmp_path / "new", *options)
    assert not steps
    assert not (tmp_path / "new").exists()


def test_as_many_taps_and_folds_as_just_suffice_are_taken(steps, tmp_path):
    few = ("--taps", 22, "--held-out-taps", 102, "--folds", 50, "--trials", 100)
    assert run("touch", tmp_path, *few) == 0


def test_a_file_instead_of_a_folder_is_refused(steps, tmp_path, refusal):
    mine = tmp_path / "ev.csv"
    mine.write_text("mine")
    assert "ev.csv' can't be written: Not a directory" in refusal("touch", mine)
    (tmp_path / "index.html").mkdir()
    assert "index.html' is a folder" in refusal("touch", tmp_path, "--force")
    assert not steps


def test_recordings_that_are_refused_leave_no_folder(tmp_path, refusal):
    empty = tmp_path / "empty"
    empty.mkdir()
    asked = ("--recordings", empty, "--held-out", empty, "--mm-per-px", 0.33)
    assert "empty" in refusal("touch", tmp_path / "mine", *asked)
    assert not (tmp_path / "mine").exists()


def test_an_interruption_says_that_the_same_command_resumes(steps, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("bgmodel.from_taps.touch", Mock(side_effect=KeyboardInterrupt))
    assert run("touch", tmp_path) == 130
    assert "stopped. Finished steps are kept: the same command" in capsys.readouterr().err
