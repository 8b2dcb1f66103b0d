"""Stored crossings in files: columns for each threshold, one row per trial."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from bgmodel.fitting.simulated.crossings import FirstPassageTimes
from bgmodel.support import files
from bgmodel.support.arrays import Array

KINDS = ("bin", "choice", "evidence")


def write_crossings(crossings: FirstPassageTimes, path: Path, *, seed: int, **made: Any) -> None:
    """Write crossings atomically as parquet, with ``made`` in the provenance."""
    path.parent.mkdir(parents=True, exist_ok=True)
    found = (crossings.bins, crossings.choice, crossings.evidence)
    columns = {
        f"{kind}_{k}": row
        for kind, rows in zip(KINDS, found, strict=True)
        for k, row in enumerate(rows)
    }
    files.write_table(pd.DataFrame(columns), path, seed=seed, **made)


def read_crossings(
    path: Path, thresholds_nats: Array, drifts: Sequence[float]
) -> FirstPassageTimes | None:
    """Return stored crossings; None without a complete file."""
    try:
        table = files.read_table(path)
    except ValueError:
        return None
    levels = range(len(thresholds_nats))
    arrays = [table[[f"{kind}_{k}" for k in levels]].to_numpy().T for kind in KINDS]
    bins, choice, evidence = (np.ascontiguousarray(each) for each in arrays)
    return FirstPassageTimes(thresholds_nats, np.array(drifts), bins, choice, evidence)
