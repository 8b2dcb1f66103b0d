"""Figure C6: designed trials, on which theories of decisions disagree."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bgmodel.comparison.designed import (
    APART_MS,
    CLOSE_MS,
    MSPRT,
    THRESHOLDS,
    designed_circuit,
    designs,
)
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.sprt import Msprt
from bgmodel.support.files import read_table, write_table
from circuits.anatomy import load_circuit
from circuits.engines import Ensemble, Population
from figures.common import GAIN, Settings, bars, key, letter, run, where

CHANNELS = 4
CIRCUITS = {"macaque": "C0", "spiking_msprt": "C4"}
MINUS_LN_P = "-ln P"
READINGS = 38
EVERY_MS = 5.0
THEORIES = {MSPRT: "k", "max vs next": "C1", "max vs average": "C2"}
MARKS = dict(zip(THRESHOLDS, "os^", strict=True))
SHOWN = 0.25
"""OUT at which the theories' times are shown with the traces."""
SHARE = 6
"""Divisor of the number of trials of the other circuit figures, per design."""


def traces(settings: Settings, *, output: Path) -> None:
    """Compute OUT of populations without noise, and -ln P, for each design."""
    parts = []
    for design in designs(CHANNELS):
        evidence = design.evidence(READINGS, kappa=GAIN)
        engine = Population(noise=False, rates=False, sample_ms=EVERY_MS)
        models: dict[str, Any] = {
            name: BasalGanglia(load_circuit(name, CHANNELS), engine, GAIN, settings.seed)
            for name in CIRCUITS
        }
        for name, model in {MINUS_LN_P: Msprt(GAIN), **models}.items():
            trace = model.run(evidence)
            known = {"model": name, "design": design.name, "held": design.held}
            drawn = {"time_ms": trace.time_ms, "out_nats": trace.out_nats[0, :, 0]}
            parts.append(pd.DataFrame(known | drawn))
    write_table(pd.concat(parts), output, seed=settings.seed, settings=settings)


def times(settings: Settings, *, output: Path) -> None:
    """Run decisions of both circuits in spikes, and subtract the times of each theory."""
    parts = []
    for name in CIRCUITS:
        table = load_circuit(name, CHANNELS)
        model = BasalGanglia(table, Ensemble(rates=False), GAIN, settings.seed)
        found = designed_circuit(model, trials=settings.circuit_trials // SHARE)
        parts.append(found.assign(model=name))
    write_table(pd.concat(parts), output, seed=settings.seed, settings=settings)


def draw(settings: Settings, traced: Path, decided: Path, *, output: Path) -> Figure:
    """Draw OUT and -ln P for each design, and observed minus theory."""
    curves, table = read_table(traced), read_table(decided)
    every = designs(CHANNELS)
    figure = plt.figure(figsize=(7.6, 4.9))
    grids = figure.add_gridspec(2, 1, height_ratios=[1, 1.25])
    row: Any = grids[0].subgridspec(1, len(every)).subplots(sharex=True, sharey=True)
    for ax, design in zip(row, every, strict=True):
        named = (design.name, design.held)
        _traces(ax, *(where(t, design=named[0], held=named[1]) for t in (curves, table)))
        ax.set_title("\n".join(named).replace(", ", ",\n"), fontweight="normal", loc="center")
    row[0].set(ylabel="OUT of the leader (nats)", xlim=(0, 1.9), ylim=(0, 1.7))
    row[2].set_xlabel("time from the onset of evidence (s)")
    letter(row[0], "a  ")
    pair: Any = grids[1].subgridspec(1, 2).subplots(sharex=True, sharey=True)
    for ax, name in zip(pair, CIRCUITS, strict=True):
        _differences(ax, table[table["model"] == name])
    letter(pair[0], "b  macaque, spikes")
    letter(pair[1], "c  spiking_msprt, spikes")
    key(figure, row[0], pair[0], ncols=5)
    return figure


def _traces(ax: Axes, curves: pd.DataFrame, table: pd.DataFrame) -> None:
    for name, rows in curves.groupby("model", sort=False):
        style: dict[str, Any] = {"color": CIRCUITS.get(str(name), "k"), "lw": 1.0}
        style |= {"ls": "--", "zorder": 3} if name == MINUS_LN_P else {}
        label = name if name == MINUS_LN_P else f"OUT, {name}"
        ax.plot(rows["time_ms"] / 1000, rows["out_nats"], label=label, **style)
    for level in THRESHOLDS:
        ax.axhline(level, color="0.85", lw=0.6, zorder=0)
    at = where(table, threshold=SHOWN, model=next(iter(CIRCUITS)))
    for theory, colour in THEORIES.items():
        when = where(at, theory=theory)["theory_ms"] / 1000
        ax.plot(when, [SHOWN], "v", color=colour, ms=5, zorder=4)


def _differences(ax: Axes, table: pd.DataFrame) -> None:
    """Show one row per design, one colour per theory and one mark per threshold."""
    rows = table[table["held"] != ""]
    names = rows.drop_duplicates(["design", "held"])[["design", "held"]]
    places = {tuple(each): -i for i, each in enumerate(names.itertuples(index=False, name=None))}
    ax.axvspan(-CLOSE_MS, CLOSE_MS, color="0.92", lw=0, zorder=0)
    for side in (-APART_MS, APART_MS):
        ax.axvline(side, color="0.6", lw=0.6, ls=":", zorder=0)
    for theory, colour in THEORIES.items():
        for i, (level, mark) in enumerate(MARKS.items()):
            part = where(rows, theory=theory, threshold=level)
            held = zip(part["design"], part["held"], strict=True)
            y = [places[each] + 0.22 * (1 - i) for each in held]
            bars(ax, y, part, across=True, fmt=mark, ms=3, lw=0.8, color=colour)
        ax.plot([], [], "v", color=colour, ms=5, label=theory)
    for level, mark in MARKS.items():
        ax.plot([], [], mark, color="0.4", ms=3, label=f"at OUT {level:g}")
    ax.set_yticks(list(places.values()), [f"{a},\n{b}" for a, b in places])
    ax.set(xlabel="circuit minus theory (ms)", ylim=(-len(places) + 0.5, 0.5))


if __name__ == "__main__":
    run(traces=traces, times=times, draw=draw)
