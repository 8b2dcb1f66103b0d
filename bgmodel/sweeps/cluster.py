"""Whether SLURM can be used from this machine: it takes jobs, and says how they ended."""

from __future__ import annotations

import subprocess
from pathlib import Path

from circuits.errors import InputError, require

QUERIES = (
    (["sinfo", "--noheader"], "SLURM does not answer on this machine: run this on a login node"),
    (
        ["sacct", "--allocations", "--noheader", "--clusters", "all", "--starttime", "now"],
        "SLURM keeps no accounts here, from which the executor learns that a job has ended",
    ),
)
"""Commands that must succeed before a sweep submits jobs, and the reason if one fails."""
TIMEOUT_S = 60
SPECIAL = set("\"'$`\\")
"""Characters that the executor hands to a shell unquoted."""


def check_slurm(folder: Path) -> None:
    """Refuse a folder or a machine from which jobs can't be submitted and followed.

    Without accounts (slurmdbd) the executor of Snakemake would submit jobs and wait forever.
    """
    for path in (folder.absolute(), Path.cwd()):
        allowed = "must have a path without quotes, $, ` and backslashes, as SLURM's shell reads it"
        require(not SPECIAL & set(str(path)), "folder", allowed, str(path))
    for command, reason in QUERIES:
        try:
            subprocess.run(command, capture_output=True, text=True, check=True, timeout=TIMEOUT_S)
        except (OSError, subprocess.SubprocessError) as error:
            answer = " ".join((getattr(error, "stderr", None) or str(error)).split())
            raise InputError(
                f"{reason} ({command[0]}: {answer}); --part K/N needs no answers from SLURM", "on"
            ) from None
