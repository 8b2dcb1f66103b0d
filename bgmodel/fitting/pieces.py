"""Finished fits in a folder, named by a hash of all their settings."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from bgmodel.support import files

if TYPE_CHECKING:
    import pandas as pd


class Piece(NamedTuple):
    """Tables of one finished fit, as from ``fit.Fit``, and its warnings, one per row."""

    parameters: pd.DataFrame
    cells: pd.DataFrame
    cautions: pd.DataFrame


def read_piece(folder: Path, title: str, key: dict[str, Any]) -> Piece | None:
    """Return a finished fit, or None if no undamaged file has this title and all these settings."""
    try:
        return Piece(
            *(
                files.read_table(piece_path(folder, title, key, f"{each}.parquet"))
                for each in Piece._fields
            )
        )
    except (OSError, ValueError):
        return None


def write_piece(folder: Path, title: str, key: dict[str, Any], piece: Piece, *, seed: int) -> None:
    """Store a finished fit; arguments as for ``read_piece``, and the seed of its trials."""
    for each, table in zip(Piece._fields, piece, strict=True):
        path = piece_path(folder, title, key, f"{each}.parquet")
        path.parent.mkdir(parents=True, exist_ok=True)
        files.write_table(table, path, seed=seed, fit=key)


def safe(title: str) -> str:
    """Return a title as a file name: invalid characters become _, and a hash is added."""
    plain = re.sub(r"[^\w .+=-]", "_", title)
    return plain if plain == title else f"{plain} {_digest(title)}"


def piece_path(folder: Path, title: str, key: dict[str, Any], name: str) -> Path:
    """Return the path of a file of a fit: its title, a hash of its settings, and a name."""
    text = json.dumps(files.provenance(fit=key)["parameters"], sort_keys=True)
    return folder / f"{safe(title)} {_digest(text)} {name}"


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:10]
