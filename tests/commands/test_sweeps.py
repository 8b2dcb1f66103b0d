"""The command `sweep`: whole or not at all, once, and the same however it is run."""

import os
import random
import signal
import subprocess
import sys
import time

import pandas as pd
import pytest

from bgmodel.files import read_provenance
from bgmodel.sweeps import shards
from circuits.anatomy import circuit
from circuits.table_files import write
from tests.helpers import ROOT, run

SMALL = """
name = "a small sweep"
engine = "{engine}"
gain = 0.7
[task]
trials = {trials}
t_max = 30
[grid]
STN = [0.0, 0.1]
posterior = [0.7, 0.8, 0.9]
"""


@pytest.fixture
def small(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(SMALL.format(engine="algebra", trials=60))
    return path


def outcome(folder):
    names = ("outcome.csv", "outcome.csv.json", "outcome.png", "outcome.pdf")
    return [(folder / name).read_bytes() for name in names]


def test_a_sweep_is_one_table_with_what_it_was_made_from(small, tmp_path, capsys):
    folder = tmp_path / "found"
    assert run("sweep", small, folder) == 0
    said, warned = capsys.readouterr()
    assert said.splitlines()[1].split() == ["measure", "accuracy", "mean_ms", "missed"]
    # Each remark once, with the number of points that have it; none for points without a remark.
    assert "bgmodel: at 2 of 6 points: many trials are not decided in time" in warned
    assert "points: \n" not in warned
    assert said.startswith(f"points: 6; shards: 6, 0 there already; folder: {folder}\n")
    assert said.endswith(f"drawn: {folder / 'outcome.png'}\n-> {folder / 'outcome.csv'}\n")
    table = pd.read_csv(folder / "outcome.csv")
    assert len(table.drop_duplicates(["STN", "posterior"])) == 6
    behind = read_provenance(folder / "outcome.csv")["parameters"]
    assert behind["sweep"]["grid"] == {"STN": [0.0, 0.1], "posterior": [0.7, 0.8, 0.9]}
    assert len(set(behind["circuits"])) == 2


def test_what_is_there_is_not_computed_again_and_what_is_damaged_is(small, tmp_path, capsys):
    folder = tmp_path / "found"
    run("sweep", small, folder)
    first = outcome(folder)
    made = {path: path.stat().st_mtime_ns for path in (folder / "shards").iterdir()}
    one, *others = made
    one.write_bytes(one.read_bytes()[:50])
    capsys.readouterr()
    assert run("sweep", small, folder, "--workers", 1) == 0
    assert "shards: 6, 5 there already, 1 damaged, computed again" in capsys.readouterr().out
    assert all(path.stat().st_mtime_ns == made[path] for path in others)
    assert outcome(folder) == first


def test_parts_and_jobs_of_snakemake_give_the_same_bytes(small, tmp_path):
    run("sweep", small, tmp_path / "whole")
    for k in (2, 1):
        assert run("sweep", small, tmp_path / "parts", "--part", f"{k}/2") == 0
    assert len(list((tmp_path / "parts" / "shards").iterdir())) == 6
    assert not (tmp_path / "parts" / "outcome.csv").exists()
    assert run("sweep", small, tmp_path / "parts") == 0
    assert run("sweep", small, tmp_path / "jobs", "--on", "snakemake", "--parts", 2) == 0
    assert outcome(tmp_path / "whole") == outcome(tmp_path / "parts") == outcome(tmp_path / "jobs")


def test_names_of_files_and_folders_reach_jobs_as_they_are(small, tmp_path, monkeypatch):
    """They run no command, and a folder of digits stays one."""
    monkeypatch.chdir(tmp_path)
    file = small.rename(tmp_path / "a' || touch x; echo '{b} $(touch x).toml")
    file.write_text(file.read_text().replace("[0.0, 0.1]", "[0.1]").replace(", 0.8, 0.9]", "]"))
    assert run("sweep", file.name, "010", "--on", "snakemake", "--parts", 1) == 0
    assert (tmp_path / "010" / "outcome.csv").is_file()
    assert {path.name for path in tmp_path.iterdir()} == {file.name, "010"}
    assert not list(tmp_path.rglob("x"))


def test_jobs_of_a_finished_sweep_run_again_where_the_circuit_was_edited(tmp_path, capfd):
    table = circuit("spiking_msprt", 2)
    write(table, tmp_path / "mine.toml")
    path = tmp_path / "small.toml"
    path.write_text("circuit = 'mine.toml'\nengine = 'algebra'\n[grid]\nposterior = [0.8]\n")
    jobs = ("sweep", path, tmp_path / "jobs", "--on", "snakemake", "--parts", 1)
    assert run(*jobs) == 0
    capfd.readouterr()
    assert run(*jobs, "--dry-run") == 0
    assert "rule part:" not in "".join(capfd.readouterr())
    (tmp_path / "mine.toml").unlink()
    write(table.without("STN", 0.1), tmp_path / "mine.toml")
    assert run(*jobs, "--dry-run") == 0
    assert "rule part:" in "".join(capfd.readouterr())


def test_a_dry_run_for_slurm_lists_its_jobs_and_does_nothing(small, tmp_path, capfd):
    folder = tmp_path / "cluster"
    assert run("sweep", small, folder, "--on", "slurm", "--parts", 3, "--dry-run") == 0
    said = "".join(capfd.readouterr())
    assert "runtime=120" in said
    assert said.count("rule part:") == 3
    assert run("sweep", small, folder, "--dry-run") == 0
    assert not folder.exists()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--part", "3/2"], "part must be K/N with K in 1..N, as 3/40, got '3/2'"),
        (["--part", "1/2", "--on", "slurm"], "part is what a job computes"),
        (["--on", "slurm", "--profile", "nowhere"], "profile must be a folder with config.yaml"),
        (["--workers", "0"], "workers must be at least 1, got 0"),
    ],
)
def test_options_that_make_no_sense_are_one_sentence(small, tmp_path, capsys, options, says):
    assert run("sweep", small, tmp_path / "found", *options) == 2
    said = capsys.readouterr().err
    assert says in said
    assert said.count("\n") == 1


