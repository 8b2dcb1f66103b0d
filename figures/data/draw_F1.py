"""Figure F1: the sequential test and the circuit fitted to monkeys and people; from the score."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from bgmodel import stream
from bgmodel.fitting.design import design_of
from bgmodel.support.files import read_table, write_table
from bgmodel.trials.reader import read_trials
from circuits.arrays import Array
from figures.common import Settings, key, letter, say_if_older, where

MONKEYS, PEOPLE = "roitman_shadlen_2002", "palmer_huk_shadlen_2005"
TEST, CIRCUIT = "constant gap", "circuit"
STYLE: dict[str, dict[str, Any]] = {
    TEST: {"color": "C5", "lw": 2.6},
    CIRCUIT: {"color": "C0", "lw": 1.1, "ls": "--"},
}
"""Line style of each model: if two agree, the thin line is on top of the thick one."""
DATA: dict[str, Any] = {"color": "k", "marker": "o", "ms": 3, "ls": "", "lw": 0.8, "zorder": 4}
QUANTILES = {"q10_s": "v", "q50_s": "o", "q90_s": "^"}
"""Quantiles of times shown, and their markers."""
LABELS = {TEST: "test, constant gap", CIRCUIT: "circuit, threshold alone"}
RESAMPLES = 400


def places(strength: pd.Series) -> Array:
    """Return the positions of strengths on a logarithmic axis, with zero at half the weakest."""
    some = strength[strength > 0].min()
    return np.where(strength > 0, strength, some / 2)


def mark_strengths(ax: Any, strength: pd.Series) -> None:
    """Label a logarithmic axis with every strength, per cent."""
    ax.set_xscale("log")
    shown = [f"{100 * s:.3g}" for s in strength]
    ax.set_xticks(places(strength), shown)
    ax.set_xticks([], minor=True)


def mark_quantiles(ax: Any, data: pd.DataFrame, errors: pd.DataFrame) -> None:
    """Draw the RT quantiles of one monkey with their standard errors, and label the strengths."""
    for name, mark in QUANTILES.items():
        style = DATA | {"marker": mark}
        ax.errorbar(places(data["strength"]), data[name], errors[name].to_numpy(), **style)
    mark_strengths(ax, data["strength"])
    ax.set_xlabel("coherence (%)")


def share_height(axes: Iterable[Any]) -> None:
    """Give panels a common vertical range, with labels only on the first."""
    axes = list(axes)
    low = min(ax.get_ylim()[0] for ax in axes)
    high = max(ax.get_ylim()[1] for ax in axes)
    for ax in axes:
        ax.set_ylim(low, high)
    for ax in axes[1:]:
        ax.tick_params(labelleft=False)


def spread(settings: Settings, *, output: Path) -> None:
    """Bootstrap standard errors of the quantiles and SDs of monkeys' response times."""
    choices = read_trials(MONKEYS, strength="coherence")
    rows = []
    for who in choices.people():
        design = design_of(choices.where(choices.participant == who))
        for cell, strength in enumerate(design.strength):
            rt = design.observed.rt_s[design.observed.cell == cell]
            rng = stream(settings.seed, "spread of times", who, f"{strength:g}")
            again = rng.choice(rt, (RESAMPLES, len(rt)))
            row = {"participant": who, "strength": strength}
            for name in QUANTILES:
                row[name] = np.quantile(again, float(name[1:3]) / 100, axis=1).std()
            rows.append(row | {"sd_s": again.std(axis=1).std()})
    write_table(pd.DataFrame(rows), output, seed=settings.seed, settings=settings)


def draw(settings: Settings, cells: Path, spreads: Path, *, output: Path) -> Figure:
    """Draw accuracy, mean times and quantiles: one column per monkey, and one for people."""
    table, errors = read_table(cells), read_table(spreads)
    monkeys, people = (where(table, data=data) for data in (MONKEYS, PEOPLE))
    names = sorted(monkeys["participant"].unique())
    figure, axes = plt.subplots(3, len(names) + 1, figsize=(7.4, 6.6))
    for column, name in zip(axes.T, names, strict=False):
        _monkey(column, *(where(one, participant=name) for one in (monkeys, errors)))
    for row in axes:
        share_height(row[:-1])
    _people(axes[:, -1], people)
    letter(axes[0, 0], f"a  monkey {names[0]}")
    letter(axes[0, 1], f"b  monkey {names[1]}")
    letter(axes[0, -1], f"c  {people['participant'].nunique()} people")
    labels = ("share correct", "mean time (s)", "quantiles of times (s)")
    for ax, label in zip(axes[:, 0], labels, strict=True):
        ax.set_ylabel(label)
    key(figure, axes[0, 0], axes[2, -1], ncols=5, columnspacing=1.2)
    say_if_older(figure, cells)
    return figure


def _monkey(column: Any, table: pd.DataFrame, errors: pd.DataFrame) -> None:
    """Show accuracy, mean times and quantiles of one monkey against strength."""
    for model, label in LABELS.items():
        rows = where(table, model=model).sort_values("strength")
        at = places(rows["strength"])
        column[0].plot(at, rows["model_accuracy"], label=label, **STYLE[model])
        column[1].plot(at, rows["model_mean_s"], **STYLE[model])
        for name in QUANTILES:
            column[2].plot(at, rows[f"model_{name}"], **STYLE[model])
    column[0].errorbar(at, rows["accuracy"], rows["accuracy_se"], label="data", **DATA)
    column[1].errorbar(at, rows["mean_s"], rows["mean_se"], **DATA)
    mark_quantiles(column[2], rows, errors.sort_values("strength"))
    for ax in column[:2]:
        mark_strengths(ax, rows["strength"])
        ax.tick_params(labelbottom=False)


def _people(column: Any, table: pd.DataFrame) -> None:
    """Show people's data against the predictions of both models, one colour per person."""
    kinds = ({"accuracy": "o"}, {"mean_s": "o"}, QUANTILES)
    labels = ("observed share correct", "observed mean time (s)", "observed quantiles (s)")
    for ax, marks, label in zip(column, kinds, labels, strict=True):
        for k, (_, rows) in enumerate(table.groupby("participant")):
            for name, mark in marks.items():
                for model, fill, size in ((TEST, "none", 4.5), (CIRCUIT, f"C{k}", 2.5)):
                    one = where(rows, model=model)
                    style: dict[str, Any] = {"ms": size, "color": f"C{k}", "mfc": fill}
                    ax.plot(one[f"model_{name}"], one[name], mark, mew=0.6, **style)
        low = min(ax.get_xlim()[0], ax.get_ylim()[0])
        high = max(ax.get_xlim()[1], ax.get_ylim()[1])
        ax.plot([low, high], [low, high], color="0.8", lw=0.8, zorder=0)
        ax.set(xlim=(low, high), ylim=(low, high), ylabel=label)
        ax.yaxis.set_major_locator(ax.xaxis.get_major_locator())
    column[-1].set_xlabel("model")
    column[-1].plot([], [], "o", ms=4.5, mew=0.6, color="0.3", mfc="none", label="people, test")
    column[-1].plot([], [], "o", ms=2.5, color="0.3", label="people, circuit")
