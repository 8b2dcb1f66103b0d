"""A sweep as jobs of Snakemake, on this machine or on a cluster through its SLURM executor."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from getpass import getuser
from importlib.resources import files as resources
from pathlib import Path
from tempfile import TemporaryDirectory

from bgmodel.sweeps.shards import check_slurm
from bgmodel.sweeps.sweep import Sweep
from bgmodel.version import __version__
from circuits.errors import InputError

PACKAGE = resources("bgmodel.sweeps")


def run_jobs(
    asked: Sweep,
    file: Path,
    folder: Path,
    *,
    parts: int,
    workers: int,
    profile: Path | None = None,
    slurm: bool = False,
    dry_run: bool = False,
) -> None:
    """Let jobs of Snakemake compute the parts of a sweep and gather the results.

    ``file`` is that of the sweep, ``profile`` the folder of another profile for SLURM than the
    shipped one. SystemExit if Snakemake fails.
    """
    if profile is not None and not (profile / "config.yaml").is_file():
        raise InputError.of("profile", "must be a folder with config.yaml", str(profile))
    try:
        import snakemake  # noqa: F401
    except ImportError as error:
        raise ImportError('jobs need Snakemake: pip install ".[cluster]"') from error
    if slurm and not dry_run:
        check_slurm(folder)
    names = "".join([__version__, *sorted(shard.name for shard in asked.shards)])
    settings: dict[str, str | int] = {
        "file": str(file.absolute()),
        "folder": str(folder.absolute()),
        "parts": parts,
        "plan": hashlib.sha256(names.encode()).hexdigest()[:12],
    }
    how = ["--cores", str(workers)]
    if slurm:
        how = ["--profile", str(profile.absolute() if profile else PACKAGE / "slurm")]
    command = [sys.executable, "-m", "snakemake", "-s", str(PACKAGE / "Snakefile"), *how]
    command += ["--dry-run"] * dry_run + ["--rerun-incomplete"]
    with TemporaryDirectory() as empty:
        if not dry_run:
            folder.mkdir(parents=True, exist_ok=True)
        # Jobs on other machines read the settings too; a dry run leaves no files.
        path = Path(empty if dry_run else folder).absolute() / "jobs.json"
        path.write_text(json.dumps(settings))
        place = folder.absolute() if folder.is_dir() else Path(empty)
        command += ["--directory", str(place), "--configfile", str(path)]
        # The executor for SLURM reads USER, which services and containers leave unset.
        process = subprocess.Popen(command, env={"USER": getuser(), **os.environ})
        try:
            status = process.wait()
        except KeyboardInterrupt:
            process.wait()  # Ctrl-C reached it too: it ends its jobs and removes its lock
            raise
    if status:
        locks = place / ".snakemake" / "locks"
        more = f"; `rm -r {locks}` removes the lock of a killed run"
        raise SystemExit(
            f"bgmodel: the sweep is not finished, Snakemake ended with status {status}"
            + (more if locks.is_dir() else "")
        )
