"""Tables in and out: trial tables, a user's own evidence, and the provenance of every file."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, is_dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from bgmodel.decision import Decision
from bgmodel.evidence import Evidence

PACKAGES = ("bgmodel", "numpy", "scipy", "numba", "pandas", "pyarrow")
KEY = b"bgmodel"


def provenance(seed: int | None = None, **parameters: Any) -> dict[str, Any]:
    """Return what a result file must carry: its parameters, seed and versions.

    No time and no machine goes in, so the same seed gives the same bytes.
    """
    return {
        "parameters": {name: _plain(value) for name, value in parameters.items()},
        "seed": seed,
        "versions": {
            "python": platform.python_version(),
            **{name: metadata.version(name) for name in PACKAGES},
        },
    }


def write_table(
    table: pd.DataFrame, path: str | Path, *, seed: int | None = None, **parameters: Any
) -> Path:
    """Write a table whole or not at all, with its provenance.

    Parameters
    ----------
    table : DataFrame
        What to write.
    path : path
        ``.parquet`` keeps the provenance inside; ``.csv`` has it in ``<name>.json`` beside it.
    seed, parameters :
        See ``provenance``.

    Raises
    ------
    ValueError
        If the ending is neither, or the folder can't be written.
    """
    path = Path(path)
    if path.suffix not in (".parquet", ".csv"):
        raise ValueError(f"a table is written as .parquet or .csv, got {str(path)!r}")
    text = json.dumps(provenance(seed, **parameters), indent=1, sort_keys=True)
    partial = path.with_name(path.name + ".partial")
    check_writable(path.parent)
    if path.suffix == ".csv":
        table.to_csv(partial, index=False)
        sidecar = path.with_suffix(".json.partial")
        sidecar.write_text(text + "\n")
        os.replace(sidecar, path.with_suffix(".json"))
    else:
        _write_parquet(table, partial, text)
    os.replace(partial, path)
    return path


def read_table(path: str | Path) -> pd.DataFrame:
    """Read a ``.parquet`` or ``.csv`` table; raise one clear ValueError if that can't be done."""
    path = Path(path)
    if not path.is_file():
        raise ValueError(f"there is no table {str(path)!r}")
    try:
        if path.suffix == ".parquet":
            return pd.read_parquet(path)
        if path.suffix == ".csv":
            return pd.read_csv(path)
    except (OSError, ValueError, pd.errors.ParserError) as error:
        raise ValueError(f"{str(path)!r} can't be read as {path.suffix}: {error}") from error
    raise ValueError(f"a table is read from .parquet or .csv, got {str(path)!r}")


def read_provenance(path: str | Path) -> dict[str, Any]:
    """Return the provenance that ``write_table`` stored with a table."""
    import pyarrow.parquet as pq

    path = Path(path)
    if path.suffix == ".csv":
        return json.loads(path.with_suffix(".json").read_text())
    return json.loads(pq.read_schema(path).metadata[KEY])


def check_writable(folder: str | Path) -> Path:
    """Make a folder if need be and return it; ValueError if nothing can be written there."""
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(f"the output folder {str(folder)!r} can't be made: {error}") from error
    if not os.access(folder, os.W_OK):
        raise ValueError(f"the output folder {str(folder)!r} can't be written")
    return folder


