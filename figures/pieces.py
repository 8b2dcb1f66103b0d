"""Shared by all measurements: stored pieces, estimates of the remaining time, and tables.

A score consists of pieces, one condition each. A finished piece is stored in ``benchmarks/out``
with its trials, arguments, seed and circuits, and is computed again only if one of these changes.
Once all pieces are finished, the tables are written to the room of the score. ``--fast`` is the
coarse form, with fewer trials, stored in ``benchmarks/out/fast``.
"""

from __future__ import annotations

import inspect
import io
import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from circuits.anatomy import load_circuit
from circuits.declaration.table_writer import identity
from circuits.store import Entry
from figures.rooms import OUT, write

TABLE = "spiking_msprt"
"""The circuit that most scores are of."""
Made = dict[str, pd.DataFrame]
"""Tables of results, by kind of piece."""


@dataclass(frozen=True)
class Piece:
    """One condition of a score.

    Parameters
    ----------
    kind, name : str
        Which of the score's tables it goes into, and its own name.
    trials : int
        What it is made from.
    seconds : float
        CPU time, about: an estimate that is printed before it starts.
    make : function
        Computes it.
    of_circuit : bool
        Whether a circuit takes part. A piece without one, such as a fit of the test, is kept when
        the score's circuits change.
    """

    kind: str
    name: str
    trials: int
    seconds: float
    make: Callable[[], pd.DataFrame]
    of_circuit: bool = True


def unchanged(made: Made) -> Mapping[str, tuple[str, pd.DataFrame]]:
    """Return the pieces of each kind as a table of its name."""
    return {kind: (kind, table) for kind, table in made.items()}


@dataclass(frozen=True)
class Score:
    """A score: its pieces, and the tables that pages show.

    Parameters
    ----------
    name : str
        First word of its files.
    seed : int, optional
        One that tuned nothing; None where each piece has its own.
    channels : sequence of int
        Numbers of alternatives of its circuits.
    pieces : function
        Takes whether the coarse form is asked for, and the number of threads.
    tables : function
        Takes what was found; returns each table of the pages with the kind that it comes from. By
        default each kind is a table.
    circuit : str
        The table that is scored; "" where others alone are.
    others : tuple of str
        Names of further tables that are.
    partial : bool
        Whether tables are written from the pieces that are finished, before all of them are.
    room : path, optional
        The folder whose ``tables`` it writes: that of the function ``pieces`` by default.
    """

    name: str
    seed: int | None
    channels: Sequence[int]
    pieces: Callable[[bool, int], Iterable[Piece]]
    tables: Callable[[Made], Mapping[str, tuple[str, pd.DataFrame]]] = unchanged
    circuit: str = TABLE
    others: tuple[str, ...] = ()
    partial: bool = False
    room: Path | None = None

    def behind(self, trials: Sequence[int], fast: bool) -> dict[str, Any]:
        """Return the parameters of a table: trials (the fewest and the most) and circuits."""
        span = sorted({min(trials), max(trials)})
        named = [(self.circuit, "")] * bool(self.circuit) + [(n, f"{n} ") for n in self.others]
        circuits = {
            f"{begun}{n}": identity(load_circuit(name, n))
            for name, begun in named
            for n in self.channels
        }
        parameters = {"trials": span[0] if len(span) == 1 else span, "circuits": circuits}
        return parameters | ({"fast": True} if fast else {})

    def entry(self, piece: Piece, folder: Path, fast: bool) -> Entry[pd.DataFrame]:
        """Return the place of a piece from its trials and arguments, this seed and circuits."""
        title = f"{self.name} {piece.kind} {piece.name}"
        key = {"piece": title, "seed": self.seed, **self.behind([piece.trials], fast)}
        key["arguments"] = _arguments(piece.make)
        if not piece.of_circuit:
            del key["circuits"]
        # As text, so that tables are made from the numbers that are written. A new version of the
        # package does not make them again.
        return Entry(
            folder, "", key,
            lambda table: {"csv": np.array(table.to_csv(index=False))},
            lambda arrays: pd.read_csv(io.StringIO(str(arrays["csv"]))),
            title,
        )  # fmt: skip


