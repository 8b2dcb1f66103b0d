"""Figure A1: rates by choice and strength in three windows, as STN cells of monkeys were read.

Branam, Gold & Ding 2024 read 203 cells of the subthalamic nucleus in 100-300 and 300-500 ms after
the onset of motion and within 100 ms of the saccade, for both choices and five coherences, and told
three kinds apart. Here are the same windows of every nucleus of the circuit, by populations, and of
some strengths in spikes. What is like which kind is said by correlation with simple patterns.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.figure import Figure

from bgmodel import first_crossing, stream
from bgmodel.evidence import gaussian_evidence
from bgmodel.files import read_table, write_table
from bgmodel.integrators.basal_ganglia import BasalGanglia, gain_of
from circuits.anatomy import DEFAULT, circuit
from circuits.anatomy.printed_rates import at_rest
from figures.common import Settings, letter, run

NUCLEI = {"ctx": "ctx (as LIP)", "D1": "D1 (as caudate)", "STN": "STN", "GPe": "GPe", "SNr": "SNr"}
D_PRIMES = (0.125, 0.25, 0.5, 0.75, 1.0)
"""Strengths: d' a reading of 50 ms."""
IN_SPIKES = (0.25, 1.0)
READINGS, STEP_MS, SAMPLE_MS = 40, 50.0, 5.0
POSTERIOR = 0.9
EARLY_MS, LATE_MS, ABOUT_MS = (100.0, 300.0), (300.0, 500.0), 100.0
WINDOWS = ("100-300 ms", "300-500 ms", "response ± 100 ms")
PREFERRED = {True: "its own choice", False: "the other choice"}


