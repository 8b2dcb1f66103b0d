"""The figures' rules hang together; drawing them is `make figures`."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SCRIPTS = sorted(path.stem for path in (ROOT / "figures").glob("fig*.py"))


def dry_run(*more):
    command = [sys.executable, "-m", "snakemake", "-s", "figures/Snakefile", "-n", "--cores", "1"]
    # Another folder for the figures would be asked for by an option; a dry run writes nothing.
    done = subprocess.run(
        [*command, "--forceall", "--nolock", *more],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def test_every_script_is_drawn():
    planned = dry_run("--config", "fast=1", "recordings=tests")
    for script in SCRIPTS:
        assert re.search(rf"figures/fast/{script}\.png", planned), script


def test_real_taps_are_drawn_only_where_given():
    assert "figR1" not in dry_run("--config", "fast=1", "recordings=")


@pytest.mark.parametrize("script", [*SCRIPTS, "prepare", "sweep"])
def test_scripts_are_run_as_modules_and_import_downwards(script):
    text = (ROOT / "figures" / f"{script}.py").read_text()
    assert 'if __name__ == "__main__":\n    run(' in text
    assert "import torch" not in text
