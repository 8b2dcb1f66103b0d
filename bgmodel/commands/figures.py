"""The command that draws the figures."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from bgmodel.commands.checks import check_whole


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
        from bgmodel.tactile.recordings import find_recordings

        check_whole(cores=self.cores)
        if not Path("figures/Snakefile").is_file():
            raise ValueError("figures are drawn in a checkout of the project: figures/Snakefile")
        try:
            import snakemake  # noqa: F401
        except ImportError as error:
            raise ImportError('figures need Snakemake: pip install ".[figures]"') from error
        found = find_recordings(self.recordings)
        if found is None:
            print("figure R1 is left out: no recordings (--recordings or BGMODEL_RECORDINGS)")
            if "figR1" in self.targets:
                raise ValueError("figR1 needs recordings: --recordings or BGMODEL_RECORDINGS")
        command = [sys.executable, "-m", "snakemake", "-s", "figures/Snakefile"]
        command += ["--cores", str(self.cores), "--rerun-incomplete"]
        command += ["--quiet", "rules", "host", "reason"]
        command += ["--config", f"fast={int(self.fast)}", f"recordings={found or ''}"]
        done = subprocess.run([*command, "--", *(self.targets or ["all"])], check=False)
        if done.returncode:
            raise SystemExit(done.returncode)
