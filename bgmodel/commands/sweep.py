"""The command that runs a sweep: many circuits, tasks or engines, in shards."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from bgmodel.commands.options import Workers
from bgmodel.commands.output import bar, check_whole, say_of_edits, write_template
from circuits.errors import InputError


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

    Examples: bgmodel sweep mine.toml --template; bgmodel sweep mine.toml --workers 8;
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
    from bgmodel.sweeps.sweep import OUTCOME, Sweep

    if template:
        write_template(Sweep.template(), file)
        return
    check_whole(workers=workers, parts=parts)
    if part is not None and on != "processes":
        raise InputError("part is for a single job: give --parts, or leave out --on", "part")
    asked = Sweep.from_toml(file)
    folder = folder or Path("sweeps") / file.stem
    asked.check(folder)
    if on != "processes":
        from bgmodel.sweeps.shards import run_jobs

        run_jobs(asked.shards, file, folder, parts=parts, workers=workers, profile=profile,
                 slurm=on == "slurm", dry_run=dry_run)  # fmt: skip
        return
    status, missing = asked.status(folder, part)
    print(status, flush=True)
    say_of_edits(*(point.edits for point in asked.points))
    if dry_run:
        return
    try:
        with bar(sum(shard.trials for shard in missing)):
            if part is not None:
                asked.compute(folder, workers=workers, part=part)
                return
            outcome = asked.run(folder, workers=workers)
    except KeyboardInterrupt:
        raise KeyboardInterrupt("The same command resumes where it stopped.") from None
    axes = len(asked.plan.axes)
    if len(asked.points) <= 40:
        print(outcome.summary().to_string())
    drawn = f"drawn: {folder / 'outcome.png'}"
    print(drawn if axes <= 2 else f"no figure: it can show one key or two, got {axes}")
    print(f"-> {folder / OUTCOME}")