def _arguments(make: Callable[..., Any]) -> list[str]:
    """Return what a piece is computed from, as text, save the number of threads."""
    if not isinstance(make, partial):
        return []
    names = inspect.signature(make.func).parameters
    named = {**dict(zip(names, make.args, strict=False)), **make.keywords}
    # An object whose text is its address is stated by its type.
    texts = {name: re.sub(r" at 0x\w+", "", repr(value)) for name, value in named.items()}
    return [f"{name}={text}" for name, text in sorted(texts.items()) if name != "workers"]


def run(score: Score, pieces: Sequence[Piece], folder: Path, fast: bool, only: str) -> None:
    """Compute the remaining pieces of a score, and write its tables when all are present."""
    for piece in pieces:
        entry = score.entry(piece, folder, fast)
        if only in entry.title and entry.get() is None:
            print(f"{entry.title}, {piece.trials} trials", end=" ", flush=True)
            begun = time.process_time()
            entry.put(piece.make())
            print(f"{time.process_time() - begun:.0f} s (said: {piece.seconds:.0f})", flush=True)
    tables = [(piece, score.entry(piece, folder, fast).get()) for piece in pieces]
    there = [(piece, table) for piece, table in tables if table is not None]
    left = [piece.name for piece, table in tables if table is None]
    if left:
        some = score.partial and there
        which = "tables of what is there" if some else "no tables yet"
        print(f"{score.name}: {which}, what is left is {'; '.join(left)}")
        if not some:
            return
    write_tables(score, there, fast)


def write_tables(score: Score, pieces: Sequence[tuple[Piece, pd.DataFrame]], fast: bool) -> None:
    """Write the tables of a score from some of its pieces."""
    made: dict[str, list[pd.DataFrame]] = {}
    for piece, table in pieces:
        made.setdefault(piece.kind, []).append(table)
    joined = {kind: pd.concat(parts, ignore_index=True) for kind, parts in made.items()}
    for name, (kind, rows) in score.tables(joined).items():
        behind = score.behind([piece.trials for piece, _ in pieces if piece.kind == kind], fast)
        room = score.room or Path(inspect.getfile(score.pieces)).parent
        path = write(rows, room / "tables" / f"{score.name}_{name}.csv", seed=score.seed, **behind)
        print(f"\n{path.name}\n{rows.round(3).to_string(index=False)}", flush=True)


def measure(*scores: Score, fast: bool = False, only: str = "", workers: int = 2) -> None:
    """Print the expected time, then compute the remaining pieces of some scores.

    ``fast`` is the coarse form; ``only``, a part of the names of files, selects pieces.
    """
    folder = OUT / "fast" if fast else OUT
    every = {score: list(score.pieces(fast, workers)) for score in scores}
    left = [
        piece.seconds
        for score, pieces in every.items()
        for piece in pieces
        for entry in [score.entry(piece, folder, fast)]
        if only in entry.title and entry.get() is None
    ]
    print(
        f"{len(left)} of {sum(map(len, every.values()))} pieces are left: about "
        f"{sum(left) / 60:.0f} minutes of CPU. What is finished stays in {folder}.",
        flush=True,
    )
    for score, pieces in every.items():
        if pieces:
            run(score, pieces, folder, fast, only)


def wide(table: pd.DataFrame, index: Sequence[str]) -> pd.DataFrame:
    """Return a table with one row per index, in their order, and one column per measure.

    From the columns of the index, measure, value, low and high, each measure gets its value,
    ``<measure>_low`` and ``<measure>_high``.
    """
    order = table[list(index)].drop_duplicates()
    by = table.pivot(index=list(index), columns="measure", values=["value", "low", "high"])
    by.columns = [name if end == "value" else f"{name}_{end}" for end, name in by.columns]
    return order.merge(by.reset_index(), on=list(index))
