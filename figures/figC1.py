"""Figure C1: the circuit of spiking cells, and its two laws: STN's exponential, GPe's S - ln S.

STN's exponential is written in the table: what is measured is whether its cells keep to it. GPe's
cells integrate and fire: what they make of Sigma is up to their membrane.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.figure import Figure

from bgmodel.files import read_table, write_table
from circuits.anatomy import circuit
from circuits.engines.ensemble import run as ensemble
from circuits.laws.firing import lif_rate_hz
from circuits.show import COLOURS
from circuits.show import draw as draw_circuit
from circuits.spec import Circuit
from figures.common import Settings, letter, run

CIRCUIT = circuit("spiking_msprt")
STN, GPE = CIRCUIT.population("STN"), CIRCUIT.population("GPe")
SIGMA = CIRCUIT.projection("STN", "GPe")
S0 = -GPE.bias_nats / SIGMA.weight
STN_NATS = np.linspace(-3.5, 3.2, 17)
SIGMA_NATS = np.linspace(0.5, 5, 37)
JUDGED_NATS = (2.0, 4.0)
CELLS = 2000


def compute(settings: Settings, *, output: Path) -> None:
    """Clamp the input of STN's and of GPe's cells, D2 at its baseline, and count their spikes."""
    gpe_input = SIGMA.weight * SIGMA_NATS + GPE.bias_nats
    mean_mv = GPE.cell.rest_mv + GPE.cell.mv_per_nat * gpe_input
    table = pd.concat(
        [
            clamped("STN", STN_NATS, settings).assign(law_hz=_stn_hz(STN_NATS)),
            clamped("GPe", gpe_input, settings).assign(
                sigma_nats=SIGMA_NATS, law_hz=lif_rate_hz(GPE.cell, mean_mv)
            ),
        ]
    )
    write_table(table, output, seed=settings.seed, settings=settings)


def clamped(name: str, input_nats: npt.NDArray[np.float64], settings: Settings) -> pd.DataFrame:
    """Return the rate of a nucleus' cells on their own at each of some constant inputs.

    Returns
    -------
    DataFrame
        Columns nucleus, input_nats, rate_hz and error_hz (standard error over repeats of 1 s).
    """
    row = CIRCUIT.with_population(name, neurons=CELLS, bias_nats=0.0).population(name)
    levels = len(input_nats)
    alone = Circuit(
        name, (row,), (), levels, input=name, readout=name, reference_nats=np.log(levels)
    )
    drive = np.broadcast_to(input_nats, (settings.repeats, 2, levels))
    done = ensemble.run(alone, drive, step_ms=1000, sample_ms=1000, seed=settings.seed)
    # The clamp sets in with the first second, which is left out.
    rates = done.rates_hz[name][:, 1].astype(np.float64)
    return pd.DataFrame(
        {
            "nucleus": name,
            "input_nats": input_nats,
            "rate_hz": rates.mean(axis=0),
            "error_hz": rates.std(axis=0) / np.sqrt(len(rates)),
        }
    )


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw the table's circuit, and each law above what the cells make of it."""
    table = read_table(data)
    figure = plt.figure(figsize=(7.2, 2.9))
    grid = figure.add_gridspec(2, 3, height_ratios=[3, 1], width_ratios=[1, 1, 1])
    letter(_circuit(figure.add_subplot(grid[:, 0])), "a  circuit of the table")
    laws = (
        (1, "STN", _stn, "b  STN cells alone"),
        (2, "GPe", _gpe, "c  GPe cells alone"),
    )
    for column, name, panel, title in laws:
        above = figure.add_subplot(grid[0, column])
        below = figure.add_subplot(grid[1, column], sharex=above)
        above.tick_params(labelbottom=False)
        panel(above, below, table[table["nucleus"] == name])
        letter(above, title)
    return figure


def _circuit(ax: Any) -> Any:
    draw_circuit(CIRCUIT, ax)
    for text in ax.texts:
        text.set_fontsize(7)
        arrow = getattr(text, "arrow_patch", None)
        if arrow is not None:
            # Boxes are smaller here than what the drawing leaves room for.
            arrow.shrinkA, arrow.shrinkB = 10, 12
    for colour, name in zip(COLOURS.values(), ("excites", "inhibits"), strict=True):
        ax.plot([], [], color=colour, lw=2, label=name)
    ax.legend(loc="lower right", handlelength=1.2)
    return ax


def _stn_hz(nats: npt.ArrayLike) -> npt.NDArray[np.float64]:
    return STN.baseline_hz + STN.gain_hz_per_nat * np.exp(nats)


def _stn(ax: Any, below: Any, table: pd.DataFrame) -> None:
    x, found, law = (table[name] for name in ("input_nats", "rate_hz", "law_hz"))
    ax.plot(x, law, color="0.6", lw=1, label=f"{STN.gain_hz_per_nat:g} Hz · exp(input)")
    ax.plot(x, found, "o", ms=3, mfc="none", color="C1", label="STN cells, counted")
    ax.set(yscale="log", ylabel="rate (Hz)")
    ax.legend(loc="upper left")
    off = 100 * (found / law - 1)
    below.axhline(0, color="0.6", lw=1)
    below.errorbar(x, off, yerr=100 * table["error_hz"] / law, fmt="o", ms=2, lw=0.8, color="C1")
    ax.text(
        0.98, 0.04, f"largest deviation {off.abs().max():.1f} %\nover {np.ptp(x):.1f} nats",
        transform=ax.transAxes, ha="right", fontsize=7,
    )  # fmt: skip
    below.set(xlabel="input (nats)", ylabel="off (%)")


def _gpe(ax: Any, below: Any, table: pd.DataFrame) -> None:
    sigma = table["sigma_nats"]
    law = sigma - np.log(sigma) - (S0 - np.log(S0))
    curves = {"exact": table["law_hz"], "cells": table["rate_hz"]}
    nats = {k: (hz - GPE.baseline_hz) / GPE.gain_hz_per_nat for k, hz in curves.items()}
    line = table["input_nats"]
    ax.plot(sigma, line, color="C0", lw=1, ls="--", label="line of the table")
    ax.plot(sigma, law, color="0.6", lw=1, label=f"Σ − ln Σ, 0 at s₀ = {S0:.1f}")
    ax.plot(sigma, nats["exact"], color="C1", lw=1, label="GPe cells, theory")
    ax.plot(sigma, nats["cells"], "o", ms=2, mfc="none", color="C1", label="GPe cells, counted")
    judged = sigma.between(*JUDGED_NATS)
    for where in (ax, below):
        where.axvspan(*JUDGED_NATS, color="0.93", lw=0, zorder=0)
    worst = {name: (y - law)[judged].abs().max() for name, y in (nats | {"line": line}).items()}
    ax.text(
        0.98, 0.04,
        f"Σ = 2..4: cells off by {worst['cells']:.2f},\nline by {worst['line']:.2f} nats",
        transform=ax.transAxes, ha="right", fontsize=7,
    )  # fmt: skip
    ax.set(ylabel="GPe activity (nats)", ylim=(-1.9, 3.2))
    ax.legend(loc="upper left")
    below.axhline(0, color="0.6", lw=1)
    below.plot(sigma, line - law, color="C0", lw=1, ls="--")
    below.plot(sigma, nats["exact"] - law, color="C1", lw=1)
    below.plot(sigma, nats["cells"] - law, "o", ms=2, mfc="none", color="C1")
    below.set(xlabel="Σ, what STN delivers (nats)", ylabel="off (nats)")


if __name__ == "__main__":
    run(compute=compute, draw=draw)
