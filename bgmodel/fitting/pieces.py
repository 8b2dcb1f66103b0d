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
    """Return a finished fit, or None if no undamaged file has this key.

    Parameters
    ----------
    folder : path
        Folder of finished fits.
    title : str
        Beginning of the names of its files.
    key : dict
        All its settings.
    """
    try:
        return Piece(*(files.read_table(_path(folder, title, key, each)) for each in Piece._fields))
    except (OSError, ValueError):
        return None


def write_piece(folder: Path, title: str, key: dict[str, Any], piece: Piece, *, seed: int) -> None:
    """Store a finished fit; arguments as for ``read_piece``, and the seed of its trials."""
    for each, table in zip(Piece._fields, piece, strict=True):
        path = _path(folder, title, key, each)
        path.parent.mkdir(parents=True, exist_ok=True)
        files.write_table(table, path, seed=seed, fit=key)


def safe(title: str) -> str:
    """Return a title as a file name: invalid characters become _, and a hash is added.

    Parameters
    ----------
    title : str
        Any text, such as the id of a participant.
    """
    plain = re.sub(r"[^\w .+=-]", "_", title)
    return plain if plain == title else f"{plain} {_digest(title)}"


def _path(folder: Path, title: str, key: dict[str, Any], what: str) -> Path:
    text = json.dumps(files.provenance(fit=key)["parameters"], sort_keys=True)
    return folder / f"{safe(title)} {_digest(text)} {what}.parquet"


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:10]
