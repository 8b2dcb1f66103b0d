"""The figures' rules hang together, and one of them shows what it says; `make figures` draws."""

import os
import subprocess
import sys

from tests.helpers import ROOT

SCRIPTS = sorted((ROOT / "figures").glob("*/draw_*.py"))


def dry_run(recordings):
    command = [sys.executable, "-m", "snakemake", "-s", "figures/Snakefile", "-n", "--cores", "1"]
    # Another folder for the figures would be asked for by an option; a dry run writes nothing.
    done = subprocess.run(
        [*command, "--forceall", "--nolock", "--config", "fast=1"],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env=os.environ | {"BGMODEL_RECORDINGS": recordings},
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def test_every_script_is_drawn():
    planned = dry_run("tests")
    for script in SCRIPTS:
        assert f"figures/fast/fig{script.stem.removeprefix('draw_')}.png" in planned
