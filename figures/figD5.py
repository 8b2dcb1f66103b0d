"""Figure D5: spectra of STN and GPe, beside the frequency at which the delayed loop turns.

What dopamine does to striatum hardly reaches the loop. What does is its coupling, and losing the
common mode that holds S: both are shown as edits, each with the rightmost turning root of the
linearised rates, and all of it is the model's prediction. Spikes turn faster than those rates: a
noisy cell that integrates and fires answers before its membrane has settled.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from bgmodel.files import read_table, write_table
from bgmodel.integrators.basal_ganglia import BasalGanglia
from circuits.anatomy import circuit
from circuits.laws.stability import roots
from circuits.spec import Circuit
from figures.common import Settings, letter, run

NUCLEI = ("STN", "GPe")
DRIVE = (1.0, -1.0)
"""Steady evidence, nats."""
SECONDS = 4
DASHES = {"dopamine 0.8": (0, (4, 3)), "dopamine 1.6": (0, (1, 2))}
"""What lies on the line of dopamine 1 leaves it to be seen."""


def edits(table: Circuit) -> dict[str, Circuit]:
    """Return what is compared: dopamine in striatum, coupling of the loop, the common mode."""
    both = table.scaled("STN", "GPe", 1.6).scaled("GPe", "STN", 1.6)
    return {
        "dopamine 1": table,
        "dopamine 0.8": table.dopamine(0.8),
        "dopamine 1.6": table.dopamine(1.6),
        "loop x 1.6 each": both,
        "no common mode, S = 4.5": _freed(table, 4.5),
        "no common mode, S = 5.5": _freed(table, 5.5),
    }


def _freed(table: Circuit, total_nats: float) -> Circuit:
    """Return the circuit without its common mode, driven to some S at rest."""
    bias = total_nats - table.reference_nats
    return table.without("common").with_population("ctx", bias_nats=bias)


def compute(settings: Settings, *, output: Path) -> None:
    """Run each edit under steady evidence, count spikes every millisecond, and find its root."""
    trials = settings.dopamine_trials
    drive = np.broadcast_to(DRIVE, (trials, SECONDS + 1, 2))
    parts = []
    for name, table in edits(circuit("spiking_msprt")).items():
        model = BasalGanglia(table, "ensemble", seed=settings.seed)
        activity = model.run_drive(drive, step_ms=1000.0)
        root = _root(table)
        for nucleus in NUCLEI:
            frequency, power = activity.spectrum(nucleus, from_ms=1000.0)
            parts.append(
                pd.DataFrame({"frequency_hz": frequency, "power": power}).assign(
                    edit=name,
                    nucleus=nucleus,
                    mean_hz=float(np.mean(activity.rates_hz[nucleus][:, 1000:])),
                    root_hz=abs(root.imag) / (2 * np.pi),
                    growth_per_s=root.real,
                )
            )
    write_table(pd.concat(parts), output, seed=settings.seed, settings=settings)


def _root(table: Circuit) -> complex:
    turning = [root for root in roots(table, DRIVE) if abs(root.imag) > 2 * np.pi]
    return turning[0] if turning else complex(np.nan, np.nan)


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw the spectra, and beside each the frequency and growth of the loop's root."""
    table = read_table(data)
    table = table[(table["frequency_hz"] >= 3) & (table["frequency_hz"] <= 100)]
    figure, axes = plt.subplots(1, 2, figsize=(7.2, 2.8), sharex=True)
    for ax, nucleus, title in zip(
        axes, NUCLEI, ("a  power of STN", "b  power of GPe"), strict=True
    ):
        rows = table[table["nucleus"] == nucleus]
        for k, (name, one) in enumerate(rows.groupby("edit", sort=False)):
            first = one.iloc[0]
            text = f"{name}: {first['root_hz']:.0f} Hz, {first['growth_per_s']:+.0f} /s"
            style = {"color": f"C{k}", "ls": DASHES.get(str(name), "-"), "label": text}
            ax.plot(one["frequency_hz"], one["power"], lw=1, **style)
        ax.set(xscale="log", yscale="log", xlabel="frequency (Hz)")
        ax.set_xticks([3, 10, 30, 100], ["3", "10", "30", "100"])
        letter(ax, title)
    axes[0].set(ylabel="power (Hz$^2$/Hz)")
    axes[1].legend(
        loc="upper left",
        bbox_to_anchor=(1.0, 1.0),
        title="edit: frequency and growth\nof the linear rates' root",
    )
    return figure


if __name__ == "__main__":
    run(compute=compute, draw=draw)
