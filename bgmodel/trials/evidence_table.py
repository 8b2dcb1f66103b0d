"""Evidence read from a user's table, with all trials, ids and columns."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.deciding.calibration import warn_of_units
from bgmodel.evidence import MOST_NATS, Evidence, checked_prior
from bgmodel.plausibility import warn_of_copies
from bgmodel.support.checks import path_of
from bgmodel.support.files import read_table
from bgmodel.support.processes import check_evidence_memory
from bgmodel.trials.columns import check_alike, check_numeric, check_spelt, names_once
from bgmodel.trials.files import DECIMAL_SIGN, SEPARATORS, read_text
from bgmodel.trials.named_evidence import RESULT, NamedEvidence
from circuits.arrays import Array
from circuits.errors import InputError, within

KEYS = ("participant_id", "trial")
"""Columns that identify trials, the first one only if a table has it."""
OURS = (*KEYS, "step", "truth")
"""Columns of an evidence table with a meaning, in addition to ``ll_<hypothesis>``."""
COMMA = re.compile(r"\s*[+-]?\d+,\d+\s*")


def read_evidence_table(
    path: str | Path,
    *,
    prior: Sequence[float] | None = None,
    onset_ms: float = 0.0,
    step_ms: float = 1.0,
) -> NamedEvidence:
    """Read a user's evidence from a file; see ``trials_from_table`` for its columns."""
    path = path_of(path)
    plain = path.suffix in SEPARATORS and path.is_file()
    table = read_csv_table(path) if plain else read_table(path)
    try:
        return trials_from_table(table, prior=prior, onset_ms=onset_ms, step_ms=step_ms)
    except ValueError as error:
        raise within(path.name, error, "path") from None


def read_evidence(
    path: str | Path,
    *,
    step_ms: float,
    prior: Sequence[float] | None = None,
    onset_ms: float = 0.0,
) -> Evidence:
    """Read a user's evidence from a .csv, .tsv or .parquet file.

    Parameters
    ----------
    path : path
        One row per reading: ``trial``; ``step``, 1, 2, ... in each trial; a column ``ll_<name>``
        for each hypothesis, with the natural logarithm of p(reading | hypothesis); and, if known,
        ``truth``, the name of the true hypothesis. See ``trials_from_table`` for details.
    step_ms : float
        Time between readings, ms.
    prior : sequence of float, optional
        Prior probabilities of the hypotheses; equal by default.
    onset_ms : float
        Onset of evidence, ms.

    Raises
    ------
    ValueError
        With the name of the file, the column and what is allowed.
    """
    table = read_evidence_table(path, prior=prior, onset_ms=onset_ms, step_ms=step_ms)
    return table.evidence


def trials_from_table(
    table: pd.DataFrame,
    *,
    prior: Sequence[float] | None = None,
    onset_ms: float = 0.0,
    step_ms: float = 1.0,
    shared: bool = False,
) -> NamedEvidence:
    """Return the trials of a user's table of evidence; trials may differ in length.

    One row per reading, in any order, with the columns of ``read_evidence``; participant_id makes
    equal ids distinct, other columns are copied to the results, and the baseline is the mean of all
    readings. With ``shared``, participants may have the same readings without a warning.
    """
    columns = _hypotheses(table)
    if len(table) == 0:
        raise InputError("an evidence table needs at least one trial, got 0 rows", "table", table)
    keys = [name for name in KEYS if name in table.columns]
    trial, first_row = _numbered(table, keys)
    step = _steps(table, trial, keys)
    lengths = np.bincount(trial)
    shape = (len(first_row), int(lengths.max()), len(columns))
    check_evidence_memory(*shape)
    values = np.zeros(shape)
    values[trial, step] = _numbers(table, columns)
    names = [name[3:] for name in columns]
    truth = _truth_of(table, names, trial, first_row) if "truth" in table.columns else None
    prior_array = None if prior is None else checked_prior(prior, len(columns))
    evidence = Evidence(
        values,
        truth,
        prior_array,  # type: ignore[arg-type]
        onset_ms,
        step_ms,
        lengths,
        baseline=float(values.sum() / (lengths.sum() * len(columns))),
    )
    people = np.zeros(len(first_row), dtype=np.intp)
    if shared and len(keys) > 1:
        people = pd.factorize(table["participant_id"].iloc[first_row])[0]
    for person in np.unique(people):
        warn_of_copies(values[people == person], lengths[people == person])
    warn_of_units(evidence)
    extra = [name for name in table.columns if name not in (*columns, "step", "truth")]
    varying = [name for name in extra if not _constant(table[name], trial, first_row)]
    kept = table[[name for name in extra if name not in varying]].iloc[first_row]
    for name in kept:
        if name == "row" or (name in RESULT and f"given_{name}" in kept):
            raise InputError(f"the column {name} is reserved for results: rename it", "columns")
    kept = kept.reset_index(drop=True).assign(row=first_row)
    return NamedEvidence(evidence, names, kept, [str(name) for name in varying])


def read_csv_table(path: Path) -> pd.DataFrame:
    """Return a table of text, with numbers only for log-likelihoods and plain numeric columns."""
    table = read_text(path, "ll_")
    texts = [name for name in table.columns if not str(name).startswith("ll_")]
    return table.assign(**{name: _typed(table[name]) for name in texts})


def _typed(column: pd.Series) -> pd.Series:
    """Convert text to numbers if each is written as Python would; otherwise leave it unchanged."""
    codes, texts = pd.factorize(column.astype(object))
    for kind in (int, float):
        try:
            numbers = np.array([kind(text) for text in texts])
        except (ValueError, OverflowError):
            continue
        same = all(str(kind(text)) == text for text in texts)
        # Whole numbers of mixed sign and size would become floats.
        fits = numbers.dtype.kind in ("iu" if kind is int else "f")
        if same and fits and np.isfinite(numbers).all():
            return pd.Series(numbers[codes], index=column.index)
    return column.astype(object)


