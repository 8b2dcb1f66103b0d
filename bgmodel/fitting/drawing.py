"""The figure of a fit: accuracy, times and their quantiles, data and models."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from bgmodel.fitting.responses import QUANTILES
from bgmodel.support.arrays import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DATA: dict[str, Any] = {"color": "0.15", "ls": "", "ms": 4}
LOOKS = (("o", "-"), ("s", "--"), ("^", ":"), ("D", "-."))
"""Marker of the data and line of the models for each condition, reused cyclically."""
TITLES = (
    "a  share of response 1",
    "b  mean time (s)",
    "c  standard deviation of times (s)",
    "d  quantiles 0.1 to 0.9 of times (s)",
)


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
        Four panels. Error bars of the data are one standard error. Each condition has its own
        marker and line; with a single strength, conditions are placed along the axis.
    """
    import matplotlib.pyplot as plt

    figure, grid = plt.subplots(2, 2, figsize=(9, 7), layout="constrained")
    axes = grid.ravel()
    first = next(iter(fits.values()))
    place, labels, group = _places(first)
    for number, which in enumerate(dict.fromkeys(group)):
        rows = np.array([each == which for each in group])
        mark, line = LOOKS[number % len(LOOKS)]
        seen, x = first[rows], place[rows]
        look = {**DATA, "marker": mark}
        label = f"data, {which}" if which else "data"
        axes[0].errorbar(x, seen["accuracy"], seen["accuracy_se"], label=label, **look)
        axes[1].errorbar(x, seen["mean_s"], seen["mean_se"], **look)
        axes[2].plot(x, seen["sd_s"], **look)
        for q in QUANTILES:
            axes[3].plot(x, seen[f"q{round(100 * q)}_s"], **look)
        for k, (name, cells) in enumerate(fits.items()):
            model = {"color": f"C{k}", "ls": line, "marker": "_" if rows.sum() == 1 else ""}
            label = name if number == 0 else "_"
            axes[0].plot(x, cells.loc[rows, "model_accuracy"], label=label, **model)
            axes[1].plot(x, cells.loc[rows, "model_mean_s"], **model)
            axes[2].plot(x, cells.loc[rows, "model_sd_s"], **model)
            for q in QUANTILES:
                axes[3].plot(x, cells.loc[rows, f"model_q{round(100 * q)}_s"], lw=1, **model)
    for ax, text in zip(axes, TITLES, strict=True):
        ax.set_title(text, loc="left")
        ax.set_xticks(sorted(set(place)), labels)
        ax.set_xlabel("strength" if first["strength"].nunique() > 1 else "condition")
    figure.legend(loc="outside lower center", ncols=4)
    figure.suptitle(f"{title}: bars are one standard error")
    return figure


def _places(cells: pd.DataFrame) -> tuple[Array, list[str], list[str]]:
    """Return the position of each cell, the names of positions, and each cell's condition."""
    columns = list(cells.columns)
    told = columns[columns.index("strength") + 1 : columns.index("trials")]
    names = [name for name in told if cells[name].nunique() > 1]
    conditions = [", ".join(str(row[name]) for name in names) for _, row in cells.iterrows()]
    strengths = sorted(cells["strength"].unique())
    if len(strengths) == 1:
        return np.arange(len(cells), dtype=float), conditions, [""] * len(cells)
    place = np.array([strengths.index(each) for each in cells["strength"]], dtype=float)
    return place, [f"{each:g}" for each in strengths], conditions
