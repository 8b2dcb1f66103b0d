"""Figure C1: the spiking circuit and its two nonlinearities: STN's exponential, GPe's response.

STN's exponential is part of the table; the figure tests whether its cells follow it. GPe transforms
STN's sum Sigma nonlinearly, so that the input of SNr from both follows S, the log-sum-exp of the
cortical activity, when all channels rise or fall together.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.figure import Figure

from bgmodel.support.files import read_table, write_table
from circuits.anatomy import DEFAULT, load_circuit
from circuits.circuit import Circuit
from circuits.drawing import draw as draw_circuit
from circuits.dynamics.fixed_point import resting_hz
from circuits.engines import Algebra, Engine, Ensemble
from figures.common import Settings, letter, run

CIRCUIT = load_circuit(DEFAULT)
STN, GPE, SNR = (CIRCUIT.population(name) for name in ("STN", "GPe", "SNr"))
STN_NATS = np.linspace(-3.5, 3.2, 17)
SIGMA_AT_REST = CIRCUIT.channels * (resting_hz(CIRCUIT)["STN"] / STN.gain_hz_per_nat)
COMMON_NATS = np.linspace(-1.5, 3.5, 11)
"""Drives common to all channels."""
CELLS, HELD_S = 2000, 4


def compute(settings: Settings, *, output: Path) -> None:
    """Clamp the input of STN cells, drive all channels equally, and count spikes."""
    stn = clamped("STN", STN_NATS, settings).assign(law_hz=_stn_hz(STN_NATS), what="alone")
    table = pd.concat([stn, driven_alike(Ensemble(), settings), driven_alike(Algebra(), settings)])
    write_table(table, output, seed=settings.seed, settings=settings)


def driven_alike(engine: Engine, settings: Settings) -> pd.DataFrame:
    """Return the responses of GPe and SNr to Sigma when all channels are driven equally.

    GPe_ctx, which would cancel the drive, and D2, which D1 compensates, are held at their resting
    rates.

    Returns
    -------
    DataFrame
        Columns what (the engine), s_nats, sigma_nats, gpe_nats, heard_nats (SNr's input from STN
        and GPe), all above rest except Sigma, and their standard errors over trials.
    """
    held = CIRCUIT.clamp("GPe_ctx").clamp("D2")
    drive = np.repeat(COMMON_NATS[:, None, None], HELD_S, axis=1) * np.ones(CIRCUIT.channels)
    trials = settings.repeats if engine.noisy else 1
    done = engine.run(held, np.repeat(drive, trials, 0), step_ms=1000.0, seed=settings.seed)
    late = slice(1000, None) if engine.timed else slice(None)

    def mean(name: str) -> npt.NDArray[np.float64]:
        values = done.decoded_nats(name)[:, late].mean(axis=1)
        return np.asarray(values.reshape(len(drive), trials, -1), dtype=np.float64)

    sigma, gpe, cortex = mean("STN").sum(axis=2), mean("GPe").mean(axis=2), mean("ctx").mean(axis=2)
    onto_stn, onto_snr = (
        CIRCUIT.projection(*ends).weight for ends in (("ctx", "STN"), ("GPe", "SNr"))
    )
    columns = {
        "s_nats": onto_stn * (cortex - CIRCUIT.rest_drive),
        "sigma_nats": sigma,
        "gpe_nats": gpe,
        "heard_nats": sigma - SIGMA_AT_REST + onto_snr * gpe,
    }
    found = {name: values.mean(axis=1) for name, values in columns.items()}
    root = np.sqrt(trials)
    errors = {f"{name}_se": values.std(axis=1) / root for name, values in columns.items()}
    return pd.DataFrame(found | errors).assign(nucleus="GPe", what=engine.id)


def clamped(name: str, input_nats: npt.NDArray[np.float64], settings: Settings) -> pd.DataFrame:
    """Return the rate of a nucleus' isolated cells at each of several constant inputs.

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
    done = Ensemble(sample_ms=1000).run(alone, drive, step_ms=1000, seed=settings.seed)
    # The clamp starts in the first second, which is left out.
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
    """Draw the table's circuit, and each nonlinearity above the deviations of the cells."""
    table = read_table(data)
    figure = plt.figure(figsize=(7.2, 2.9))
    grid = figure.add_gridspec(2, 3, height_ratios=[3, 1], width_ratios=[1.5, 1, 1])
    letter(_circuit(figure.add_subplot(grid[:, 0])), "a  circuit of the table")
    laws = (
        (1, "STN", _stn, "b  STN cells alone"),
        (2, "GPe", _gpe, "c  all channels alike"),
    )
    for column, name, panel, title in laws:
        above = figure.add_subplot(grid[0, column])
        below = figure.add_subplot(grid[1, column], sharex=above if name == "STN" else None)
        above.tick_params(labelbottom=name != "STN")
        panel(above, below, table[table["nucleus"] == name])
        letter(above, title)
    return figure


