"""Figure C4: effects of cell numbers, noise and every number of the table on the circuit."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bgmodel import stream
from bgmodel.comparison.edited import compare_edits
from bgmodel.comparison.matched import matched_measures
from bgmodel.comparison.thresholds import MSPRT_AT_GAIN, msprt_tradeoffs
from bgmodel.evidence import Evidence
from bgmodel.integrators.at_thresholds import (
    CIRCUIT,
    DECODER,
    decide_at_thresholds,
    thresholds_about,
)
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.integrators.steady import out_shift, steady_out
from bgmodel.simulated_evidence import gaussian_evidence
from bgmodel.support.files import read_table, write_table
from circuits.anatomy import DEFAULT, load_circuit
from circuits.circuit import Circuit
from circuits.engines import Populations, Spikes
from circuits.laws.controls import correlated, linear_stn, perturbed, shuffled_stn
from circuits.laws.fluctuation import out_variance
from figures.common import BRIEF_MS, Settings, bars, key, letter, where

SIZES = (0.1, 0.3, 1.0, 3.0)
"""Cells of every population, over the table's."""
SDS = (0.003, 0.01, 0.03, 0.1)
"""Ticks of the axis of noise, nats."""
AT, HIGHEST = 0.95, 0.96
AT_ACCURACY: dict[str, Any] = {"accuracies": (AT,), "highest": HIGHEST}
"""Accuracy at which edited circuits are compared."""
SHOWN = 14
SPAN_MS = 50.0
# OUT at which shifts due to changes are evaluated: near the thresholds.
OUTS = (0.15, 0.3, 0.6)
# A posterior of 0.85 in the circuit's nats, at which the noise of OUT is measured.
ODDS = float(np.log(0.85 / 0.15))


def gaussian(settings: Settings, name: str, trials: int, count: int, d_prime: float) -> Evidence:
    """Return Gaussian evidence, readings every 50 ms."""
    rng, most = stream(settings.seed, "figC4", name), round(25 / d_prime**2)
    return gaussian_evidence(trials, d_prime=d_prime, channels=count, t_max=most, seed=rng)


def neurons(settings: Settings, *, output: Path) -> None:
    """Compare circuits of few and many cells; measure the noise of their OUT."""
    evidence = gaussian(settings, "neurons", 2 * settings.varied_trials, 2, settings.d_prime)
    gain = gain_of(load_circuit(DEFAULT))
    test = msprt_tradeoffs(evidence, gain)[MSPRT_AT_GAIN]
    parts = []
    for size in (one for one in SIZES if one <= settings.most_cells):
        table = load_circuit(DEFAULT).with_neurons_times(size)
        model = BasalGanglia(table, "spikes", gain, settings.seed)
        for name, swept in decide_at_thresholds(
            model, evidence, thresholds_about(test, HIGHEST)
        ).items():
            rng = stream(settings.seed, "bootstrap")
            measured = matched_measures(
                test, swept, rng=rng, truth=evidence.truth, accuracies=(AT,)
            )
            parts.append(measured.assign(model=name, size=size))
        steady = steady_out(table, [ODDS], seed=settings.seed, trials=60, mean_ms=int(SPAN_MS))
        whose = out_variance(table, [ODDS / 2, -ODDS / 2], mean_ms=SPAN_MS)
        law = np.sqrt(sum(part[0] for part in whose.values()))
        row = {"measure": "sd_nats", "value": steady.std(ddof=1), "exact": law, "size": size}
        parts.append(pd.DataFrame([row]))
    write_table(pd.concat(parts), output, seed=settings.seed, settings=settings)


def wiring(settings: Settings, *, output: Path) -> None:
    """Compare circuits with other noise or without a component, with populations, N = 4."""
    evidence = gaussian(settings, "wiring", settings.varied_trials, 4, 1.0)
    table = load_circuit(DEFAULT, 4)
    edited = {
        "Poisson cortex": table.with_cell("ctx", cv=1.0),
        "cells alike": table.with_heterogeneity(0.0),
        "shared noise 0.05 nats": correlated(table, 0.05),
        "shared noise 0.1 nats": correlated(table, 0.1),
        "GPe at its rest": table.clamp("GPe"),
        "linear STN": linear_stn(table),
        "STN-SNr shuffled": shuffled_stn(table),
    }
    model = BasalGanglia(table, Populations(settle_ms=BRIEF_MS), gain_of(table), settings.seed)
    compared = compare_edits(model, edited, evidence, seed=settings.seed, **AT_ACCURACY)
    write_table(compared, output, seed=settings.seed, settings=settings)


def numbers(settings: Settings, *, output: Path) -> None:
    """Change the numbers of the table that move its fixed point most by 20 %, N = 2.

    With populations and noise; the most effective ones also in spikes.
    """
    evidence = gaussian(settings, "numbers", settings.varied_trials, 2, 1.0)
    table = load_circuit(DEFAULT)
    every = perturbed(table)
    moved = [np.abs(out_shift(table, edit, OUTS, laws="cells")).max() for edit in every.values()]
    names = np.array(list(every))[np.argsort(moved)[::-1][: settings.varied]]
    edits = {name: every[name] for name in names}
    in_spikes = names[: settings.varied_in_spikes]
    compared = with_edits(table, edits, in_spikes, evidence, settings.seed, resamples=200)
    compared.insert(len(compared.columns) - 1, "of", len(every))
    write_table(compared, output, seed=settings.seed, settings=settings)


