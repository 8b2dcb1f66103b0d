"""The command that draws the figures."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from bgmodel.commands.checks import check_whole
from bgmodel.support.files import remove_partial_files

SETTINGS = Path(".snakemake/figures.json")
"""Where Snakemake reads the settings of a run."""
MINUTES = {True: 6.0, False: 18.0}
"""CPU time of all figures, minutes, coarse or not; measured on two cores of an AMD EPYC."""


def _names() -> list[str]:
    """Return the names of all figures."""
    return sorted(path.stem for path in Path("figures").glob("fig*.py"))


@dataclass(frozen=True)
class Figures:
    """Draw every figure that is not drawn yet, from a checkout of the project.

    Example: bgmodel figures --fast
    """

    targets: Positional[tuple[str, ...]] = ()
    """Names of figures, such as fig4a, or files to make; all if left out."""
    fast: bool = False
    """A coarse run with few trials, into figures/fast."""
    cores: int = 2
    """Jobs at a time; they change no byte."""
    recordings: Path | None = None
    """Folder of real taps for figure R1; BGMODEL_RECORDINGS if left out."""

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.commands.one_run import only_run, run_to_end
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
            print("figure R1 is left out: no recordings (--recordings or BGMODEL_RECORDINGS)")
            if "figR1" in self.targets:
                raise ValueError("figR1 needs recordings: --recordings or BGMODEL_RECORDINGS")
        self._say(folder, found is not None)
        try:
            with only_run(SETTINGS.parent, "`bgmodel figures`") as jobs:
                remove_partial_files(folder)
                # On a command line Snakemake takes a folder that is named 010 for the number 10.
                settings = {"fast": int(self.fast), "recordings": str(found or "")}
                SETTINGS.write_text(json.dumps(settings))
                status = run_to_end(self._snakemake, jobs)
        except KeyboardInterrupt:
            raise KeyboardInterrupt("The same command goes on where it was.") from None
        if status:
            raise SystemExit(
                f"bgmodel: not every figure is drawn, Snakemake ended with status {status}"
            )

    def _snakemake(self, owner: int) -> list[str]:
        """Return the command line; ``owner`` is the number of the file for ``end_with``."""
        command = [sys.executable, "-m", "snakemake", "-s", "figures/Snakefile"]
        # A run that was killed leaves Snakemake's own lock behind: those of `only_run` do its work.
        command += ["--cores", str(self.cores), "--rerun-incomplete", "--nolock"]
        # Steps are handed to processes that the file of rules keeps: threads wait for them.
        command += ["--force-use-threads"]
        command += ["--quiet", "all", "--configfile", str(SETTINGS), "--config", f"owner={owner}"]
        return [*command, "--", *(self.targets or ["all"])]

    def _say(self, folder: Path, recordings: bool) -> None:
        """Say what is drawn, and about how long all of it takes."""
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
            f"figures to draw in {folder}: {len(asked)}, there already: {len(there)}{took}; each "
            "is named when it is drawn",
            flush=True,
        )

    def _check_targets(self, folder: Path) -> None:
        """Raise ValueError for a target that is neither a figure nor a file of the folder."""
        names = _names()
        for target in self.targets:
            if target not in names and Path(target).parent != folder:
                raise ValueError(
                    f"targets must be among {', '.join(names)} or files in {folder}, got {target!r}"
                )
