"""Figure F2: a criterion that falls within a trial, and its possible origin in STN cells."""

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
from figures.fitted import (
    CIRCUIT,
    DATA,
    DOPAMINE,
    FALLING,
    MONKEYS,
    ONSET,
    QUANTILES,
    STRENGTHS,
    STYLE,
    TEST,
    fitted,
    fitted_table,
    follow,
    mark_quantiles,
    mark_strengths,
    places,
)  # fmt: skip
from figures.windows import share_height

SECONDS = 2.0
NUCLEI = ("STN_onset", "SNr")
TICKS = (-100, -10, 0, 10, 100)
STEP_S = 0.1
"""Width of time bins in which evidence at decisions is averaged."""
FEWEST = 20
"""Minimum number of decisions in such a bin."""
MOST_EVIDENCE = 1.5
"""Upper limit of the criterion panels."""
SHORT = {
    TEST: "test, constant gap",
    CIRCUIT: "circuit, threshold alone",
    FALLING: "test, falling gap",
    DOPAMINE: "circuit, rising dopamine",
    ONSET: "circuit, STN driven at onset",
}


def compute(settings: Settings, parameters: Path, *, output: Path) -> None:
    """Run the circuit fitted to each monkey: rates over time, and evidence at decisions."""
    table = read_table(parameters)
    parts = []
    for who in sorted(table.loc[table["data"] == MONKEYS, "participant"].unique()):
        for model in (CIRCUIT, ONSET):
            values = fitted(table, who, model)
            for kind, found in (("rate", rates), ("criterion", criterion)):
                rows = found(model, values, settings)
                parts.append(rows.assign(participant=who, model=model, kind=kind))
        for model in (TEST, FALLING):
            values = fitted(table, who, model)
            time = np.arange(0, SECONDS, 0.02)
            rate = values["fall_per_s"] if model == FALLING else 0.0
            gap = values["bound"] * np.exp(-rate * time)
            rows = pd.DataFrame({"time_s": time + values["t0_s"], "value": gap})
            parts.append(rows.assign(participant=who, model=model, kind="criterion"))
    write_table(pd.concat(parts), output, seed=settings.seed, settings=settings)


