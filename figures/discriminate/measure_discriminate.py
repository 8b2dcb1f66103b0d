"""Tasks that tell two models apart: pairs that theory says can, or cannot, be told apart.

Each pair is searched with one seed, its best task is checked with another, and two hundred
sequential experiments are simulated with a third. One pair is compared with recorded cells as well.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np
import pandas as pd

from bgmodel.discriminating.discriminate import discriminate
from bgmodel.discriminating.information import Recording
from bgmodel.discriminating.space import Space
from circuits.anatomy import DEFAULT, load_circuit
from figures.pieces import Made, Piece, Score

SEARCH_SEED, CHECK_SEED = 99_101, 99_201
"""Seeds of searches and of checks; simulated experiments have the one after that of the check."""
TRIALS, EVALUATIONS = 600, 40
CHECKED = {"tests": 20_000, "circuit and test": 20_000, "circuits": 8_000}
"""Trials of each kind in the check."""
COARSE = 400
LOST = ("lesion STN 100%", "compensate")
WHOLE, TWO, NO_EDITS, NO_SIGNALS = "whole", "N = 2", "no manipulation", "no signal to STN"
"""Parts of the shipped space."""
CELLS = (1, 10)
NUCLEI = load_circuit(DEFAULT, 2).spiking()
"""Nuclei that are recorded, and numbers of cells."""


@dataclass(frozen=True)
class Pair:
    """Two models, and how they are searched."""

    name: str
    first: str
    second: str
    edits: tuple[str, ...] = ()
    part: str = WHOLE
    thresholds: Literal["matched", "free"] = "matched"

    @property
    def kind(self) -> str:
        """What the models are."""
        count = (self.first, self.second).count(DEFAULT)
        return ("tests", "circuit and test", "circuits")[count]


AVERAGE, TENTH = "max vs average", ("lesion STN 10%",)
PAIRS = (
    Pair("MSPRT, max vs average", "msprt", AVERAGE),
    Pair("MSPRT, max vs average, N = 2", "msprt", AVERAGE, part=TWO),
    Pair("STN 10 % lost, no manipulation", DEFAULT, DEFAULT, TENTH, NO_EDITS),
    Pair("STN 10 % lost", DEFAULT, DEFAULT, TENTH),
    Pair("STN lost, recovered", DEFAULT, DEFAULT, LOST),
    Pair("STN lost, recovered, no signal to STN", DEFAULT, DEFAULT, LOST, NO_SIGNALS),
    Pair("the same, thresholds free", DEFAULT, DEFAULT, LOST, NO_SIGNALS, "free"),
    Pair("GPe 10 % lost", DEFAULT, DEFAULT, ("lesion GPe 10%",)),
    Pair("circuit, MSPRT", DEFAULT, "msprt"),
)
"""Where one circuit is named twice, the first model is intact."""


def space_of(pair: Pair) -> Space:
    """Return the tasks of a pair: the shipped ones, or a part of them."""
    space = Space.shipped()
    quiet = tuple(text for text in space.edits if "STN" not in text)
    parts: dict[str, dict[str, Any]] = {
        WHOLE: {},
        TWO: {"channels": (2,)},
        NO_EDITS: {"edits": ("",)},
        NO_SIGNALS: {"stop_nats": (0.0,), "edits": quiet},
    }
    return replace(space, **parts[pair.part])


def found(pair: Pair, fast: bool, workers: int) -> pd.DataFrame:
    """Return the result of a pair: its trials, and its map of the space, one below the other."""
    begun = time.process_time()
    result = discriminate(
        pair.first, pair.second, second_edits=pair.edits, space=space_of(pair),
        trials=COARSE if fast else TRIALS, evaluations=8 if fast else EVALUATIONS,
        check_trials=COARSE if fast else CHECKED[pair.kind], seed=SEARCH_SEED,
        check_seed=CHECK_SEED, workers=workers, thresholds=pair.thresholds,
    )  # fmt: skip
    taken = time.process_time() - begun
    levels = {f"{name}_level": way.levels[0] for name, way in zip(
        ("first", "second"), result.check.directions, strict=True)}  # fmt: skip
    about = {
        "verdict": result.verdict, "best": result.check.design.text(), "cpu_s": taken,
        "same": ", ".join(map(str, result.same)), "tasks": len(result.table),
        "most_nats": result.most_nats, **levels,
    }  # fmt: skip
    trials = result.sequential.assign(part="trials", **about)
    if result.one_rule:
        trials["low"] = np.nan  # no number of trials is enough
    return pd.concat([trials, result.axes().assign(part="axes")]).assign(pair=pair.name)


def recorded(count: int, trials: int, workers: int) -> pd.DataFrame:
    """Return the information of each nucleus's spikes on a loss of a tenth of STN; no probe."""
    rows = []
    for nucleus in NUCLEI:
        result = discriminate(
            DEFAULT, second_edits=TENTH, space=Space(d_prime=(0.7,)), trials=COARSE,
            check_trials=trials, seed=SEARCH_SEED, check_seed=CHECK_SEED, workers=workers,
            recording=Recording(nucleus, cells=count),
        )  # fmt: skip
        rows.append(result.sequential.assign(nucleus=nucleus, cells=count, verdict=result.verdict))
    return pd.concat(rows)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield a piece per pair."""
    for pair in PAIRS:
        checked = COARSE if fast else CHECKED[pair.kind]
        seconds = 20 if pair.kind == "tests" else 120
        yield Piece("pairs", pair.name, checked, seconds, partial(found, pair, fast, workers))
    checked = COARSE if fast else CHECKED["circuits"]
    for count in CELLS:
        make = partial(recorded, count, checked, workers)
        yield Piece("recorded", f"{count} cells", checked, 60, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return the trials that each pair needs, and the map of its space."""
    pairs = made["pairs"]
    trials = pairs[pairs["part"] == "trials"]
    kept = [
        "pair", "truth", "nats", "error", "median", "low", "high", "wald_mean", "simulated_median",
        "right", "verdict", "best", "same", "tasks", "most_nats", "first_level", "second_level",
        "cpu_s",
    ]  # fmt: skip
    shown = trials[kept].replace({float("inf"): float("nan")})
    axes = pairs[pairs["part"] == "axes"]
    columns = ["nucleus", "cells", *kept[1:11]]
    seen = made["recorded"][columns].replace({float("inf"): float("nan")})
    return {
        "trials": ("pairs", shown),
        "axes": ("pairs", axes[["pair", "axis", "value", "tried", "nats", "low"]]),
        "recorded": ("recorded", seen),
    }


SCORE = Score("discriminate", CHECK_SEED, (2, 4), pieces, tables, circuit=DEFAULT)
