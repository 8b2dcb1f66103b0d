"""Figure D5: low dopamine strengthens the STN-GPe loop: spectra in spikes and in closed form.

Dopamine acts at the terminals of STN in GPe and of GPe in STN: the less dopamine, the stronger both
pathways. Spectra of spikes are compared with the linear theory of noise about the fixed point, none
of whose parameters were fitted to them. Dopamine-depleted monkeys oscillate more slowly, at 8-15
Hz; the figure also shows how much slower the loop would have to be for that.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from scipy.signal import welch

from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.learning.dopamine import THRESHOLD_NATS, stopping_posterior, working_range
from bgmodel.support.files import read_table, write_table
from circuits.activity import Activity
from circuits.anatomy import DEFAULT, load_circuit
from circuits.circuit import Circuit
from circuits.engines import Ensemble
from circuits.laws.spectra import rate_spectrum
from circuits.laws.stability import roots
from figures.common import BRIEF_MS, Settings, bars, letter, run, where

NUCLEI, MSN = ("STN", "GPe"), ("D1", "D2")
LEVELS = (1.2, 1.0, 0.85, 0.7, 0.5)
COLOUR = dict(zip(LEVELS, ("C5", "k", "C2", "C4", "C1"), strict=True))
DRIVES = {"rest": (0.0, 0.0), "evidence": (1.0, -1.0)}
"""Steady evidence, nats."""
BEGIN_MS, SECONDS = 1000.0, 4
BAND_HZ = (13.0, 30.0)
PARKINSONIAN_HZ = (8.0, 15.0)
"""Oscillations of GPe, GPi and STN in dopamine-depleted monkeys; Nambu & Tachibana 2014."""
FOUND_HZ = np.arange(4.0, 60.5, 0.5)
LINE = np.round(np.arange(0.45, 1.26, 0.05), 2)
"""Dopamine levels of the closed-form curves."""
LOW = 0.5
"""The level at which the frequency is examined."""
FACTORS = np.round(np.arange(0.8, 2.41, 0.1), 1)
SLOWED = {"both": (1, 1), "delays": (1, 0), "time constants": (0, 1)}
"""Quantities multiplied by the factor."""


def compute(settings: Settings, *, output: Path) -> None:
    """Count spikes at each level, at rest and under evidence; add the closed forms."""
    table = load_circuit(DEFAULT)
    parts = [closed(table), frequencies(table.dopamine(LOW))]
    for level in LEVELS:
        for name, drive in DRIVES.items():
            engine = Ensemble(settle_ms=BRIEF_MS)
            model = BasalGanglia(table.dopamine(level), engine, seed=settings.seed)
            held = np.broadcast_to(drive, (settings.dopamine_trials, SECONDS + 1, len(drive)))
            counted = measured(model.run_drive(held, step_ms=1000.0))
            parts.append(pd.DataFrame(counted).assign(level=level, drive=name, by="spikes"))
    write_table(pd.concat(parts), output, seed=settings.seed, settings=settings)


def measured(activity: Activity) -> Iterator[dict[str, object]]:
    """Yield means over trials with 95 % intervals: spectra, power in the band, rates of MSN.

    Rates are those of channel 0, which the evidence favours, and of the others.
    """
    late = activity.time_ms > BEGIN_MS
    for name in NUCLEI:
        mean_hz = np.asarray(activity.rates_hz[name], np.float64)[:, late].mean(axis=2)
        frequency, power = welch(mean_hz, fs=1000.0, nperseg=1000, axis=1)
        seen = (frequency >= FOUND_HZ[0]) & (frequency <= FOUND_HZ[-1])
        for hz, each in zip(frequency[seen], power[:, seen].T, strict=True):
            yield {"measure": "power", "nucleus": name, "at": hz, **_interval(each)}
        yield {"measure": "band", "nucleus": name, **_interval(band(frequency, power))}
    for name in MSN:
        each = np.asarray(activity.rates_hz[name], np.float64)[:, late].mean(axis=1)
        yield {"measure": "rate", "nucleus": f"{name} leader", **_interval(each[:, 0])}
        others = _interval(each[:, 1:].mean(axis=1))
        yield {"measure": "rate", "nucleus": f"{name} competitor", **others}


def _interval(each: np.ndarray) -> dict[str, float]:
    off = 1.96 * each.std(ddof=1) / np.sqrt(len(each))
    return {"value": each.mean(), "low": each.mean() - off, "high": each.mean() + off}


def band(frequency: np.ndarray, power: np.ndarray) -> np.ndarray:
    """Return the power in ``BAND_HZ`` along the last axis, Hz^2."""
    inside = (frequency >= BAND_HZ[0]) & (frequency <= BAND_HZ[1])
    return np.asarray(np.trapezoid(power[..., inside], frequency[inside], axis=-1))


def closed(table: Circuit) -> pd.DataFrame:
    """Return spectra, power in the band, the loop's decay and the criterion of the closed forms."""
    low, high = working_range(table, THRESHOLD_NATS)
    rows: list[tuple[object, ...]] = []
    for level in sorted({*LEVELS, *LINE.tolist()}):
        edited = table.dopamine(level)
        for name in NUCLEI:
            for of, drive in DRIVES.items():
                power = rate_spectrum(edited, name, FOUND_HZ, drive)
                rows.append(("band", name, np.nan, float(band(FOUND_HZ, power)), level, of))
                rows += [
                    ("power", name, *pair, level, of) for pair in zip(FOUND_HZ, power, strict=True)
                ]
        inside, gain = low < level < high, gain_of(table)
        posterior = stopping_posterior(table, level, THRESHOLD_NATS, gain) if inside else np.nan
        rows.append(("stopping_posterior", "", low, posterior, level, ""))
        root = turning(edited)
        rows.append(("growth", "", root.imag, root.real, level, ""))
    names = ["measure", "nucleus", "at", "value", "level", "drive"]
    return pd.DataFrame(rows, columns=names).assign(by="closed form")


