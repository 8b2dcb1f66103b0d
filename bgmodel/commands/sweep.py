"""The command that runs a sweep: many circuits, tasks or engines, in shards."""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
from functools import partial
from getpass import getuser
from importlib.resources import files as resources
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Literal

from bgmodel.commands.options import Workers
from bgmodel.commands.output import check_whole, recorded, say, say_of_edits, write_template
from bgmodel.support import files
from bgmodel.support.processes import processes
from bgmodel.version import __version__
from circuits.errors import InputError, require

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from bgmodel.sweeps.plan import Shard
    from bgmodel.sweeps.sweep import Sweep

OUTCOME, PACKAGE = "outcome.csv", resources("bgmodel.sweeps")
FIGURES: dict[str, Any] = {".pdf": {"CreationDate": None}, ".png": {"Software": None}}
"""Endings of figure files, with the metadata that must be left out."""
PART = re.compile(r"(\d+)/(\d+)")


def sweep(
    file: Path,
    folder: Path | None = None,
    /,
    *,
    part: str | None = None,
    on: Literal["processes", "snakemake", "slurm"] = "processes",
    parts: int = 10,
    profile: Path | None = None,
    dry_run: bool = False,
    template: bool = False,
    workers: Workers = 2,
) -> None:
    """Run a circuit at every point of a grid or a list, and gather the results.

    A TOML file defines what is run and what changes: any number or edit of the circuit, dopamine,
    the task, the engine, the posterior at which it decides. Finished parts are never computed
    again; the same command resumes after it was stopped or killed.

    Examples: bgmodel sweep mine.toml --template; bgmodel sweep mine.toml;
    bgmodel sweep mine.toml --workers 8;
    bgmodel sweep mine.toml --on slurm --parts 40 --dry-run

    Parameters
    ----------
    file
        A TOML file.
    folder
        Folder for shards, outcome.csv and outcome.png; by default sweeps/NAME, after the file.
    part
        K/N: compute only the K-th of N parts, without gathering: for your own scheduler.
    on
        Where to compute: processes on this machine, jobs of Snakemake here, or jobs on a cluster
        through its SLURM executor.
    parts
        Number of jobs of Snakemake or SLURM.
    profile
        Folder of a profile for SLURM, instead of the shipped one.
    dry_run
        Print what would be done, and do nothing.
    template
        Write a whole file to FILE, to start from, and run nothing.
    """
    from bgmodel.sweeps.shards import check_room
    from bgmodel.sweeps.sweep import Sweep

    if template:
        write_template(Sweep.template(), file)
        return
    check_whole(workers=workers, parts=parts)
    share = _share(part, on)
    asked = Sweep.from_toml(file)
    points, shards = asked.points, asked.shards
    folder = folder or Path("sweeps") / file.stem
    files.check_writable(folder)
    _check_own(folder)
    if profile is not None and not (profile / "config.yaml").is_file():
        raise InputError.of("profile", "must be a folder with config.yaml", str(profile))
    check_room(points, folder)
    if on == "processes":
        _run(asked, shards if share is None else shards[share], folder, workers, dry_run)
        return
    names = "".join([__version__, *sorted(shard.name for shard in shards)])
    settings: dict[str, str | int] = {
        "file": str(file.absolute()),
        "folder": str(folder.absolute()),
        "parts": parts,
        "plan": hashlib.sha256(names.encode()).hexdigest()[:12],
    }
    how = ["--cores", str(workers)]
    if on == "slurm":
        how = ["--profile", str(profile.absolute() if profile else PACKAGE / "slurm")]
    _run_snakemake(settings, folder, [*how, *(["--dry-run"] if dry_run else [])], on)


def _share(part: str | None, on: str) -> slice | None:
    """Return the shards of the K-th of N parts, or None for all."""
    if part is None:
        return None
    match = PART.fullmatch(part)
    k, n = (int(match[1]), int(match[2])) if match else (0, 0)
    require(1 <= k <= n, "part", "must be K/N with K in 1..N, as 3/40", part)
    if on != "processes":
        raise InputError("part is for a single job: give --parts, or leave out --on", "part")
    return slice(k - 1, None, n)