def rates(model: str, values: dict[str, float], settings: Settings) -> pd.DataFrame:
    """Return rates above rest over time, Hz, averaged over channels and coherences.

    Trials continue after the decision.
    """
    table = fitted_table(model, values)
    rest = resting_hz(table)
    did = [
        follow(table, values, strength, settings.circuit_trials // 4, SECONDS, settings.seed)
        for strength in STRENGTHS
    ]
    time_s, parts = did[0].time_ms / 1000, []
    for name in NUCLEI:
        if name in rest:
            hz = np.mean([each.rates_hz[name] for each in did], axis=(0, 1, 3)) - rest[name]
            parts.append(pd.DataFrame({"nucleus": name, "time_s": time_s, "value": hz}))
    return pd.concat(parts)


def criterion(model: str, values: dict[str, float], settings: Settings) -> pd.DataFrame:
    """Return the mean evidence for the choice at decisions, by response time.

    At zero coherence, so that no evidence accrues during the circuit's own delay.
    """
    table = fitted_table(model, values)
    trials = 4 * settings.circuit_trials
    did = follow(table, values, 0.0, trials, SECONDS, settings.seed)
    seen = pd.DataFrame({"time_s": did.at_ms / 1000, "evidence": did.evidence}).dropna()
    by = seen.groupby((seen["time_s"] // STEP_S).astype(int))
    found = by["evidence"].agg(value="mean", se="sem", trials="size")
    found["time_s"] = by["time_s"].mean() + values["t0_s"]
    enough: pd.DataFrame = found[found["trials"] >= FEWEST]
    return enough


def draw(
    settings: Settings, cells: Path, predicted: Path, spreads: Path, rates: Path, *, output: Path
) -> Figure:
    """Draw spread and quantiles, left-out trials, rates, and the criterion."""
    table, better, errors, did = map(read_table, (cells, predicted, spreads, rates))
    monkeys = where(table, data=MONKEYS)
    names = sorted(monkeys["participant"].unique())
    figure = plt.figure(figsize=(7.6, 7.6))
    grid = figure.add_gridspec(3, 3, width_ratios=[1, 1, 1.15])
    above = [[figure.add_subplot(grid[row, k]) for k in range(2)] for row in range(2)]
    for name, *column in zip(names, *above, strict=True):
        _spread(column, *(where(one, participant=name) for one in (monkeys, errors)))
    for row, label in zip(above, ("SD of times (s)", "quantiles of times (s)"), strict=True):
        share_height(row)
        row[0].set_ylabel(label)
    letter(above[0][0], f"a  monkey {names[0]}")
    letter(above[0][1], f"b  monkey {names[1]}")
    right = figure.add_subplot(grid[:2, 2])
    _left_out(right, better)
    letter(right, "c  held-out trials")
    below = [figure.add_subplot(grid[2, k]) for k in range(3)]
    for ax, name in zip(below, names, strict=False):
        _criterion(ax, where(did, participant=name, kind="criterion"))
    letter(below[0], f"d  criterion, monkey {names[0]}")
    letter(below[1], f"e  criterion, monkey {names[1]}")
    below[1].tick_params(labelleft=False)
    below[0].set_ylabel("evidence at the decision (s$^{1/2}$)")
    _rates(below[2], did, names)
    letter(below[2], "f  rates of the circuit")
    key(figure, above[0][0], ncols=3, columnspacing=1.2)
    say_if_older(figure, cells, predicted)
    return figure


def _spread(column: list[Any], table: pd.DataFrame, errors: pd.DataFrame) -> None:
    """Show spread and quantiles of one monkey's times, data and all models."""
    for model, label in SHORT.items():
        rows = where(table, model=model).sort_values("strength")
        at = places(rows["strength"])
        column[0].plot(at, rows["model_sd_s"], label=label, **STYLE[model])
        for name in QUANTILES:
            column[1].plot(at, rows[f"model_{name}"], **STYLE[model])
    errors = errors.sort_values("strength")
    column[0].errorbar(at, rows["sd_s"], errors["sd_s"].to_numpy(), label="data", **DATA)
    mark_strengths(column[0], rows["strength"])
    column[0].tick_params(labelbottom=False)
    column[0].set_ylim(bottom=0)
    mark_quantiles(column[1], rows, errors)


def _left_out(ax: Any, table: pd.DataFrame) -> None:
    """Show how much better each model predicts held-out trials than the constant gap."""
    people = table[["data", "participant"]].drop_duplicates()
    people = people.sort_values("data", key=lambda data: data != MONKEYS, kind="stable")
    shown = [model for model in SHORT if model != TEST]
    ax.axvline(0, color="0.8", lw=0.8, zorder=0)
    for place, (data, who) in enumerate(people.itertuples(index=False)):
        rows = where(table, data=data, participant=who).set_index("model")
        for k, model in enumerate(shown):
            one = rows.loc[model]
            ax.errorbar(
                [one["better_nats"]], [-place + 0.27 - 0.18 * k], xerr=[one["error_nats"]],
                fmt="o", ms=3, lw=0.9, color=STYLE[model]["color"],
            )  # fmt: skip
        if place % 2:
            ax.axhspan(-place - 0.5, 0.5 - place, color="0.96", lw=0, zorder=-1)
    monkeys = people["data"] == MONKEYS
    said = [f"monkey {w}" if m else w for w, m in zip(people["participant"], monkeys, strict=True)]
    ax.set_yticks(-np.arange(len(said)), said)
    ax.set(ylim=(0.5 - len(said), 0.5), xlabel="better than the constant gap (nats)")
    ax.margins(x=0.08)
    ax.set_xscale("symlog", linthresh=10)
    ax.set_xticks(TICKS, [f"{tick:g}" for tick in TICKS])
    ax.axhline(0.5 - monkeys.sum(), color="0.6", lw=0.6, ls=":")


def _criterion(ax: Any, rows: pd.DataFrame) -> None:
    """Show the evidence needed for a decision at each time: gap, fixed point, and simulation."""
    for model in (TEST, FALLING):
        gap = where(rows, model=model)
        ax.plot(gap["time_s"], gap["value"], **STYLE[model])
    for model in (CIRCUIT, ONSET):
        mean, style = where(rows, model=model), STYLE[model] | {"marker": "o", "ms": 3, "mfc": "w"}
        ax.errorbar(mean["time_s"], mean["value"], 1.96 * mean["se"], **style)
    ax.set(xlabel="response time (s)", xlim=(0.2, 1.6), ylim=(0, MOST_EVIDENCE))


def _rates(ax: Any, table: pd.DataFrame, names: list[str]) -> None:
    """Show rates above rest of STN_onset and of SNr, with and without these cells."""
    ax.axhline(0, color="0.8", lw=0.8, zorder=0)
    rows = where(table, kind="rate")
    shown = (
        (ONSET, "STN_onset", "C4", "STN_onset"),
        (ONSET, "SNr", "C1", "SNr, mean of both channels"),
        (CIRCUIT, "SNr", "C0", "SNr, threshold alone"),
    )
    for name, style in zip(names, ("-", "--"), strict=False):
        for model, nucleus, colour, label in shown:
            one = where(rows, participant=name, model=model, nucleus=nucleus)
            ax.plot(one["time_s"], one["value"], ls=style, lw=1.1, color=colour,
                    label=label if style == "-" else None)  # fmt: skip
        ax.plot([], [], style, color="0.3", lw=1.1, label=f"monkey {name}")
    ax.set(xlabel="time from onset of evidence (s)", ylabel="rate above rest (Hz)")
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + 0.55 * (high - low))
    ax.legend(loc="upper right", fontsize=6)


if __name__ == "__main__":
    run(compute=compute, draw=draw)