def _circuit(ax: Any) -> Any:
    draw_circuit(CIRCUIT, ax)
    for text in ax.texts:  # boxes are smaller here than in a figure of their own
        text.set_fontsize(4.8)
    return ax


def _stn_hz(nats: npt.ArrayLike) -> npt.NDArray[np.float64]:
    return STN.baseline_hz + STN.gain_hz_per_nat * np.exp(nats)


def _stn(ax: Any, below: Any, table: pd.DataFrame) -> None:
    x, found, law = (table[name] for name in ("input_nats", "rate_hz", "law_hz"))
    ax.plot(x, law, color="0.6", lw=1, label=f"{STN.gain_hz_per_nat:g} Hz · exp(input)")
    ax.plot(x, found, "o", ms=3, mfc="none", color="C1", label="STN cells, counted")
    ax.set(yscale="log", ylabel="rate (Hz)", ylim=(0.4, 8 * found.max()))  # room for the legend
    ax.legend(loc="upper left")
    off = 100 * (found / law - 1)
    below.axhline(0, color="0.6", lw=1)
    below.errorbar(x, off, yerr=100 * table["error_hz"] / law, fmt="o", ms=2, lw=0.8, color="C1")
    ax.text(
        0.98, 0.04, f"largest deviation {off.abs().max():.1f} %\nover {np.ptp(x):.1f} nats",
        transform=ax.transAxes, ha="right", fontsize=7,
    )  # fmt: skip
    below.set(xlabel="input (nats)", ylabel="error (%)")


def _gpe(ax: Any, below: Any, table: pd.DataFrame) -> None:
    counted, exact = (table[table["what"] == name] for name in ("ensemble", "algebra"))
    sigma = np.linspace(counted["sigma_nats"].min(), counted["sigma_nats"].max(), 100)
    law = sigma - np.log(sigma) - (SIGMA_AT_REST - np.log(SIGMA_AT_REST))
    tangent = (1 - 1 / SIGMA_AT_REST) * (sigma - SIGMA_AT_REST)
    ax.plot(sigma, tangent, color="C0", lw=1, ls="--", label="straight line")
    ax.plot(sigma, law, color="0.6", lw=1, label="Σ − ln Σ, 0 at rest")
    ax.plot(
        counted["sigma_nats"], counted["gpe_nats"], "o", ms=3, mfc="none", color="C1",
        label="GPe, counted",
    )  # fmt: skip
    ax.set(xlabel="Σ, output of STN (nats)", ylabel="GPe activity (nats)")
    ax.legend(loc="upper left")
    below.axhline(0, color="0.6", lw=1)
    below.plot(exact["s_nats"], exact["heard_nats"] - exact["s_nats"], color="C1", lw=1)
    below.errorbar(
        counted["s_nats"], counted["heard_nats"] - counted["s_nats"], counted["heard_nats_se"],
        fmt="o", ms=2, lw=0.8, color="C1",
    )  # fmt: skip
    below.set(xlabel="S above rest (nats)", ylabel="input of\nSNr − S")


if __name__ == "__main__":
    run(compute=compute, draw=draw)