def turning(table: Circuit) -> complex:
    """Return growth (1/s, negative for decay) and frequency (Hz) of the slowest root above 5 Hz."""
    root = next(root for root in roots(table) if root.imag > 2 * np.pi * 5)
    return complex(root.real, root.imag / (2 * np.pi))


def slowed(table: Circuit, delays: float, taus: float) -> Circuit:
    """Return the circuit with delays and time constants of STN->GPe and GPe->STN multiplied."""
    for pair in (NUCLEI, NUCLEI[::-1]):
        row = table.projection(*pair)
        table = table.with_projection(
            *pair, delay_ms=delays * row.delay_ms, tau_ms=taus * row.tau_ms
        )
    return table


def frequencies(table: Circuit) -> pd.DataFrame:
    """Return the peak frequency of STN's power for each factor."""
    fine = np.arange(4.0, 40.0, 0.1)
    rows = []
    for name, (of_delays, of_taus) in SLOWED.items():
        for factor in FACTORS:
            edited = slowed(table, factor if of_delays else 1.0, factor if of_taus else 1.0)
            peak = fine[rate_spectrum(edited, "STN", fine).argmax()]
            rows.append({"measure": "peak", "nucleus": name, "at": factor, "value": peak})
    return pd.DataFrame(rows).assign(level=LOW, by="closed form")


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw spectra, power and MSN rates at each level, and the determinants of the frequency."""
    table = read_table(data)
    figure, axes = plt.subplots(2, 3, figsize=(7.4, 4.8))
    for ax, nucleus in zip(axes[0], NUCLEI, strict=False):
        _spectra(ax, where(table, nucleus=nucleus, measure="power", drive="rest"))
    letter(axes[0, 0], "a  STN at rest")
    letter(axes[0, 1], "b  GPe at rest")
    lowest = float(where(table, measure="stopping_posterior")["at"].iloc[0])
    _power(axes[0, 2], where(table, measure="band"))
    _striatum(axes[1, 0], where(table, measure="rate"))
    for ax in (axes[0, 2], axes[1, 0]):
        ax.axvspan(0.45, lowest, color="0.92", lw=0, zorder=0)
        ax.set(xlabel="dopamine (1: normal)", xlim=(0.45, 1.25))
    _frequency(axes[1, 1], where(table, measure="peak"))
    axes[1, 2].axis("off")
    title = "dopamine: fixed point's\nposterior, decay of the loop"
    box = axes[1, 2].legend(handles=_key(table), loc="center left", title=title, alignment="left")
    box.set_in_layout(False)
    return figure


def _spectra(ax: Axes, rows: pd.DataFrame) -> None:
    ax.axvspan(*PARKINSONIAN_HZ, color="0.88", lw=0, zorder=0)
    for level, colour in COLOUR.items():
        theory, spikes = (where(rows, level=level, by=by) for by in ("closed form", "spikes"))
        ax.plot(theory["at"], theory["value"], lw=1, color=colour)
        ax.fill_between(spikes["at"], spikes["low"], spikes["high"], color=colour, alpha=0.25, lw=0)
        ax.plot(spikes["at"], spikes["value"], ".", ms=2.5, color=colour)
    ax.set(xscale="log", yscale="log", xlabel="frequency (Hz)", ylabel="power (Hz$^2$/Hz)")
    ax.set_xticks([5, 10, 20, 40], ["5", "10", "20", "40"])
    ax.minorticks_off()


def _power(ax: Axes, rows: pd.DataFrame) -> None:
    for nucleus, colour in zip(NUCLEI, ("C0", "C3"), strict=True):
        for drive, face, line in (("rest", colour, "-"), ("evidence", "w", ":")):
            of = where(rows, nucleus=nucleus, drive=drive)
            theory, spikes = (where(of, by=by) for by in ("closed form", "spikes"))
            ax.plot(theory["level"], theory["value"], lw=1, ls=line, color=colour)
            style: dict[str, Any] = {"fmt": "o", "ms": 3, "lw": 0.8, "color": colour, "mfc": face}
            bars(ax, spikes["level"], spikes, **style)
        end = theory.iloc[-1]
        ax.text(1.25, 1.25 * end["value"], nucleus, color=colour, ha="right", va="bottom")
    low, high = BAND_HZ
    ax.set(yscale="log", ylabel=f"power of {low:g}-{high:g} Hz (Hz$^2$)")
    ax.set_yticks([2, 5, 10, 20, 50, 100], ["2", "5", "10", "20", "50", "100"])
    ax.minorticks_off()
    letter(ax, "c  power against the level")


def _striatum(ax: Axes, rows: pd.DataFrame) -> None:
    for name, colour in zip(MSN, ("k", "0.55"), strict=True):
        for drive, face in (("rest", colour), ("evidence", "w")):
            spikes = where(rows, nucleus=f"{name} leader", drive=drive).sort_values("level")
            normal = float(where(spikes, level=1)["value"].iloc[0])
            style: dict[str, Any] = {"fmt": "o-", "ms": 3, "lw": 0.8, "color": colour, "mfc": face}
            bars(ax, spikes["level"], spikes, unit=normal, **style)
        first = (LOW, spikes["value"].iloc[0] / normal)
        ax.annotate(name, first, (-4, 6), textcoords="offset points", color=colour)
    ax.axhline(1.3, ls=":", lw=0.8, color="k")
    ax.set(ylabel="rate of MSN (at normal: 1)")
    letter(ax, "d  striatum")


def _frequency(ax: Axes, rows: pd.DataFrame) -> None:
    ax.axhspan(*PARKINSONIAN_HZ, color="0.88", lw=0, zorder=0)
    for k, (name, one) in enumerate(rows.groupby("nucleus", sort=False)):
        ax.plot(one["at"], one["value"], lw=1, color="k", ls=("-", "--", ":")[k], label=name)
    both = where(rows, nucleus="both")
    for hz in (PARKINSONIAN_HZ[1], 12.0):
        factor = float(np.interp(-hz, -both["value"], both["at"]))
        ax.plot(factor, hz, "ko", ms=3)
        below: dict[str, Any] = {"textcoords": "offset points", "ha": "right", "va": "top"}
        ax.annotate(f"x {factor:.2f}", (factor, hz), (-3, -3), fontsize=7, **below)
    ax.axvline(1, lw=0.6, color="0.6")
    ax.set(xlabel="factor on the STN-GPe loop", ylabel=f"peak of STN at {LOW:g} (Hz)")
    ax.set_xlim(0.8, 2.4)
    ax.legend(loc="upper right")
    letter(ax, "e  what sets the frequency")


def _key(table: pd.DataFrame) -> list[Line2D | Patch]:
    """Return the levels with their posteriors at the decision, and the marks."""
    known, growth = (
        table[table["measure"] == name].set_index("level")["value"]
        for name in ("stopping_posterior", "growth")
    )
    handles: list[Line2D | Patch] = []
    for level, colour in COLOUR.items():
        decides = "none" if pd.isna(known[level]) else f"{known[level]:.2f}"
        text = f"{level:g}: {decides}, {-1000 / growth[level]:.0f} ms"
        handles.append(Line2D([], [], color=colour, lw=1, label=text))
    grey: dict[str, Any] = {"color": "0.3", "lw": 0}
    handles += [
        Line2D([], [], color="0.3", lw=1, label="closed form, at rest"),
        Line2D([], [], color="0.3", lw=1, ls=":", label="closed form, under evidence"),
        Line2D([], [], **grey, marker="o", ms=3, label="spikes at rest"),
        Line2D([], [], **grey, marker="o", ms=3, mfc="w", label="spikes under evidence"),
        Patch(color="0.88", lw=0, label="a, b, e: 8-15 Hz, dopamine-\ndepleted monkeys"),
        Patch(color="0.92", lw=0, label="c, d: no decision at\nthe fixed point"),
    ]
    return handles


if __name__ == "__main__":
    run(compute=compute, draw=draw)
