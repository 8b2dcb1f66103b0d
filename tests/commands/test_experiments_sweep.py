"""The command `sweep`: whole or not at all, once, and the same however it is run."""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from contextlib import redirect_stdout
from io import StringIO

import pandas as pd
import pytest

from bgmodel.support.files import read_provenance, write_table
from bgmodel.sweeps import shards
from circuits.anatomy import load_circuit
from circuits.declaration.table_writer import write
from circuits.errors import BgmodelWarning
from tests.helpers import ROOT, run

SMALL = """
name = "a small sweep"
circuit = "mine.toml"
engine = "{engine}"
gain = 0.7
[task]
trials = {trials}
t_max = 30
[grid]
"lesion STN" = [0.0, 0.1]
posterior = [0.7, 0.8, 0.9]
"""


def written(folder, engine="algebra", trials=60):
    """Write a sweep and its circuit into a folder; return the sweep's path."""
    write(load_circuit("macaque", 2), folder / "mine.toml")
    path = folder / "small.toml"
    path.write_text(SMALL.format(engine=engine, trials=trials))
    return path


@pytest.fixture
def small(tmp_path):
    return written(tmp_path)


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """Run the small sweep once for all; return its folder, what it printed and what it warned."""
    home = tmp_path_factory.mktemp("swept")
    with redirect_stdout(StringIO()) as printed, pytest.warns(BgmodelWarning) as warned:
        assert run("sweep", written(home), home / "found") == 0
    return home / "found", printed.getvalue(), [str(each.message) for each in warned]


def outcome(folder):
    names = ("outcome.csv", "outcome.csv.json", "outcome.png", "outcome.pdf")
    return [(folder / name).read_bytes() for name in names]


def test_a_sweep_is_one_table_with_what_it_was_made_from(swept):
    folder, printed, warned = swept
    assert printed.splitlines()[1].split() == ["measure", "accuracy", "mean_ms", "missed"]
    # Each remark once, with the number of points that have it; none for points without a remark.
    (text,) = warned
    where = "lesion STN = 0, posterior = 0.9; lesion STN = 0.1, posterior = 0.9"
    assert text.startswith(f"at 2 of 6 points ({where}): many trials")
    table = pd.read_csv(folder / "outcome.csv")
    assert len(table.drop_duplicates(["lesion STN", "posterior"])) == 6
    behind = read_provenance(folder / "outcome.csv")["parameters"]
    assert behind["sweep"]["grid"] == {"lesion STN": [0.0, 0.1], "posterior": [0.7, 0.8, 0.9]}
    assert len(set(behind["circuits"])) == 2


def test_what_is_there_is_not_computed_again_and_what_is_damaged_is(small, swept, tmp_path, capsys):
    folder = tmp_path / "found"
    shutil.copytree(swept[0], folder)
    made = {path: path.stat().st_mtime_ns for path in (folder / "shards").iterdir()}
    one, *others = made
    one.write_bytes(one.read_bytes()[:50])
    assert run("sweep", small, folder, "--workers", 1) == 0
    assert "shards: 6, 5 done, 1 damaged, computed again" in capsys.readouterr().out
    assert all(path.stat().st_mtime_ns == made[path] for path in others)
    assert outcome(folder) == outcome(swept[0])


def test_parts_give_the_same_bytes(small, swept, tmp_path):
    folder = tmp_path / "parts"
    for k in (2, 1):
        assert run("sweep", small, folder, "--part", f"{k}/2", "--workers", 1) == 0
    assert len(list((folder / "shards").iterdir())) == 6
    assert not (folder / "outcome.csv").exists()
    assert run("sweep", small, folder, "--workers", 1) == 0
    assert outcome(folder) == outcome(swept[0])