def _hypotheses(table: pd.DataFrame) -> list[str]:
    """Return the columns of log-likelihoods; ValueError for misleading names of columns."""
    names = names_once(table.columns)
    for name in names:
        check_spelt(name, OURS)
        close = re.fullmatch(r"ll(\W.*|_.*)?", name.strip().lower(), re.DOTALL)
        if close and not _is_hypothesis(name):
            rule = "these are ll_<name>, lower case, no blank around the name"
            raise InputError(f"column {name!r} is not a hypothesis: {rule}", "columns")
    columns = [name for name in names if _is_hypothesis(name)]
    absent = [name for name in ("trial", "step") if name not in names]
    if absent or len(columns) < 2:
        needed = "trial, step and at least two ll_<hypothesis>"
        raise InputError(f"an evidence table needs the columns {needed}, got {names}", "columns")
    return columns


def _is_hypothesis(name: str) -> bool:
    called = name.removeprefix("ll_")
    return called != name and called != "" and called == called.strip()


def _numbered(
    table: pd.DataFrame, keys: list[str]
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return the number of each row's trial, in the order of the table, and their first rows."""
    if "participant_id" in keys:
        check_alike("participant_id", table["participant_id"].astype(str).to_numpy(dtype=np.str_))
    for name in keys:
        missing = table[name].isna() | (table[name].astype(object) == "")
        if missing.any():
            row = int(np.argmax(missing))
            raise InputError(f"{name} is missing in row {row} ({missing.sum()} rows)", name)
    try:
        trial = table.groupby(keys, sort=False).ngroup().to_numpy()
    except TypeError as error:
        raise InputError(f"{' and '.join(keys)} must hold ids: {error}", keys[0]) from None
    return trial.astype(np.intp), np.unique(trial, return_index=True)[1]


def _steps(
    table: pd.DataFrame, trial: npt.NDArray[np.intp], keys: list[str]
) -> npt.NDArray[np.intp]:
    check_numeric(table["step"])
    step = pd.to_numeric(table["step"], errors="coerce").to_numpy(dtype=np.float64)
    wrong = ~(np.isfinite(step) & (step == np.floor(step)))
    if wrong.any():
        bad = table["step"].iloc[int(np.argmax(wrong))]
        raise InputError(
            f"step must be a whole number, got {bad!s} in row {int(np.argmax(wrong))}", "step"
        )
    order = np.lexsort((step, trial))
    ordered, of = step[order], trial[order]
    begins = np.append(True, of[1:] != of[:-1])
    start = ordered[begins].min()
    jump = np.append(0.0, np.diff(ordered))
    wrong = np.where(begins, ordered != start, jump != 1)
    if start not in (0, 1) or wrong.any():
        at = int(np.argmax(wrong)) if wrong.any() else 0
        which = " ".join(f"{name} {table[name].iloc[order[at]]}" for name in keys)
        if not begins[at] and jump[at] == 0:
            hint = "" if len(keys) > 1 else " (two participants? give participant_id)"
            raise InputError(f"{which} has step {ordered[at]:g} twice{hint}", "step", ordered[at])
        came = "starts with" if begins[at] else f"goes from {ordered[at - 1]:g} to"
        raise InputError(
            "steps count readings, 0, 1, 2, ... or 1, 2, 3, ... in every trial: "
            f"{which} {came} {ordered[at]:g}",
            "step",
        )
    return np.asarray(step - start, dtype=np.intp)


def _numbers(table: pd.DataFrame, columns: list[str]) -> Array:
    for name in columns:
        check_numeric(table[name])
    values: Array
    values = table[columns].apply(pd.to_numeric, errors="coerce").to_numpy(dtype=np.float64)
    wrong = ~(np.abs(values) <= MOST_NATS)
    if wrong.any():
        row, column = np.argwhere(wrong)[0]
        trial, step, value = (table[name].iloc[row] for name in ("trial", "step", columns[column]))
        hint = f"; {DECIMAL_SIGN}" if COMMA.fullmatch(str(value)) else ""
        raise InputError(
            f"{columns[column]} must be a finite number within +-{MOST_NATS:.0e} nats, got "
            f"{str(value)!r} at trial {trial}, step {step} ({wrong.sum()} such values){hint}",
            columns[column],
        )
    return values


def _constant(
    column: pd.Series, trial: npt.NDArray[np.intp], first_row: npt.NDArray[np.intp]
) -> bool:
    try:
        codes = pd.factorize(column)[0]
    except TypeError as error:
        name = column.name
        raise InputError(f"column {name!r} can't be compared: {error}", name) from None
    return bool((codes == codes[first_row][trial]).all())


def _truth_of(
    table: pd.DataFrame,
    names: list[str],
    trial: npt.NDArray[np.intp],
    first_row: npt.NDArray[np.intp],
) -> npt.NDArray[np.intp]:
    truth = table["truth"].map(str).astype(object)
    unknown = sorted(set(truth) - set(names))
    codes = pd.factorize(truth)[0]
    wrong = ~truth.isin(names).to_numpy() if unknown else codes != codes[first_row][trial]
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InputError(
            f"truth must be one of {names} (the columns that begin with ll_) and the same in all "
            f"rows of a trial, got {unknown[:5] or 'several in one trial'}, first "
            f"{truth.iloc[row]!r} in row {row} ({wrong.sum()} such rows)",
            "truth",
        )
    return pd.Index(names).get_indexer(pd.Index(truth.iloc[first_row]))