def compute(settings: Settings, *, output: Path) -> None:
    """Run all strengths by populations and some in spikes; average rates in the windows."""
    table = circuit(DEFAULT)
    parts = []
    for engine, strengths, trials in (
        ("population", D_PRIMES, 2 * settings.circuit_trials),
        ("ensemble", IN_SPIKES, settings.circuit_trials // 4),
    ):
        options = {"sample_ms": SAMPLE_MS}
        model = BasalGanglia(table, engine, gain_of(table), settings.seed, options)
        for d_prime in strengths:
            found = windows(model, d_prime, trials, settings.seed)
            parts.append(found.assign(engine=engine, d_prime=d_prime))
    write_table(pd.concat(parts), output, seed=settings.seed, settings=settings)


def windows(model: BasalGanglia, d_prime: float, trials: int, seed: int) -> pd.DataFrame:
    """Return mean rates above rest, Hz, of channel 0 in each window, by the choice that is made.

    The first two windows are of trials that respond after them.

    Returns
    -------
    DataFrame
        Columns nucleus, window, own (whether channel 0 was chosen), hz, se and trials.
    """
    evidence = gaussian_evidence(
        trials, READINGS, d_prime / np.sqrt(2), rng=stream(seed, "figA1", str(d_prime)),
        hypotheses=2, step_ms=STEP_MS,
    )  # fmt: skip
    rest, rows = at_rest(model.circuit), []
    activity = model.activity(evidence)
    decided = first_crossing(model.trace(activity, evidence), -np.log(POSTERIOR), forced=False)
    time = activity.time_ms
    at = decided.time_ms
    seen = {
        WINDOWS[0]: (np.broadcast_to((time >= EARLY_MS[0]) & (time < EARLY_MS[1]),
                                     (trials, len(time))), at >= EARLY_MS[1]),
        WINDOWS[1]: (np.broadcast_to((time >= LATE_MS[0]) & (time < LATE_MS[1]),
                                     (trials, len(time))), at >= LATE_MS[1]),
        WINDOWS[2]: (np.abs(time - at[:, None]) <= ABOUT_MS, at >= ABOUT_MS),
    }  # fmt: skip
    for name in NUCLEI:
        rates = activity.rates_hz[name]
        for window, (inside, counted) in seen.items():
            for own in (True, False):
                # Each channel's cells prefer its choice: both are read, one trial each.
                values = np.concatenate(
                    [
                        _mean(rates[..., k], inside)[counted & (decided.choice == chosen)]
                        for k, chosen in ((0, 0 if own else 1), (1, 1 if own else 0))
                    ]
                )
                count = len(values)
                rows.append(
                    {
                        "nucleus": name,
                        "window": window,
                        "own": own,
                        "hz": values.mean() - rest[name] if count else np.nan,
                        "se": values.std() / np.sqrt(count) if count else np.nan,
                        "trials": count,
                    }
                )
    return pd.DataFrame(rows)


def _mean(rates: npt.NDArray[Any], inside: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
    """Return the mean rate (trials,) of samples inside a window."""
    total = np.where(inside, rates, 0.0).sum(axis=1, dtype=np.float64)
    return np.asarray(total / np.maximum(inside.sum(axis=1), 1))


def patterns() -> dict[str, npt.NDArray[np.float64]]:
    """Return the patterns of three theories of STN, (windows, choices, strengths), simplified.

    The first is modulated by choice and strength, and positive before the response; the second
    early and the same for both choices; the third rises with time and strength, not choice.
    """
    strength = np.array(D_PRIMES) / max(D_PRIMES)
    sign = np.array([1.0, -1.0])[None, :, None]
    rises = np.array([0.0, 0.5, 1.0])[:, None, None]
    falls = np.array([1.0, 0.3, 0.0])[:, None, None]
    return {
        "choice × strength": rises * sign * strength + rises,
        "early, both choices": falls * np.ones((1, 2, len(strength))),
        "ramp with strength": rises * np.ones((1, 2, 1)) * strength,
    }


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw a row per nucleus and a column per window, and the likeness to the three patterns."""
    table = read_table(data)
    figure, axes = plt.subplots(
        len(NUCLEI), 4, figsize=(7.2, 7.4), sharex="col", width_ratios=[1, 1, 1, 1.1]
    )
    by = table.set_index(["engine", "nucleus", "window", "own"]).sort_index()
    for row, (name, title) in zip(axes, NUCLEI.items(), strict=True):
        for ax, window in zip(row[:3], WINDOWS, strict=True):
            for own, colour in ((True, "C0"), (False, "C1")):
                here = by.loc[("population", name, window, own)].sort_values("d_prime")
                ax.errorbar(
                    here["d_prime"], here["hz"], 1.96 * here["se"], fmt="o-", ms=3, lw=1,
                    color=colour, label=PREFERRED[own],
                )  # fmt: skip
                spikes = by.loc[("ensemble", name, window, own)]
                ax.plot(spikes["d_prime"], spikes["hz"], "kx", ms=4, label="in spikes")
            ax.axhline(0, color="0.8", lw=0.8, zorder=0)
            ax.set(xscale="log")
            ax.set_xticks(D_PRIMES, [f"{d:g}" for d in D_PRIMES], fontsize=6)
            ax.set_xticks([], minor=True)
        low = min(ax.get_ylim()[0] for ax in row[:3])
        high = max(ax.get_ylim()[1] for ax in row[:3])
        for ax in row[:3]:
            ax.set_ylim(low, high)
        for ax in row[1:3]:
            ax.tick_params(labelleft=False)
        row[0].set_ylabel(f"{title}\n(Hz above rest)")
        _likeness(row[3], table[(table["engine"] == "population") & (table["nucleus"] == name)])
    letter(axes[0, 0], "a  100-300 ms")
    letter(axes[0, 1], "b  300-500 ms")
    letter(axes[0, 2], "c  response ± 100 ms")
    letter(axes[0, 3], "d  likeness")
    for ax in axes[-1, :3]:
        ax.set_xlabel("strength, d' a reading")
    axes[-1, 3].set_xlabel("r with a pattern")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    figure.legend(unique.values(), unique.keys(), loc="outside lower center", ncols=3)
    return figure


def _likeness(ax: Any, rows: pd.DataFrame) -> None:
    order = rows.set_index(["window", "own", "d_prime"])["hz"]
    shape = [[[order[w, own, d] for d in D_PRIMES] for own in PREFERRED] for w in WINDOWS]
    own = np.array(shape).ravel()
    names = list(patterns())
    values = [np.corrcoef(own, pattern.ravel())[0, 1] for pattern in patterns().values()]
    ax.barh(range(len(names)), values, color=["C0", "C2", "C3"], height=0.6)
    ax.axvline(0, color="0.6", lw=0.8)
    ax.set(xlim=(-1, 1), ylim=(-0.6, len(names) - 0.4))
    ax.invert_yaxis()
    ax.set_yticks(range(len(names)), names, fontsize=6)


if __name__ == "__main__":
    run(compute=compute, draw=draw)
