"""The figure of a fit: accuracy, times and their quantiles, data beside models."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from bgmodel.arrays import Array
from bgmodel.fitting.fit import QUANTILES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DATA: dict[str, Any] = {"color": "0.15", "marker": "o", "ls": "", "ms": 4}


def draw_fits(fits: Mapping[str, pd.DataFrame], title: str) -> Figure:
    """Draw data beside models: psychometric, chronometric, spread and quantiles.

    Parameters
    ----------
    fits : dict of str to DataFrame
        Cells of each model, as from ``fit.cells_of``; the data are the same in all.
    title : str
        Whose data.

    Returns
    -------
    Figure
        Four panels. Bars of the data are one standard error.
    """
    import matplotlib.pyplot as plt

    figure, grid = plt.subplots(2, 2, figsize=(9, 7), layout="constrained")
    axes = grid.ravel()
    first = next(iter(fits.values()))
    place, labels = _places(first)
    axes[0].errorbar(place, first["accuracy"], first["accuracy_se"], label="data", **DATA)
    axes[1].errorbar(place, first["mean_s"], first["mean_se"], **DATA)
    axes[2].plot(place, first["sd_s"], **DATA)
    for q in QUANTILES:
        axes[3].plot(place, first[f"q{round(100 * q)}_s"], **DATA)
    for name, cells in fits.items():
        (line,) = axes[0].plot(place, cells["model_accuracy"], label=name)
        axes[1].plot(place, cells["model_mean_s"], color=line.get_color())
        axes[2].plot(place, cells["model_sd_s"], color=line.get_color())
        for q in QUANTILES:
            axes[3].plot(place, cells[f"model_q{round(100 * q)}_s"], color=line.get_color(), lw=1)
    titles = ("a  accuracy", "b  mean time (s)", "c  standard deviation of times (s)",
              "d  quantiles .1 to .9 of times (s)")  # fmt: skip
    for ax, text in zip(axes, titles, strict=True):
        ax.set_title(text, loc="left")
        _mark(ax, place, labels)
    axes[0].legend()
    figure.suptitle(title)
    return figure


def _places(cells: pd.DataFrame) -> tuple[Array, list[str]]:
    """Return where cells stand, evenly in order, and what they are called."""
    columns = list(cells.columns)
    told = columns[columns.index("strength") : columns.index("trials")]
    names = [name for name in told if cells[name].nunique() > 1]
    labels = [
        "\n".join(f"{row[name]:g}" if name == "strength" else str(row[name]) for name in names)
        for _, row in cells.iterrows()
    ]
    return np.arange(len(cells), dtype=float), labels


def _mark(ax: Axes, place: Array, labels: list[str]) -> None:
    ax.set_xticks(place, labels)
    ax.set_xlabel("strength or condition")
