"""Figure F1: the sequential test and the circuit held to monkeys and people; from the score."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from bgmodel import stream
from bgmodel.fitting.design import design_of
from bgmodel.support.files import read_table, write_table
from bgmodel.tables.choices import read_choices
from figures.common import Settings, letter, run, say_if_older
from figures.fitted import CIRCUIT, DATA, MONKEYS, PEOPLE, STYLE, TEST, mark_strengths, places
from figures.windows import share_height

QUANTILES = ("q10_s", "q50_s", "q90_s")
LABELS = {TEST: "test, constant gap", CIRCUIT: "circuit, threshold alone"}
QUANTILE_MARK = dict(zip(QUANTILES, ("v", "o", "^"), strict=True))
RESAMPLES = 400


def spread(settings: Settings, *, output: Path) -> None:
    """Resample the times of monkeys: standard errors of their quantiles and of their spread."""
    choices = read_choices(MONKEYS, strength="coherence")
    rows = []
    for who in choices.people():
        design = design_of(choices.where(choices.participant == who))
        for cell, strength in enumerate(design.strength):
            rt = design.observed.rt_s[design.observed.cell == cell]
            rng = stream(settings.seed, "spread of times", who, f"{strength:g}")
            again = rng.choice(rt, (RESAMPLES, len(rt)))
            errors = {
                name: np.quantile(again, float(name[1:3]) / 100, axis=1).std() for name in QUANTILES
            }
            errors["sd_s"] = again.std(axis=1).std()
            rows.append({"participant": who, "strength": strength, **errors})
    write_table(pd.DataFrame(rows), output, seed=settings.seed, settings=settings)


def draw(settings: Settings, cells: Path, spreads: Path, *, output: Path) -> Figure:
    """Draw accuracy, mean times and quantiles: a column per monkey, and one of people."""
    table, errors = read_table(cells), read_table(spreads)
    monkeys, people = (table[table["data"] == data] for data in (MONKEYS, PEOPLE))
    names = sorted(monkeys["participant"].unique())
    figure, axes = plt.subplots(3, len(names) + 1, figsize=(7.4, 6.6))
    for column, name in zip(axes.T, names, strict=False):
        _monkey(
            column, monkeys[monkeys["participant"] == name], errors[errors["participant"] == name]
        )
    for row in axes:
        share_height(row[:-1])
    _people(axes[:, -1], people)
    letter(axes[0, 0], f"a  monkey {names[0]}")
    letter(axes[0, 1], f"b  monkey {names[1]}")
    letter(axes[0, -1], f"c  {people['participant'].nunique()} people")
    for ax, label in zip(
        axes[:, 0], ("share correct", "mean time (s)", "quantiles of times (s)"), strict=True
    ):
        ax.set_ylabel(label)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    more = axes[2, -1].get_legend_handles_labels()
    figure.legend(
        handles + more[0], labels + more[1], loc="outside lower center", ncols=5, columnspacing=1.2
    )
    say_if_older(figure, cells)
    return figure


def _monkey(column: Any, table: pd.DataFrame, errors: pd.DataFrame) -> None:
    """Show accuracy, mean times and quantiles of one monkey against strength."""
    for model, label in LABELS.items():
        rows = table[table["model"] == model].sort_values("strength")
        at = places(rows["strength"])
        column[0].plot(at, rows["model_accuracy"], label=label, **STYLE[model])
        column[1].plot(at, rows["model_mean_s"], **STYLE[model])
        for name in QUANTILES:
            column[2].plot(at, rows[f"model_{name}"], **STYLE[model])
    column[0].errorbar(at, rows["accuracy"], rows["accuracy_se"], label="data", **DATA)
    column[1].errorbar(at, rows["mean_s"], rows["mean_se"], **DATA)
    errors = errors.sort_values("strength")
    for name in QUANTILES:
        mark = DATA | {"marker": QUANTILE_MARK[name]}
        column[2].errorbar(at, rows[name], errors[name].to_numpy(), **mark)
    for ax in column:
        mark_strengths(ax, rows["strength"])
    for ax in column[:2]:
        ax.tick_params(labelbottom=False)
    column[2].set_xlabel("coherence (%)")


def _people(column: Any, table: pd.DataFrame) -> None:
    """Show what people did against what both models say, a colour per person."""
    kinds: tuple[tuple[str, ...], ...] = (("accuracy",), ("mean_s",), QUANTILES)
    labels = ("observed share correct", "observed mean time (s)", "observed quantiles (s)")
    for ax, names, label in zip(column, kinds, labels, strict=True):
        for k, (_, rows) in enumerate(table.groupby("participant")):
            for name in names:
                mark = QUANTILE_MARK.get(name, "o")
                for model, fill in ((TEST, "none"), (CIRCUIT, f"C{k}")):
                    one = rows[rows["model"] == model]
                    size = 4.5 if model == TEST else 2.5
                    ax.plot(
                        one[f"model_{name}"], one[name], mark, ms=size, mew=0.6, color=f"C{k}",
                        mfc=fill,
                    )  # fmt: skip
        low = min(ax.get_xlim()[0], ax.get_ylim()[0])
        high = max(ax.get_xlim()[1], ax.get_ylim()[1])
        ax.plot([low, high], [low, high], color="0.8", lw=0.8, zorder=0)
        ax.set(xlim=(low, high), ylim=(low, high), ylabel=label)
        ax.yaxis.set_major_locator(ax.xaxis.get_major_locator())
    column[-1].set_xlabel("said by the model")
    column[-1].plot([], [], "o", ms=4.5, mew=0.6, color="0.3", mfc="none", label="people, test")
    column[-1].plot([], [], "o", ms=2.5, color="0.3", label="people, circuit")


if __name__ == "__main__":
    run(spread=spread, draw=draw)
