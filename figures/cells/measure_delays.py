"""Delays of recorded cells: held-out nats of a regression on clicks, by when cells read the sum."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import pandas as pd

from figures.cells.compared import SHIPPED, delayed
from figures.cells.measure_cells import SEED, TRIALS
from figures.pieces import Made, Piece, Score, main


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield the one piece."""
    yield Piece("delays", "clicks", TRIALS, 15, partial(delayed, SHIPPED))


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return the sum over cells at each delay, and that of each cell's best."""
    delays = made["delays"].groupby("delay_s")["nats"].sum().reset_index()
    best = made["delays"].groupby("cell")["nats"].max().sum()
    return {"delays": ("delays", delays.assign(best_of_each=best))}


SCORE = Score("cells", SEED, (), pieces, tables, circuit="")

if __name__ == "__main__":
    main(SCORE)