def trial_table(
    decision: Decision,
    evidence: Evidence,
    *,
    seed: int | None = None,
    model: str = "msprt",
    participant_id: str = "model",
    condition: str = "",
    names: Sequence[str] | None = None,
) -> pd.DataFrame:
    """Return one row a trial, as other tools of the field read it.

    Columns: participant_id, trial, rt (seconds from onset; NaN where undecided), response and
    stimulus (names of hypotheses, empty where there is none), correct (1, 0, or NA without truth),
    undecided, forced, premature, steps, condition, seed, model.
    """
    if decision.choice.ndim != 1:
        raise ValueError(
            f"a trial table holds one threshold, got decisions of shape {decision.choice.shape}"
        )
    labels = np.array([*(names or map(str, range(evidence.hypotheses))), ""], dtype=object)
    truth = evidence.truth
    known = truth is not None
    return pd.DataFrame(
        {
            "participant_id": participant_id,
            "trial": np.arange(evidence.trials),
            "rt": decision.time_ms / 1000,
            "response": labels[decision.choice],
            "stimulus": labels[truth] if known else "",
            "correct": pd.array(
                (decision.choice == truth).astype(int) if known else [None] * evidence.trials,
                dtype="Int8",
            ),
            "undecided": decision.choice < 0,
            "forced": decision.forced,
            "premature": decision.premature,
            "steps": decision.steps,
            "condition": condition,
            "seed": seed,
            "model": model,
        }
    )


def evidence_from_table(
    table: pd.DataFrame,
    *,
    prior: Sequence[float] | None = None,
    onset_ms: float = 0.0,
    step_ms: float = 1.0,
) -> tuple[Evidence, list[str]]:
    """Return the evidence in a user's table, and the names of its hypotheses.

    Parameters
    ----------
    table : DataFrame
        One row a reading: ``trial``, ``step`` and a column ``ll_<name>`` for each hypothesis,
        holding ``log p(reading | hypothesis)`` in nats; optionally ``truth``, a hypothesis's name.
        Every trial has the same number of readings; rows may come in any order.
    prior, onset_ms, step_ms :
        As in ``Evidence``.

    Raises
    ------
    ValueError
        If columns are absent, trials are unequal in length, or a truth is none of the hypotheses.
    """
    columns = [name for name in table.columns if str(name).startswith("ll_")]
    absent = [name for name in ("trial", "step") if name not in table.columns]
    if absent or len(columns) < 2:
        raise ValueError(
            "an evidence table needs the columns trial, step and at least two ll_<hypothesis>, "
            f"got {list(table.columns)}"
        )
    if len(table) == 0:
        raise ValueError("an evidence table needs at least one trial, got 0 rows")
    table = table.sort_values(["trial", "step"], kind="stable")
    lengths = table.groupby("trial").size()
    if lengths.nunique() != 1 or table.duplicated(["trial", "step"]).any():
        raise ValueError(
            "every trial must have the same number of readings, each step once; got "
            f"{lengths.min()} to {lengths.max()} readings a trial"
        )
    names = [name[3:] for name in columns]
    shape = (len(lengths), int(lengths.iloc[0]), len(names))
    values = table[columns].to_numpy(dtype=np.float64).reshape(shape)
    truth = _truth_of(table, names) if "truth" in table.columns else None
    prior_array = None if prior is None else np.asarray(prior, dtype=np.float64)
    return Evidence(values, truth, prior_array, onset_ms, step_ms), names  # type: ignore[arg-type]


def _truth_of(table: pd.DataFrame, names: list[str]) -> np.ndarray:
    per_trial = table.groupby("trial")["truth"].agg(["first", "nunique"])
    unknown = set(per_trial["first"].astype(str)) - set(names)
    if unknown or (per_trial["nunique"] != 1).any():
        raise ValueError(
            f"truth must be one of {names} and the same in all rows of a trial, "
            f"got {sorted(unknown) or 'several in one trial'}"
        )
    return np.array([names.index(str(name)) for name in per_trial["first"]])


def _write_parquet(table: pd.DataFrame, path: Path, text: str) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    data = pa.Table.from_pandas(table, preserve_index=False)
    kept = data.schema.metadata or {}
    data = data.replace_schema_metadata({**kept, KEY: text.encode()})
    pq.write_table(data, path, compression="zstd", compression_level=9)


def _plain(value: Any) -> Any:
    """Turn a parameter into what JSON holds."""
    if is_dataclass(value) and not isinstance(value, type):
        return {"kind": type(value).__name__, **{k: _plain(v) for k, v in asdict(value).items()}}
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, np.generic):
        return value.item()
    return value if isinstance(value, (int, float, bool, type(None))) else str(value)
