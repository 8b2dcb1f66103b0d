"""The command that draws the figures."""

from __future__ import annotations

import multiprocessing
import os
import signal
from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from bgmodel.commands.checks import check_whole
from bgmodel.support.files import remove_partial_files
from circuits.errors import InputError

LOCKS = Path(".snakemake/locks")
"""Where Snakemake locks the files of a run; a killed run leaves its locks behind."""
MINUTES = {True: 6.0, False: 25.0}
"""CPU time of all figures, minutes, coarse (True) or full; measured on two cores of an AMD EPYC."""


def _names() -> list[str]:
    """Return the names of all figures."""
    return sorted(path.stem for path in Path("figures").glob("fig*.py"))


def _check_unlocked() -> None:
    """Raise ValueError if Snakemake has locked the folder."""
    if LOCKS.is_dir() and any(LOCKS.iterdir()):
        raise ValueError(
            "another run is drawing figures in this checkout, or was killed: wait for its end, or, "
            "if it is gone, remove its lock with `bgmodel figures --unlock`"
        )


def run_snakemake(arguments: list[str]) -> int:
    """Run Snakemake in this process; return its exit status.

    Ctrl-C also ends the processes of its steps, so that Snakemake need not wait for them and
    removes its lock.
    """
    from snakemake.cli import args_to_api, parse_args

    stopped = []

    def stop(*_: object) -> None:
        stopped.append(True)
        for process in multiprocessing.active_children():
            process.kill()
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, stop)
    try:
        parser, options = parse_args(arguments)
        drawn = args_to_api(options, parser)
    finally:
        signal.signal(signal.SIGINT, before)
    if stopped:
        raise KeyboardInterrupt("The same command resumes where it stopped.")
    return 0 if drawn else 1


@dataclass(frozen=True)
class Figures:
    """Draw every figure that is not drawn yet, from a checkout of the project.

    Example: bgmodel figures --fast
    """

    targets: Positional[tuple[str, ...]] = ()
    """Names of figures, such as fig4a, or files to make; all by default."""
    fast: bool = False
    """A coarse run with few trials, into figures/fast."""
    cores: int = 2
    """Number of parallel jobs; the results do not depend on it."""
    recordings: Path | None = None
    """Folder of real taps for figures R1 and T1; BGMODEL_RECORDINGS by default."""
    unlock: bool = False
    """Draw nothing, but remove the lock and the unfinished files of a killed run."""

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.tactile.recordings import find_recordings

        check_whole(cores=self.cores)
        if not Path("figures/Snakefile").is_file():
            raise ValueError("figures are drawn in a checkout of the project: figures/Snakefile")
        try:
            import snakemake  # noqa: F401
        except ImportError as error:
            raise ImportError('figures need Snakemake: pip install ".[figures]"') from error
        folder = Path("figures/fast" if self.fast else "figures/out")
        self._check_targets(folder)
        found = find_recordings(self.recordings)
        if found is None:
            if "figR1" in self.targets:
                raise InputError(
                    "figR1 needs recordings: --recordings or BGMODEL_RECORDINGS", "recordings"
                )
            if not self.targets:
                print("figure R1 is left out: no recordings (--recordings or BGMODEL_RECORDINGS)")
        if not self.unlock:
            _check_unlocked()
            self._say(folder, found is not None)
        remove_partial_files(folder)
        # Not on Snakemake's command line, which reads a folder named 010 as the number 10.
        os.environ["BGMODEL_RECORDINGS"] = str(found or "")
        status = run_snakemake(self._arguments())
        if status:
            _check_unlocked()
            raise SystemExit(
                f"bgmodel: not all figures were drawn: Snakemake ended with status {status}"
            )

    def _arguments(self) -> list[str]:
        """Return the arguments of Snakemake."""
        arguments = ["-s", "figures/Snakefile", "--cores", str(self.cores), "--rerun-incomplete"]
        # Steps run in processes held by the file of rules; threads wait for them.
        arguments += ["--force-use-threads", "--quiet", "all", "--config", f"fast={int(self.fast)}"]
        arguments += ["--unlock"] if self.unlock else []
        return [*arguments, "--", *(self.targets or ["all"])]

    def _say(self, folder: Path, recordings: bool) -> None:
        """Report what is drawn and about how long it takes."""
        names = [name for name in _names() if recordings or name != "figR1"]
        asked = [
            name
            for name in names
            if not self.targets
            or {name, *(str(folder / f"{name}{end}") for end in (".png", ".pdf"))} & {*self.targets}
        ]
        there = [name for name in asked if (folder / f"{name}.png").is_file()]
        took = (
            f", about {MINUTES[self.fast]:g} minutes of CPU" if not (there or self.targets) else ""
        )
        print(
            f"figures to draw in {folder}: {len(asked)}, already there: {len(there)}{took}; each "
            "is named when it is drawn",
            flush=True,
        )

    def _check_targets(self, folder: Path) -> None:
        """Raise ValueError for a target that is neither a figure nor a file of the folder."""
        names = _names()
        for target in self.targets:
            if target not in names and Path(target).parent != folder:
                short = ", ".join(name.removeprefix("fig") for name in names)
                must = f"must be among fig{short} or files in {folder}"
                raise InputError.of("targets", must, target)
