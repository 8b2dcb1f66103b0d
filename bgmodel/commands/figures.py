"""The command that draws the figures."""

from __future__ import annotations

import os
from pathlib import Path

from bgmodel.commands.options import Workers
from bgmodel.commands.output import check_whole
from bgmodel.support.files import remove_partial_files
from bgmodel.support.processes import run_snakemake
from bgmodel.tactile.recordings import find_recordings
from circuits.errors import require

LOCKS = Path(".snakemake/locks")
"""Where Snakemake locks the files of a run; a killed run leaves its locks behind."""


def _check_unlocked() -> None:
    """Raise ValueError if Snakemake has locked the folder."""
    if LOCKS.is_dir() and any(LOCKS.iterdir()):
        raise ValueError(
            "another run is drawing figures in this checkout, or was killed: wait for its end, or, "
            "if it is gone, remove its lock with `bgmodel figures --unlock`"
        )


def figures(
    *targets: str,
    fast: bool = False,
    recordings: Path | None = None,
    unlock: bool = False,
    workers: Workers = 2,
) -> None:
    """Draw every figure that is not drawn yet, from a checkout of the project.

    Example: bgmodel figures --fast

    Parameters
    ----------
    targets
        Names of figures, such as fig4a, or files to make; all by default.
    fast
        A coarse run with few trials, into figures/fast.
    recordings
        Folder of real taps for figure T1; BGMODEL_RECORDINGS by default.
    unlock
        Draw nothing, but remove the lock and the unfinished files of a killed run.
    """
    check_whole(workers=workers)
    if not Path("figures/Snakefile").is_file():
        raise ValueError("figures are drawn in a checkout of the project: figures/Snakefile")
    try:
        import snakemake  # noqa: F401
    except ImportError as error:
        raise ImportError('figures need Snakemake: pip install ".[figures]"') from error
    folder = Path("figures/fast" if fast else "figures/out")
    names = sorted(f"fig{path.stem[5:]}" for path in Path("figures").glob("*/draw_*.py"))
    short = ", ".join(name.removeprefix("fig") for name in names)
    for target in targets:
        known = target in names or Path(target).parent == folder
        require(known, "targets", f"must be among fig{short} or files in {folder}", target)
    taps_folder = find_recordings(recordings)
    if not unlock:
        _check_unlocked()
        stems = {Path(target).stem for target in targets}
        asked = [name for name in names if not targets or name in stems]
        there = [name for name in asked if (folder / f"{name}.png").is_file()]
        named = f"already there: {len(there)}; each is named when it is drawn"
        print(f"figures to draw in {folder}: {len(asked)}, {named}", flush=True)
    remove_partial_files(folder)
    # Not on Snakemake's command line, which reads a folder named 010 as the number 10.
    os.environ["BGMODEL_RECORDINGS"] = str(taps_folder or "")
    # Steps run in processes held by the file of rules; threads wait for them.
    status = run_snakemake([
        "-s", "figures/Snakefile", "--cores", str(workers), "--rerun-incomplete",
        "--force-use-threads", "--quiet", "all", "--config", f"fast={int(fast)}",
        *["--unlock"] * unlock, "--", *(targets or ["all"]),
    ])  # fmt: skip
    if status:
        _check_unlocked()
        reason = f"Snakemake ended with status {status}"
        raise SystemExit(f"bgmodel: not all figures were drawn: {reason}")