def test_the_outcome_of_another_sweep_does_not_stay(small, swept, tmp_path):
    """A part gathers nothing, and a sweep of three keys draws no figure."""
    folder = tmp_path / "found"
    shutil.copytree(swept[0], folder)
    assert run("sweep", small, folder, "--part", "1/1", "--workers", 1) == 0
    assert outcome(folder) == outcome(swept[0])  # it is of this sweep
    small.write_text(small.read_text().replace("[0.7, 0.8, 0.9]", "[0.7]"))
    with pytest.warns(BgmodelWarning, match="another sweep"):
        assert run("sweep", small, folder, "--part", "1/1", "--workers", 1) == 0
    assert not list(folder.glob("outcome*"))
    assert len(list((folder / "shards").iterdir())) == 6


@pytest.mark.parametrize("name", ["outcome.csv", "outcome.png", "outcome.pdf"])
def test_what_no_sweep_made_is_not_replaced(small, tmp_path, refusal, name):
    folder = tmp_path / "found"
    folder.mkdir()
    (folder / name).write_text("mine\n")
    for options in ((), ("--part", "1/2")):
        assert name in refusal("sweep", small, folder, *options)
    assert [path.name for path in folder.iterdir()] == [name]
    assert (folder / name).read_text() == "mine\n"


def test_a_table_of_another_command_is_not_replaced(small, tmp_path, refusal):
    table = pd.DataFrame({"value": [1.0]})
    write_table(table, tmp_path / "outcome.csv", seed=1, command={"name": "compare"})
    assert "was not made by a sweep" in refusal("sweep", small, tmp_path)


def test_a_dry_run_says_what_is_missing_and_does_nothing(small, swept, tmp_path, capsys):
    folder = tmp_path / "found"
    assert run("sweep", small, folder, "--dry-run") == 0
    assert not folder.exists()
    shutil.copytree(swept[0], folder)
    capsys.readouterr()
    assert run("sweep", small, folder, "--dry-run") == 0
    assert "shards: 6, 6 done" in capsys.readouterr().out
    (tmp_path / "mine.toml").unlink()
    write(load_circuit("macaque", 2).lesion("STN", 0.1), tmp_path / "mine.toml")
    assert run("sweep", small, folder, "--dry-run") == 0
    assert "shards: 6, 0 done" in capsys.readouterr().out


def test_a_part_beyond_the_last_is_refused_in_one_sentence(small, tmp_path, refusal):
    assert "part must be" in refusal("sweep", small, tmp_path / "found", "--part", "3/2")


def test_two_sweeps_in_one_folder_at_once_are_refused(small, tmp_path, capsys):
    with shards.at_work(tmp_path / "found", alone=True):
        assert run("sweep", small, tmp_path / "found") == 2
    assert "another sweep is running in" in capsys.readouterr().err


def killed(command, shards, count, later_s):
    """Start a command, kill its whole group once `count` shards are there and a time has passed."""
    with subprocess.Popen(command, cwd=ROOT, start_new_session=True) as child:
        while child.poll() is None and len(finished(shards)) < count:
            time.sleep(0.02)
        time.sleep(later_s)
        if child.poll() is None:
            os.killpg(child.pid, signal.SIGKILL)


def finished(shards):
    """Return the shards that are whole, and when each was written."""
    return {p: p.stat().st_mtime_ns for p in shards.glob("[!.]*.npz")}


@pytest.mark.parametrize("kills", [1, pytest.param(12, marks=pytest.mark.validate)])
def test_a_sweep_that_is_killed_goes_on_to_the_same_bytes(tmp_path, kills):
    path, folder = written(tmp_path, "population", 150), tmp_path / "killed"
    assert run("sweep", path, tmp_path / "alone", "--workers", 1) == 0
    command = [sys.executable, "-m", "bgmodel", "sweep", str(path), str(folder)]
    rng, before = random.Random(kills), {}
    for k in range(kills):
        # The last of many kills come while the outcome is written.
        count, later_s = min(k + 1, 6), rng.uniform(0, 1) if k else 0
        killed(command, folder / "shards", count, later_s)
        now = finished(folder / "shards")
        assert len(now) >= count
        assert before.items() <= now.items()
        before = now
    assert run("sweep", path, folder, "--workers", 1) == 0
    assert before.items() <= finished(folder / "shards").items()
    assert outcome(folder) == outcome(tmp_path / "alone")