def _run(asked: Sweep, shards: list[Shard], folder: Path, workers: int, dry_run: bool) -> None:
    """Compute shards that are missing; if they are all of the sweep, gather the results."""
    from tqdm import tqdm

    from bgmodel.sweeps import shards as stored

    states = {shard: stored.state(shard, folder) for shard in shards}
    missing = [shard for shard, state in states.items() if state != "done"]
    damaged = list(states.values()).count("damaged")
    print(
        f"points: {len(asked.points)}; shards: {len(states)}, {len(states) - len(missing)} done"
        f"{f', {damaged} damaged, computed again' if damaged else ''}; folder: {folder}",
        flush=True,
    )
    say_of_edits(*(point.edits for point in asked.points))
    if dry_run:
        return
    alone = shards is asked.shards
    try:
        with stored.at_work(folder, alone=alone), processes(workers) as pool:
            _remove_outdated(asked, folder)
            done = stored.compute_all(missing, folder, pool)
            for _ in tqdm(done, total=len(missing), unit="shard", disable=None):
                pass
            if alone:
                _gather(asked, folder, pool)
    except KeyboardInterrupt:
        raise KeyboardInterrupt("The same command resumes where it stopped.") from None


def _gather(asked: Sweep, folder: Path, pool: Executor) -> None:
    """Write the table of all points, print the measures of a short sweep, and draw them."""
    from bgmodel.sweeps.outcome import gathered, measured
    from bgmodel.sweeps.sweep import SweepOutcome
    from circuits.plots import saved

    plan, output = asked.plan, folder / OUTCOME
    table = gathered(plan, list(pool.map(partial(measured, folder=folder), asked.points)))
    files.write_table(table, output, **_behind(asked))
    outcome = SweepOutcome(plan, table)
    for caution in outcome.cautions():
        say(caution)
    if len(plan.each) <= 40:
        print(outcome.summary().to_string())
    if len(plan.axes) > 2:
        print(f"no figure: it can show one key or two, got {len(plan.axes)}")
    else:
        figure = outcome.plot()
        for ending, metadata in FIGURES.items():
            with files.replacing(folder / f"outcome{ending}") as partial_file:
                saved(figure, partial_file, format=ending[1:], metadata=metadata)
        print(f"drawn: {folder / 'outcome.png'}")
    print(f"-> {output}")


def _run_snakemake(
    settings: dict[str, str | int], folder: Path, options: list[str], on: str
) -> None:
    """Let jobs of Snakemake compute the parts and gather the results."""
    try:
        import snakemake  # noqa: F401
    except ImportError as error:
        raise ImportError('jobs need Snakemake: pip install ".[cluster]"') from error
    from bgmodel.sweeps.shards import check_slurm

    dry_run = "--dry-run" in options
    if on == "slurm" and not dry_run:
        check_slurm(folder)
    command = [sys.executable, "-m", "snakemake", "-s", str(PACKAGE / "Snakefile"), *options]
    command += ["--rerun-incomplete"]
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


def _behind(asked: Sweep) -> dict[str, Any]:
    """Return the provenance of a sweep's table."""
    from circuits.declaration.table_writer import identity

    circuits = [identity(point.edited)["sha256"] for point in asked.points]
    return {"seed": asked.plan.seed, "sweep": recorded(asked.plan), "circuits": circuits}


def _check_own(folder: Path) -> None:
    """Raise ValueError if a file that the sweep would overwrite was not made by a sweep."""
    output = folder / OUTCOME
    paths = [output, *map(output.with_suffix, FIGURES)]
    if not any(path.exists() for path in paths):
        return
    made_from = files.read_provenance(output)["parameters"] if files.is_result(output) else {}
    if "sweep" not in made_from:
        there = next(path for path in paths if path.exists())
        raise InputError(
            f"{str(there)!r} was not made by a sweep: move it, or give another folder", "folder"
        )


def _remove_outdated(asked: Sweep, folder: Path) -> None:
    """Remove table and figure of another sweep, which a part or a stopped sweep would keep."""
    output = folder / OUTCOME
    if not output.is_file():
        return
    of = files.read_provenance(output)
    now = files.provenance(**_behind(asked))
    if all(of.get(name) == now[name] for name in ("parameters", "seed")):
        return
    say(f"{output} is of another sweep: it is removed, with its figure; shards are kept")
    # Remove the table last: while it exists, its figure is known to be that of a sweep.
    for path in (*map(output.with_suffix, FIGURES), output, files.provenance_path(output)):
        path.unlink(missing_ok=True)