def test_two_sweeps_in_one_folder_at_once_are_refused(small, tmp_path, capsys):
    with shards.at_work(tmp_path / "found", alone=True):
        assert run("sweep", small, tmp_path / "found") == 2
    assert "another sweep is at work in" in capsys.readouterr().err


def killed(command, after_s):
    """Start a command, kill its whole group after a time; return whether it was still at work."""
    with subprocess.Popen(command, cwd=ROOT, start_new_session=True) as child:
        time.sleep(after_s)
        alive = child.poll() is None
        if alive:
            os.killpg(child.pid, signal.SIGKILL)
    return alive


@pytest.mark.parametrize("moments", [3, pytest.param(20, marks=pytest.mark.validate)])
def test_a_sweep_that_is_killed_goes_on_to_the_same_bytes(tmp_path, moments):
    path = tmp_path / "small.toml"
    path.write_text(SMALL.format(engine="population", trials=1500))
    assert run("sweep", path, tmp_path / "alone") == 0
    folder = tmp_path / "killed"
    command = [sys.executable, "-m", "bgmodel", "sweep", str(path), str(folder)]
    rng = random.Random(moments)
    finished = {}
    for _ in range(moments):
        alive = killed(command, rng.uniform(1.0, 4.5))
        now = {p: p.stat().st_mtime_ns for p in (folder / "shards").glob("[!.]*.parquet")}
        # A finished shard stays as it is.
        assert finished.items() <= now.items()
        finished = now
        if not alive:
            break
    assert run("sweep", path, folder) == 0
    assert all(p.stat().st_mtime_ns == made for p, made in finished.items())
    assert outcome(folder) == outcome(tmp_path / "alone")
