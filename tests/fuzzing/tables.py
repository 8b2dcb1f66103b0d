"""Tables of evidence: in memory and as files of the commands that read them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import log_softmax

from bgmodel import first_crossing
from bgmodel.integrators.sprt import Msprt
from bgmodel.support.files import read_table
from bgmodel.tables.evidence import trials_from_table
from bgmodel.tables.trials import trial_table
from tests.fuzzing.case import Case, Rng, pick

NAMES = ("left", "right", "up", "a b", "1", "S1", "näher", "x.y")
IDS = {
    "numbers": lambda n, rng: rng.permutation(10 * n)[:n],
    "text": lambda n, rng: np.array([f"s{k:04d}" for k in rng.permutation(n)], dtype=object),
    "zeros before": lambda n, rng: np.array([f"{k:05d}" for k in range(n)], dtype=object),
    "dotted": lambda n, rng: rng.permutation(n) + 0.5,
}
EXTRA = {
    "block": lambda n, rng: rng.integers(0, 3, n),
    "rt": lambda n, rng: rng.gamma(2, 0.3, n).round(3),
    "condition": lambda n, rng: rng.choice(["easy", "hard"], n),
    "response": lambda n, rng: rng.choice(["NA", "x", ""], n),
    "model": lambda n, rng: rng.choice(["m1", "m2"], n),
}


def evidence_table(rng: Rng) -> pd.DataFrame:
    """Return a valid table: unequal trials, ids and columns of any kind."""
    trials, most = int(rng.integers(1, 25)), int(rng.integers(1, 15))
    names = rng.permutation(NAMES)[: int(rng.integers(2, 6))]
    lengths = rng.integers(1, most + 1, trials) if rng.random() < 0.7 else np.full(trials, most)
    of = np.repeat(np.arange(trials), lengths)
    scale = pick(rng, 0.0, 0.3, 1.0, 4.0)
    table = pd.DataFrame({"trial": IDS[pick(rng, *IDS)](trials, rng)[of]})
    table["step"] = np.concatenate([np.arange(n) for n in lengths]) + int(rng.integers(2))
    for name in names:
        table[f"ll_{name}"] = rng.normal(0, scale, len(of)) if scale else 0.0
    if rng.random() < 0.6:
        table["truth"] = rng.choice(names, trials)[of]
    if rng.random() < 0.3:
        table["participant_id"] = np.array(["p1", "p2"])[np.arange(trials) % 2][of]
    for name in rng.permutation(list(EXTRA))[: int(rng.integers(4))]:
        table[name] = EXTRA[name](trials, rng)[of]
    if rng.random() < 0.2:
        table["eye_x"] = rng.normal(0, 1, len(of))
    if rng.random() < 0.5:
        # The rows in any order; trials keep the order in which each is first named.
        table = table.sample(frac=1, random_state=int(rng.integers(2**31)))
    order = rng.permutation(table.columns)
    return table[order].reset_index(drop=True)


def _first_ll(table: pd.DataFrame) -> str:
    return next(name for name in table if name.startswith("ll_"))


def _with(table: pd.DataFrame, name: str, row: int, value: Any) -> pd.DataFrame:
    column = table[name].astype(object).copy()
    column.iloc[row] = value
    return table.assign(**{name: column})


BREAKS: dict[str, Callable[[pd.DataFrame, Rng], pd.DataFrame]] = {
    "no step": lambda t, rng: t.drop(columns="step"),
    "no trial": lambda t, rng: t.drop(columns="trial"),
    "one hypothesis": lambda t, rng: t.drop(
        columns=[n for n in t if n.startswith("ll_") and n != _first_ll(t)]
    ),
    "no rows": lambda t, rng: t.head(0),
    "twice": lambda t, rng: pd.concat([t, t.iloc[[int(rng.integers(len(t)))]]]),
    "a gap": lambda t, rng: t.assign(step=t["step"] * 2 + 3),
    "late": lambda t, rng: t.assign(step=t["step"] + 5),
    "half a step": lambda t, rng: t.assign(step=t["step"] + 0.5),
    "a word": lambda t, rng: _with(t, _first_ll(t), int(rng.integers(len(t))), "much"),
    "infinite": lambda t, rng: _with(t, _first_ll(t), int(rng.integers(len(t))), np.inf),
    "missing": lambda t, rng: _with(t, _first_ll(t), int(rng.integers(len(t))), np.nan),
    "no id": lambda t, rng: _with(t, "trial", int(rng.integers(len(t))), None),
    "no such truth": lambda t, rng: t.assign(truth="nobody"),
    "LL_": lambda t, rng: t.rename(columns={_first_ll(t): _first_ll(t).replace("ll_", "LL_")}),
    "a blank": lambda t, rng: t.rename(columns={_first_ll(t): _first_ll(t) + " "}),
    "no name": lambda t, rng: t.assign(ll_=0.0),
    "ll-": lambda t, rng: t.assign(**{"ll-more": 0.0}),
    "Trial": lambda t, rng: t.rename(columns={"trial": "Trial"}),
    "row": lambda t, rng: t.assign(row=1),
}


def broken_or_not(rng: Rng) -> tuple[pd.DataFrame, bool]:
    """Return a table, valid by half."""
    table, valid = evidence_table(rng), bool(rng.random() < 0.5)
    return (table if valid else BREAKS[pick(rng, *BREAKS)](table, rng)), valid


def in_order(table: pd.DataFrame) -> list[tuple[Any, pd.DataFrame]]:
    """Return the trials of a table, plainly: key and rows by step, as first named."""
    keys = [name for name in ("participant_id", "trial") if name in table]
    groups: dict[Any, list[int]] = {}
    for row, key in enumerate(zip(*(table[name] for name in keys), strict=True)):
        groups.setdefault(key, []).append(row)
    return [(key, table.iloc[rows].sort_values("step")) for key, rows in groups.items()]


def decided(rows: pd.DataFrame, threshold: float, gap: float | None, gain: float = 1.0):
    """Decide a trial in plain NumPy: (choices that are equally good, reading, forced)."""
    columns = [name for name in rows if name.startswith("ll_")]
    total = gain * rows[columns].to_numpy(dtype=float).cumsum(axis=0)
    if gap is None:
        out, level = -log_softmax(total, axis=1), threshold
    else:
        z = total[:, 1] - total[:, 0]
        out, level = np.stack([z, -z], axis=1), -gap / 2
    met = (out <= level + 1e-10).any(axis=1)
    k = int(np.argmax(met)) if met.any() else len(out) - 1
    best = np.flatnonzero(out[k] <= out[k].min() + 1e-9)
    return {columns[i][3:] for i in best}, k + 1, not met.any()


def check_decisions(
    table: pd.DataFrame,
    found: pd.DataFrame,
    threshold: float,
    gap: float | None,
    gain: float = 1.0,
    step_s: float = 0.5,
    forced: bool = True,
) -> None:
    """Hold a trial table to the plain decision of every trial, its ids and its columns."""
    trials = in_order(table)
    assert len(found) == len(trials)
    varying = {"step", "truth", "eye_x"} | {n for n in table if n.startswith("ll_")}
    for (key, rows), one in zip(trials, found.to_dict("records"), strict=True):
        assert str(one["trial"]) == str(key[-1])
        assert table.loc[one["row"], "trial"] == rows["trial"].iloc[0]
        for name in set(table) - varying - {"trial"}:
            mine = f"given_{name}" if name in ("rt", "response", "model") else name
            assert str(one[mine]) == str(rows[name].iloc[0]), name
        choices, reading, late = decided(rows, threshold, gap, gain)
        if late and not forced:
            assert one["undecided"]
            assert np.isnan(one["rt"])
            continue
        assert one["response"] in choices
        assert bool(one["forced"]) == late
        assert one["rt"] == reading * step_s or abs(one["rt"] - reading * step_s) < 1e-9
        assert one["steps"] == reading <= len(rows)
        if "truth" in table:
            assert bool(one["correct"]) == (one["response"] == rows["truth"].iloc[0])


def in_memory(rng: Rng, folder: Path) -> Case:
    """Return a table that is in memory already."""
    table, valid = broken_or_not(rng)

    def check(trials: Any) -> None:
        plain = in_order(table)
        assert list(trials.evidence.readings) == [len(rows) for _, rows in plain]
        columns = [f"ll_{name}" for name in trials.names]
        for k, (key, rows) in enumerate(plain):
            given = rows[columns].to_numpy(dtype=float)
            assert np.array_equal(trials.evidence.log_likelihood[k, : len(rows)], given)
            assert trials.columns["trial"].iloc[k] == key[-1]
            if "truth" in table:
                assert trials.names[trials.evidence.truth[k]] == rows["truth"].iloc[0]
        out = first_crossing(Msprt().run(trials.evidence), np.log(len(columns)) / 2)
        found = trial_table(out, trials, model="m")
        check_decisions(table, found, np.log(len(columns)) / 2, None, step_s=0.001)

    return Case(valid, call=lambda: trials_from_table(table), check=check)


def _written(table: pd.DataFrame, folder: Path, ending: str, rng: Rng) -> Path:
    path = folder / f"mine{ending}"
    path.unlink(missing_ok=True)
    if ending == ".csv":
        table.to_csv(path, index=False)
    else:
        # One type a column, as parquet has it.
        texts = {n: table[n].astype(str) for n in table if table[n].dtype == object}
        table.assign(**texts).to_parquet(path)
    return path


def _read_back(path: Path) -> pd.DataFrame:
    """Return a result, texts as they are written."""
    if path.suffix == ".parquet":
        return read_table(path)
    table = pd.read_csv(path, dtype=str, keep_default_na=False)
    for name in ("rt", "steps", "row"):
        table[name] = pd.to_numeric(table[name].replace("", np.nan))
    table["row"] = table["row"].astype(int)
    for name in ("forced", "undecided"):
        table[name] = table[name] == "True"
    table["correct"] = table["correct"] == "1"
    return table


def table_file(command: str, ending: str) -> Callable[[Rng, Path], Case]:
    """Return the generator of commands on a user's table of one format."""

    def make(rng: Rng, folder: Path) -> Case:
        table, valid = broken_or_not(rng)
        path = _written(table, folder, ending, rng)
        if not valid and ending == ".parquet" and "trial" in table and table["trial"].isna().any():
            # As a word of parquet a missing id would be "None": an empty table stands for it.
            table.drop(columns="ll_left", errors="ignore").iloc[:0].to_parquet(path)
        out = folder / f"out{pick(rng, '.csv', '.parquet')}"
        hypotheses = sum(name.startswith("ll_") for name in table)
        posterior = float(rng.uniform(1 / max(hypotheses, 2) + 0.05, 0.995))
        gap, gain, step_s, forced = None, 1.0, 0.5, True
        given = ["--evidence", str(path)]
        if command == "decide":
            arguments = ["decide", str(out), *given]
            if hypotheses == 2 and rng.random() < 0.5:
                gap = float(rng.uniform(0.1, 8))
                arguments += ["--delta", repr(gap)]
            else:
                arguments += ["--posterior", repr(posterior)]
            if rng.random() < 0.3:
                arguments, forced = [*arguments, "--no-forced"], False
        else:
            gain, step_s = float(rng.uniform(0.3, 1.5)), 0.05
            arguments = ["circuit", "run", str(out), *given, "--engine", "algebra"]
            arguments += ["--circuit", "bogacz_gurney", "--gain", repr(gain)]
            arguments += ["--posterior", repr(posterior)]

        def check() -> None:
            back = _read_back(out)
            given_table = table
            if ending == ".csv":
                given_table = pd.read_csv(path, dtype=str, keep_default_na=False)
                for name in given_table:
                    if name.startswith("ll_") or name == "step":
                        given_table[name] = pd.to_numeric(given_table[name])
            level = -np.log(posterior)
            check_decisions(given_table, back, level, gap, gain, step_s, forced)

        return Case(valid, arguments, check=check)

    return make
