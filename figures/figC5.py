"""Figure C5: effects of lesions on the circuit's fixed point and on its decisions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bgmodel import stream
from bgmodel.integrators.steady import lesions, steady_shifts
from bgmodel.simulated_evidence import gaussian_evidence
from bgmodel.support.files import read_table, write_table
from circuits.anatomy import DEFAULT, load_circuit
from figures.common import Settings, bars, key, letter, run, where
from figures.figC4 import with_edits

CHANNELS = 4
LOG_ODDS = (1.75, 2.25, 2.75)


def steady(settings: Settings, *, output: Path) -> None:
    """Measure the shift of OUT due to lesions under constant evidence."""
    table = load_circuit(DEFAULT, CHANNELS)
    given = {"seed": settings.seed, "trials": settings.lesioned_trials}
    found = steady_shifts(table, lesions(table), LOG_ODDS, **given)
    write_table(found, output, seed=settings.seed, settings=settings)


def behaviour(settings: Settings, *, output: Path) -> None:
    """Run lesioned circuits with populations and some in spikes, thresholds kept or retuned."""
    table = load_circuit(DEFAULT, CHANNELS)
    rng = stream(settings.seed, "figC5")
    evidence = gaussian_evidence(settings.varied_trials, d_prime=1.0, channels=CHANNELS, seed=rng)
    every = lesions(table)
    in_spikes = list(every)[:: settings.spiking_every]
    found = with_edits(table, every, in_spikes, evidence, settings.seed)
    write_table(found, output, seed=settings.seed, settings=settings)


def draw(settings: Settings, shifts: Path, decided: Path, *, output: Path) -> Figure:
    """Draw measured against closed-form shifts, and behaviour before and after."""
    table, both = read_table(shifts), read_table(decided)
    lesioned, spiking = (where(both, engine=name) for name in ("population", "ensemble"))
    figure, axes = plt.subplots(1, 4, figsize=(7.2, 3.4), width_ratios=[1.6, 0.9, 0.9, 0.9])
    _shifts(axes[0], table)
    names = list(where(lesioned, kind="fixed")["variant"].unique())
    places = {name: -i for i, name in enumerate(names)}
    for ax, measure, label in (
        (axes[1], "expected_accuracy", "accuracy"),
        (axes[2], "mean_ms", "mean time (s)"),
    ):
        values, in_spikes = (_fixed(rows, measure) for rows in (lesioned, spiking))
        ax.axvline(values["intact"], color="0.8", lw=0.8, zorder=0)
        ax.plot([], [], "o", ms=4, color="0.4", label="populations")
        colours: Any = [_colour(name) for name in names]
        ax.scatter(values[names], [places[name] for name in names], c=colours, s=14)
        ax.plot(in_spikes, [places[name] for name in in_spikes.index], "kx", ms=4, label="spikes")
        ax.set(xlabel=label)
    axes[2].plot([], [], color="0.8", lw=0.8, label="intact")
    key(figure, axes[2], loc="outside lower right", ncols=3)
    key(figure, axes[0], loc="outside lower left", ncols=3, columnspacing=1)
    _tuned(axes[3], lesioned, places)
    tuned = where(spiking, kind="value", measure="within_50_ms")
    axes[3].plot(tuned["value"], [places[name] for name in tuned["variant"]], "kx", ms=4)
    for ax in axes[1:]:
        ax.set(ylim=(-len(names) + 0.4, 0.6))
        ax.set_yticks(list(places.values()), names if ax is axes[1] else [])
    letter(axes[1], "b  threshold kept (a prediction)")
    letter(axes[3], "c  retuned")
    return figure


def _fixed(table: pd.DataFrame, measure: str) -> pd.Series:
    """Return a measure of each circuit with its threshold kept; times in s."""
    values = where(table, kind="fixed", measure=measure).set_index("variant")["value"]
    return values / 1000 if measure == "mean_ms" else values


def _colour(name: str) -> str:
    kinds = {"STN": "C0", "GPe": "C1", "D1": "C2", "D2": "C3", "hyperdirect": "C4"}
    return kinds.get(name.replace(",", "").split(" ")[0], "k")


def _shifts(ax: Axes, table: pd.DataFrame) -> None:
    seen = set()
    for name, rows in table.groupby("variant", sort=False):
        colour = _colour(str(name))
        label = None if colour in seen else str(name).replace(",", "").split(" ")[0]
        seen.add(colour)
        style: dict[str, Any] = {"fmt": "o", "ms": 3, "lw": 0.8, "color": colour, "label": label}
        bars(ax, rows["finite_nats"], rows, **style)
        ax.plot(rows["exact_nats"], rows["value"], "o", c=colour, mfc="w", ms=3, mew=0.5, zorder=1)
    ax.plot([], [], "o", c="0.4", mfc="w", ms=3, mew=0.5, label="fixed point of the table's lines")
    ends = [table["value"].min() - 0.02, table["value"].max() + 0.02]
    ax.plot(ends, ends, color="0.7", lw=0.8, zorder=0, label="equality")
    ax.set(xlabel="fixed point, finite size (nats)", ylabel="change of OUT, spikes (nats)")
    letter(ax, "a  shift of OUT")


def _tuned(ax: Axes, table: pd.DataFrame, places: dict[str, int]) -> None:
    rows = where(table, kind="value", measure="within_50_ms")
    at = [places[name] for name in rows["variant"]]
    colours: Any = [_colour(name) for name in rows["variant"]]
    bars(ax, at, rows, across=True, fmt="none", lw=0.8, ecolor=colours)
    ax.scatter(rows["value"], at, c=colours, s=14)
    ax.axvline(rows["value"].iloc[0], color="0.8", lw=0.8, zorder=0)
    ax.set(xlabel="share within 50 ms\nof the MSPRT's")


if __name__ == "__main__":
    run(steady=steady, behaviour=behaviour, draw=draw)