def with_edits(
    table: Circuit,
    edits: Mapping[str, Circuit],
    in_spikes: Iterable[str],
    evidence: Evidence,
    seed: int,
    **more: Any,
) -> pd.DataFrame:
    """Compare edited circuits with populations and noise, and some also in spikes."""
    parts = []
    for kind, names in ((Populations, edits), (Spikes, in_spikes)):
        engine = kind(settle_ms=BRIEF_MS)
        model = BasalGanglia(table, engine, gain_of(table), seed)
        some = {name: edits[name] for name in names}
        compared = compare_edits(model, some, evidence, seed=seed, **AT_ACCURACY, **more)
        parts.append(compared.assign(engine=engine.id))
    return pd.concat(parts)


def draw(settings: Settings, *data: Path, output: Path) -> Figure:
    """Draw noise and correlation against cells, edits of wiring, and the numbers that matter."""
    cells, wired, varied = (read_table(path) for path in data)
    figure = plt.figure(figsize=(7.6, 5.0))
    grid = figure.add_gridspec(2, 3, width_ratios=[1.3, 1, 1])
    _noise(figure.add_subplot(grid[0, 0]), cells)
    _correlation(figure.add_subplot(grid[1, 0]), cells)
    _edits(figure.add_subplot(grid[:, 1]), wired)
    right = figure.add_subplot(grid[:, 2])
    _numbers(right, varied)
    key(figure, right, loc="outside lower right", ncols=2)
    return figure


def _noise(ax: Axes, table: pd.DataFrame) -> None:
    rows = table[table["measure"] == "sd_nats"]
    n, sd, law = (rows[name].to_numpy(float) for name in ("size", "value", "exact"))
    ax.loglog(n, sd, "o", ms=4, label="measured")
    each = float(law[-1] * np.sqrt(n[-1]))
    ax.loglog(n, law, color="k", lw=0.8, label=f"linear theory, {each:.3f}/√n")
    ax.set(xlabel="cells n, relative to the table", ylabel="SD of OUT (nats)")
    ax.set_yticks(SDS, [f"{each:g}" for each in SDS])
    ax.set_yticks([], minor=True)
    ax.set(ylim=(sd.min() / 4, sd.max() * 1.5))
    _size_ticks(ax)
    ax.legend(loc="lower left")
    letter(ax, "a  noise of OUT, N = 2")


def _correlation(ax: Axes, table: pd.DataFrame) -> None:
    rows = where(table, measure="pearson_r", accuracy=AT)
    styles: dict[str, dict[str, Any]] = {
        CIRCUIT: {"fmt": "o-"},
        DECODER: {"fmt": "o--", "mfc": "w"},
    }
    for name, style in styles.items():
        here = where(rows, model=name)
        bars(ax, here["size"], here, ms=4, lw=0.8, label=name, **style)
    ax.set(
        xscale="log",
        xlabel="cells n, relative to the table",
        ylabel=f"r of times, at accuracy {AT}",
    )
    ax.set(ylim=(0.3, 1.02))
    _size_ticks(ax)
    ax.legend(loc="lower left", handlelength=1.2, fontsize="small")
    letter(ax, "b  agreement, N = 2")


def _size_ticks(ax: Axes) -> None:
    ax.set(xlim=(0.7 * SIZES[0], SIZES[-1] / 0.7))
    ax.set_xticks(SIZES, [f"{size:g}" for size in SIZES])
    ax.set_xticks([], minor=True)


def _edits(ax: Axes, table: pd.DataFrame) -> None:
    rows = where(table, kind="value", measure="within_50_ms")
    places = np.arange(len(rows))[::-1]
    bars(ax, places, rows, across=True, fmt="o", ms=4, lw=0.8)
    ax.axvline(rows["value"].iloc[0], color="0.8", lw=0.8, zorder=0, label="intact")
    ax.legend(loc="lower left", bbox_to_anchor=(0, 0.1))
    for place in places[rows["value"].isna().to_numpy()]:
        ax.text(0.02, place, "not reached", va="center")
    ax.set_yticks(places, rows["variant"])
    ax.set(xlabel=f"share within 50 ms of\nthe MSPRT's, accuracy {AT}")
    ax.set(xlim=(0, 1), ylim=(-0.6, len(rows) - 0.4))
    letter(ax, "c  edits, N = 4")


def _numbers(ax: Axes, table: pd.DataFrame) -> None:
    """Show the numbers that affect accuracy most, and their residual effect after retuning."""
    by = table.set_index("variant")
    kept = where(by, kind="fixed", measure="expected_accuracy")
    in_spikes, fixed = (where(kept, engine=name)["value"] for name in ("spikes", "population"))
    tuned = where(by, engine="population", kind="change", measure="pearson_r")
    moved = (fixed - fixed["intact"]).drop("intact")
    worst = moved.abs().sort_values(ascending=False).index[:SHOWN]
    places = np.arange(len(worst))[::-1]
    ax.plot(moved[worst], places, "s", ms=4, color="C1", label="change of accuracy, threshold kept")
    known = [k for k, name in enumerate(worst) if name in in_spikes.index]
    spiking = in_spikes[worst[known]] - in_spikes["intact"]
    ax.plot(spiking, places[known], "x", ms=5, color="k", label="the same, in spikes")
    here, label = tuned.loc[worst], "change of r of times, threshold retuned"
    bars(ax, places - 0.25, here, across=True, fmt="o", ms=3, lw=0.8, label=label)
    for place in places[here["value"].isna().to_numpy()]:
        ax.text(-0.01, place - 0.18, "not reached", ha="right", va="top", fontsize="small")
    ax.axvline(0, color="0.8", lw=0.8, zorder=0)
    ax.set_yticks(places, worst)
    ax.set(xlabel=f"change\n({len(worst)} of {table['of'].iloc[0]} changes)")
    letter(ax, "d  numbers, N = 2")
