"""Figure A1: rates by choice and strength in three windows, as in recordings of monkey STN.

The windows are those of Branam, Gold & Ding 2024, here for every nucleus of the circuit, with the
population engine, and with spikes for some strengths. Correlations with simple patterns measure
the similarity to their three types of cells.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from bgmodel import first_crossing, stream
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.simulated_evidence import gaussian_evidence
from bgmodel.support.files import read_table, write_table
from circuits.anatomy import DEFAULT, load_circuit
from circuits.dynamics.fixed_point import resting_hz
from circuits.engines import Ensemble, Population
from figures.common import Settings, key, letter, run, where
from figures.windows import PREFERRED, WINDOWS, averaged, finish_rows, likeness, name_patterns

NUCLEI = {"ctx": "ctx (as LIP)", "D1": "D1 (as caudate)", "STN": "STN", "GPe": "GPe", "SNr": "SNr"}
D_PRIMES = (0.125, 0.25, 0.5, 0.75, 1.0)
"""Strengths: d' per reading of 50 ms."""
IN_SPIKES = (0.25, 1.0)
READINGS, STEP_MS, SAMPLE_MS = 40, 50.0, 5.0
POSTERIOR = 0.9


def compute(settings: Settings, *, output: Path) -> None:
    """Run all strengths by populations and some in spikes; average rates in the windows."""
    table = load_circuit(DEFAULT)
    parts = []
    for engine, strengths, trials in (
        (Population(sample_ms=SAMPLE_MS), D_PRIMES, 2 * settings.circuit_trials),
        (Ensemble(sample_ms=SAMPLE_MS), IN_SPIKES, settings.circuit_trials // 4),
    ):
        model = BasalGanglia(table, engine, gain_of(table), settings.seed)
        for d_prime in strengths:
            found = windows(model, d_prime, trials, settings.seed)
            parts.append(found.assign(engine=engine.id, d_prime=d_prime))
    write_table(pd.concat(parts), output, seed=settings.seed, settings=settings)


def windows(model: BasalGanglia, d_prime: float, trials: int, seed: int) -> pd.DataFrame:
    """Return mean rates above rest, Hz, of a channel in each window; see ``windows.averaged``."""
    rng = stream(seed, "figA1", str(d_prime))
    evidence = gaussian_evidence(trials, d_prime=d_prime, t_max=READINGS, step_ms=STEP_MS, seed=rng)
    activity = model.activity(evidence)
    decided = first_crossing(model.trace(activity, evidence), -np.log(POSTERIOR), forced=False)
    rates = {name: activity.rates_hz[name] for name in NUCLEI}
    rest = resting_hz(model.circuit)
    return averaged(rates, activity.time_ms, decided.choice, decided.time_ms, rest)


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw a row per nucleus and a column per window, and the similarity to the three patterns."""
    table = read_table(data)
    figure, axes = plt.subplots(
        len(NUCLEI), 4, figsize=(7.2, 7.4), sharex="col", width_ratios=[1, 1, 1, 1.1]
    )
    by: Any = table.set_index(["engine", "nucleus", "window", "own"]).sort_index()
    for row, name in zip(axes, NUCLEI, strict=True):
        for ax, window in zip(row[:3], WINDOWS, strict=True):
            for own, colour in ((True, "C0"), (False, "C1")):
                here = by.loc[("population", name, window, own)].sort_values("d_prime")
                style: dict[str, Any] = {"color": colour, "label": PREFERRED[own], "lw": 1}
                ax.errorbar(here["d_prime"], here["hz"], 1.96 * here["se"], fmt="o-", ms=3, **style)
                spikes = by.loc[("ensemble", name, window, own)]
                ax.plot(spikes["d_prime"], spikes["hz"], "kx", ms=4, label="in spikes")
        _likeness(row[3], where(table, engine="population", nucleus=name))
    ticks = [f"{d:g}" for d in D_PRIMES]
    letter(axes[0, 0], "a  100-300 ms")
    letter(axes[0, 1], "b  300-500 ms")
    letter(axes[0, 2], "c  response ± 100 ms")
    letter(axes[0, 3], "d  similarity")
    finish_rows(axes, NUCLEI.values(), D_PRIMES, ticks, "strength, d' per reading")
    key(figure, axes[0, 0], ncols=3)
    return figure


def _likeness(ax: Any, rows: pd.DataFrame) -> None:
    found = likeness(rows.rename(columns={"d_prime": "strength"}), D_PRIMES)
    names = list(found)
    ax.barh(range(len(names)), list(found.values()), color=["C0", "C2", "C3"], height=0.6)
    name_patterns(ax, names)


if __name__ == "__main__":
    run(compute=compute, draw=draw)
