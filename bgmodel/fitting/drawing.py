"""The figure of a fit: accuracy, times and their quantiles, data and models."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from bgmodel.fitting.design import FAVOURS
from bgmodel.fitting.responses import QUANTILES
from bgmodel.plots import wilson
from bgmodel.support.arrays import Array
from circuits.plots import PALETTE, panels, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DATA: dict[str, Any] = {"color": "k", "ls": "", "ms": 4}
LOOKS = (("o", "-"), ("s", "--"), ("^", ":"), ("D", "-."))
"""Marker of the data and line of the models for each condition, reused cyclically."""
TITLES = (
    "a  Choices",
    "b  Mean response time",
    "c  Spread of response times",
    "d  Quantiles 0.1, 0.3, 0.5, 0.7, 0.9",
)
LABELS = (
    "Share of the favoured response",
    "Mean response time (s)",
    "Standard deviation (s)",
    "Response time (s)",
)


@styled
def draw_fits(fits: Mapping[str, pd.DataFrame], title: str) -> Figure:
    """Draw data and models: psychometric, chronometric, spread and quantiles, over strength.

    Parameters
    ----------
    fits : dict of str to DataFrame
        Cells of each model, as from ``fit.cells_of``; the data are the same in all.
    title : str
        Title, such as the name of the participant.

    Returns
    -------
    Figure
        Four panels over strength: share of the response that the
        strength favours (response 1 without strengths), mean, standard deviation and quantiles of
        response times; data are markers, models lines. Error bars of the data are 95 % intervals
        (Wilson's for choices, 1.96 standard errors for means). Each condition has its own marker
        and line; with a single strength, conditions are placed along the axis. The title has the
        number of trials.
    """
    figure, grid = panels(2, 2, size=(7.2, 5.4))
    axes = grid.ravel()
    first = next(iter(fits.values()))
    place, labels, group = _places(first)
    for number, which in enumerate(dict.fromkeys(group)):
        rows = np.array([each == which for each in group])
        mark, line = LOOKS[number % len(LOOKS)]
        seen, x = first[rows], place[rows]
        look = {**DATA, "marker": mark}
        label = f"Data, {which}" if which else "Data"
        bars = {**look, "capsize": 2, "elinewidth": 0.8}
        axes[0].errorbar(x, seen["accuracy"], _wilson_ends(seen), label=label, **bars)
        axes[1].errorbar(x, seen["mean_s"], 1.96 * seen["mean_se"], **bars)
        axes[2].plot(x, seen["sd_s"], **look)
        for q in QUANTILES:
            axes[3].plot(x, seen[f"q{round(100 * q)}_s"], **look)
        for k, (name, cells) in enumerate(fits.items()):
            model = {
                "color": PALETTE[k % len(PALETTE)],
                "ls": line,
                "marker": "_" if rows.sum() == 1 else "",
            }
            label = name if number == 0 else "_"
            axes[0].plot(x, cells.loc[rows, "model_accuracy"], label=label, **model)
            axes[1].plot(x, cells.loc[rows, "model_mean_s"], **model)
            axes[2].plot(x, cells.loc[rows, "model_sd_s"], **model)
            for q in QUANTILES:
                axes[3].plot(x, cells.loc[rows, f"model_q{round(100 * q)}_s"], lw=1, **model)
    for ax, text, unit in zip(axes, TITLES, LABELS, strict=True):
        ax.set(title=text, ylabel=unit)
        ax.set_xticks(sorted(set(place)), labels)
        ax.set_xlabel("Strength" if first["strength"].nunique() > 1 else "Condition")
    figure.legend(loc="outside lower center", ncols=4)
    few, most, total = (int(f(first["trials"])) for f in (np.min, np.max, np.sum))
    many = f"{most}" if few == most else f"{few} to {most}"
    figure.suptitle(
        f"{title}: {total} trials, {many} per point; bars: 95 % intervals of the data",
        x=0.01,
        ha="left",
    )
    return figure


def _wilson_ends(seen: pd.DataFrame) -> Array:
    """Return the distances of Wilson's interval from the share of response 1, (2, cells)."""
    share, answered = (seen[name].to_numpy(dtype=float) for name in ("accuracy", "answered"))
    low, high = wilson(share * answered, np.maximum(answered, 1))
    ends = np.clip(np.stack([share - low, high - share]), 0, None)
    return np.asarray(np.nan_to_num(ends), dtype=np.float64)


def _places(cells: pd.DataFrame) -> tuple[Array, list[str], list[str]]:
    """Return the position of each cell, the names of positions, and each cell's condition."""
    columns = list(cells.columns)
    told = columns[columns.index("strength") + 1 : columns.index("trials")]
    names = [name for name in told if cells[name].nunique() > 1]
    # A side is a response, which alone would not say what it is.
    words = {name: f"{FAVOURS} " if name == FAVOURS else "" for name in names}
    conditions = [
        ", ".join(f"{words[name]}{row[name]}" for name in names) for _, row in cells.iterrows()
    ]
    strengths = sorted(cells["strength"].unique())
    if len(strengths) == 1:
        return np.arange(len(cells), dtype=float), conditions, [""] * len(cells)
    place = np.array([strengths.index(each) for each in cells["strength"]], dtype=float)
    return place, [f"{each:g}" for each in strengths], conditions
