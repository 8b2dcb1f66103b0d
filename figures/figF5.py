"""Figure F5: rates of the circuit fitted to monkeys' choices, in the windows of STN recordings.

STN cells are driven at onset. The parameters are those fitted to each monkey's choices and response
times; rates were not fitted.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from bgmodel.support.files import read_table, write_table
from circuits.dynamics.fixed_point import resting_hz
from figures.common import Settings, key, letter, run, say_if_older, where
from figures.fitted import MONKEYS, ONSET, STRENGTHS, Followed, fitted, fitted_table, follow
from figures.windows import (
    ABOUT_MS,
    PREFERRED,
    WINDOWS,
    averaged,
    finish_rows,
    likeness,
    name_patterns,
)

NUCLEI = ("STN", "STN_onset", "GPe", "SNr")
SECONDS = 2.5
AFTER_MS, BEFORE_MS = 80.0, 100.0
"""Time from decision to response; and, for another split of t0, from motion to evidence.

LIP cells reach a common level about 80 ms before the saccade (Roitman & Shadlen 2002); that the
remainder of t0 precedes the evidence is an assumption.
"""
SPLITS = ("80 ms after the decision", "100 ms before the evidence")
COLOUR = {True: "C0", False: "C1"}
MARKS = ("o-", "s--")
FILLS = ["C2", "C4", "C3"]


def compute(settings: Settings, parameters: Path, *, output: Path) -> None:
    """Run the circuit fitted to each monkey at five coherences; average rates in the windows."""
    table, parts = read_table(parameters), []
    for who in sorted(table.loc[table["data"] == MONKEYS, "participant"].unique()):
        values = fitted(table, who, ONSET)
        tuned = fitted_table(ONSET, values)
        rest = resting_hz(tuned)
        for strength in STRENGTHS:
            did = follow(tuned, values, strength, settings.circuit_trials, SECONDS, settings.seed)
            t0_ms = 1000 * values["t0_s"]
            early = (max(t0_ms - AFTER_MS, 0.0), min(t0_ms, BEFORE_MS))
            for split, before_ms in zip(SPLITS, early, strict=True):
                found = seen_from_motion(did, before_ms, t0_ms, rest)
                parts.append(found.assign(participant=who, strength=strength, split=split))
    write_table(pd.concat(parts), output, seed=settings.seed, settings=settings)


def seen_from_motion(
    did: Followed, before_ms: float, t0_ms: float, rest: dict[str, float]
) -> pd.DataFrame:
    """Return rates in the windows, with time 0 at motion onset as in recordings.

    Parameters
    ----------
    did : Followed
        The circuit's activity, with time 0 at the onset of evidence.
    before_ms : float, ms
        From motion to evidence; until then the circuit is at rest.
    t0_ms : float, ms
        Total non-decision time.
    rest : dict of float
        Resting rates, Hz.
    """
    step = did.time_ms[1] - did.time_ms[0]
    before = round(before_ms / step)
    time = step * (np.arange(before + len(did.time_ms)) + 1)
    still = (len(did.choice), before, 2)
    rates = {
        name: np.concatenate([np.full(still, rest[name], np.float32), did.rates_hz[name]], axis=1)
        for name in NUCLEI
    }
    at = did.at_ms + t0_ms
    # Trials whose last window extends beyond the end are left out.
    whole = at + ABOUT_MS <= time[-1]
    return averaged(rates, time, np.where(whole, did.choice, -1), at, rest)


def draw(settings: Settings, data: Path, parameters: Path, *, output: Path) -> Figure:
    """Draw a row per nucleus and a column per window, and the similarity to the three patterns."""
    whole = read_table(data)
    table = where(whole, split=SPLITS[0])
    names = sorted(table["participant"].unique())
    figure, axes = plt.subplots(
        len(NUCLEI), 4, figsize=(7.4, 6.6), sharex="col", width_ratios=[1, 1, 1, 1.1]
    )
    by: Any = table.set_index(["participant", "nucleus", "window", "own"]).sort_index()
    for row, nucleus in zip(axes, NUCLEI, strict=True):
        for ax, window in zip(row[:3], WINDOWS, strict=True):
            for name, mark in zip(names, MARKS, strict=False):
                for own, colour in COLOUR.items():
                    here = by.loc[(name, nucleus, window, own)].sort_values("strength")
                    ax.errorbar(
                        100 * here["strength"], here["hz"], 1.96 * here["se"], fmt=mark, ms=2.5,
                        lw=0.9, color=colour, mfc=colour if mark == MARKS[0] else "w",
                        label=f"monkey {name}, {PREFERRED[own]}",
                    )  # fmt: skip
        _likeness(row[3], where(whole, nucleus=nucleus), names)
    percent = [100 * strength for strength in STRENGTHS]
    letter(axes[0, 0], "a  100-300 ms")
    letter(axes[0, 1], "b  300-500 ms")
    letter(axes[0, 2], "c  response ± 100 ms")
    letter(axes[0, 3], "d  similarity")
    finish_rows(axes, NUCLEI, percent, [f"{each:.3g}" for each in percent], "coherence (%)")
    key(figure, axes[0, 0], axes[0, 3], ncols=3)
    say_if_older(figure, parameters)
    return figure


def _likeness(ax: Any, rows: pd.DataFrame, names: list[str]) -> None:
    """Show the correlation with each pattern, one bar per monkey, and for the other split of t0."""
    for k, name in enumerate(names):
        found, other = (
            likeness(where(rows, participant=name, split=split), STRENGTHS) for split in SPLITS
        )
        place = np.arange(len(found)) + 0.3 * (k - 0.5)
        fill = FILLS if k == 0 else ["w"] * len(found)
        ax.barh(place, list(found.values()), height=0.28, edgecolor=FILLS, lw=0.8, color=fill)
        ax.plot(list(other.values()), place, "k|", ms=7, mew=1.4)
    ax.plot([], [], "s", color="0.4", label=f"similarity, monkey {names[0]}")
    ax.plot([], [], "s", color="0.4", mfc="w", label=f"similarity, monkey {names[1]}")
    ax.plot([], [], "k|", ms=7, mew=1.4, label=f"similarity, {BEFORE_MS:.0f} ms to evidence")
    name_patterns(ax, list(found))


if __name__ == "__main__":
    run(compute=compute, draw=draw)
