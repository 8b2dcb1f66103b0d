"""Data and model side by side: quantiles of correct and wrong response times, and figures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from bgmodel.fitting.design import FAVOURS
from bgmodel.fitting.responses import QUANTILES
from bgmodel.plots import wilson
from circuits.arrays import Array, Integers
from circuits.plots import GREY, PALETTE, Look, panels, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Row = Mapping[Any, Any]
FEWEST = 20
"""Number of responses from which their quantiles are given. With fewer, the standard error of the
outer quantiles is unreliable: at 10 responses intervals of 1.96 standard errors miss the truth in a
fifth of samples or more."""
SIDES = {"wrong": 0, "correct": 1}
"""Names of a response: 1 is the one that the strength favours."""
PERCENT = {q: round(100 * q) for q in QUANTILES}


def observed_quantiles(rt_s: Array, response: Integers) -> dict[str, float]:
    """Return ``correct_q10_s``, its error ``correct_q10_se``, ..., s; NaN below ``FEWEST``.

    Hazen's rule has little bias in small samples; errors are those of Maritz & Jarrett (1978).
    """
    from scipy.stats.mstats import mjci

    quantiles: dict[str, float] = {}
    for name, side in SIDES.items():
        times = rt_s[(response == side) & np.isfinite(rt_s)]
        at, error = np.full((2, len(QUANTILES)), np.nan)
        if len(times) >= FEWEST:
            at = np.quantile(times, QUANTILES, method="hazen")
            error = np.asarray(mjci(times, QUANTILES))
        for (_, percent), value, se in zip(PERCENT.items(), at, error, strict=True):
            quantiles |= {f"{name}_q{percent}_s": float(value), f"{name}_q{percent}_se": float(se)}
    return quantiles


def predicted_quantiles(mass: Array, width_s: float) -> dict[str, float]:
    """Return ``model_q10_s``, ..., ``model_wrong_q90_s``, s; ``mass`` is (2, bins)."""
    parts = {"model_": mass.sum(axis=0)}
    parts |= {f"model_{name}_": mass[side] for name, side in SIDES.items()}
    edges = np.arange(mass.shape[1] + 1) * width_s
    times = {}
    for name, one in parts.items():
        total = one.sum() or np.nan  # of a response that the model never gives
        below = np.concatenate([[0.0], one.cumsum() / total])
        for q, percent in PERCENT.items():
            times[f"{name}q{percent}_s"] = float(np.interp(q, below, edges))
    return times


def conditions_of(cells: pd.DataFrame) -> list[str]:
    """Return the names of the columns with conditions, in a table of design cells."""
    columns = list(cells.columns)
    return columns[columns.index("strength") + 1 : columns.index("trials")]


def residuals(cells: pd.DataFrame) -> pd.DataFrame:
    """Return differences between quantiles of data and model, the largest ``z`` first."""
    columns = ["strength", *conditions_of(cells)]
    differences = pd.DataFrame(
        [{**{name: row[name] for name in columns}, **each} for row, each in _each(cells)],
        columns=[*columns, "response", "responses", "quantile", "data_ms", "model_ms",
                 "residual_ms", "se_ms", "z"],
    )  # fmt: skip
    return differences.sort_values("z", key=np.abs, ascending=False, ignore_index=True)


def _each(cells: pd.DataFrame) -> Iterator[tuple[Row, dict[str, object]]]:
    for row in cells.to_dict("records"):
        for name, number in _counts(row).items():
            for q, percent in PERCENT.items():
                data, model, se = (
                    1000 * row[column]
                    for column in (f"{name}_q{percent}_s", f"model_{name}_q{percent}_s",
                                   f"{name}_q{percent}_se")
                )  # fmt: skip
                # Times that are all the same have no standard error.
                if np.isfinite(data) and se > 0:
                    yield row, {
                        "response": name, "responses": number, "quantile": q, "data_ms": data,
                        "model_ms": model, "residual_ms": data - model, "se_ms": se,
                        "z": (data - model) / se,
                    }  # fmt: skip


def _counts(row: Row) -> dict[str, int]:
    correct = round(row["answered"] * row["accuracy"]) if row["answered"] else 0
    return {"correct": correct, "wrong": int(row["answered"]) - correct}


def too_few(cells: pd.DataFrame) -> str:
    """Return a sentence on cells with too few errors for quantiles, or an empty text."""
    rows = cells.to_dict("records")
    few = [n for row in rows if (n := _counts(row)["wrong"]) < FEWEST]
    if not few or cells["mean_s"].isna().all():
        return ""
    return f"{len(few)} of {len(rows)} cells: fewer than {FEWEST} errors, without quantiles"


def phrase(row: Row) -> str:
    """Return a residual, a row of ``residuals`` as a dict, in words."""
    names = list(row)[: list(row).index("response")]
    cell = ", ".join(
        f"{name} {row[name]:g}" if name == "strength" else f"{name} {row[name]}" for name in names
    )
    return (
        f"quantile {row['quantile']} of {row['response']} times at {cell}: "
        f"{row['residual_ms']:+.0f} ms ({row['z']:+.1f} standard errors)"
    )


DATA: dict[str, Any] = {"color": "k", "ls": "", "ms": 4}
LOOKS = (("o", "-"), ("s", "--"), ("^", ":"), ("D", "-."))
"""Marker of the data and line of the models for each condition, reused cyclically."""
TITLES = (
    "a  Share of the favoured response",
    "b  Mean response time",
    "c  Spread of response times",
    "d  Quantiles 0.1, 0.3, 0.5, 0.7, 0.9",
    "e  These quantiles for correct (filled) and wrong (open) responses",
)
LABELS = (
    "Share of the favoured response",
    "Mean response time (s)",
    "Standard deviation (s)",
    "Response time (s)",
    "Response time (s)",
)


@styled
def draw_fits(fits: Mapping[str, pd.DataFrame], title: str) -> Figure:
    """Draw data (95 % intervals) and models, as from ``cells_of``, over strength, probability."""
    figure, axes = _axes()
    first = next(iter(fits.values()))
    place, labels, group = _places(first)
    several = first["strength"].nunique() > 1
    for number, which in enumerate(dict.fromkeys(group)):
        rows = np.array([each == which for each in group])
        mark, line = LOOKS[number % len(LOOKS)]
        _data(axes, first[rows], place[rows], mark, f"Data, {which}" if which else "Data")
        for k, (name, cells) in enumerate(fits.items()):
            look = {
                "color": PALETTE[k % len(PALETTE)],
                "ls": line if several else "",
                "marker": "" if several and rows.sum() > 1 else "_",
            }
            _model(axes, cells[rows], place[rows], look, f"{name}, {which}" if which else name)
    for ax, text, unit in zip(axes, TITLES, LABELS, strict=True):
        ax.set(title=text, ylabel=unit)
    for ax in axes[:4]:
        ax.set_xticks(sorted(set(place)), labels)
        ax.set_xlabel("Strength" if several else "Condition")
    axes[4].set(xlabel="Probability of the response", xlim=(-0.02, 1.02))
    axes[4].set_title(too_few(first), loc="right", fontsize=6.5, color=GREY)
    figure.legend(loc="outside lower center", ncols=4)
    few, most, total = (int(f(first["trials"])) for f in (np.min, np.max, np.sum))
    many = f"{most}" if few == most else f"{few} to {most}"
    figure.suptitle(
        f"{title}: {total} trials, {many} per point; bars (a, b, e): 95 % intervals of the data",
        x=0.01,
        ha="left",
    )
    return figure


def _axes() -> tuple[Figure, list[Axes]]:
    """Return a figure with four panels, and a fifth below them that is twice as wide."""
    figure, grid = panels(3, 2, size=(7.2, 8.0))
    *axes, wide, spare = grid.ravel()
    wide.set_subplotspec(wide.get_gridspec()[2, :])
    spare.remove()
    return figure, [*axes, wide]


def _data(axes: list[Axes], seen: pd.DataFrame, place: Array, mark: str, label: str) -> None:
    look = {**DATA, "marker": mark}
    bars = {**look, "capsize": 2, "elinewidth": 0.8}
    axes[0].errorbar(place, seen["accuracy"], _wilson_ends(seen), label=label, **bars)
    axes[1].errorbar(place, seen["mean_s"], 1.96 * seen["mean_se"], **bars)
    axes[2].plot(place, seen["sd_s"], **look)
    for percent in PERCENT.values():
        axes[3].plot(place, seen[f"q{percent}_s"], **look)
        for name, fill in (("correct", "k"), ("wrong", "w")):
            axes[4].errorbar(
                _probability(seen["accuracy"], name),
                seen[f"{name}_q{percent}_s"],
                1.96 * seen[f"{name}_q{percent}_se"],
                **bars,
                mfc=fill,
            )


def _model(axes: list[Axes], cells: pd.DataFrame, place: Array, look: Look, label: str) -> None:
    axes[0].plot(place, cells["model_accuracy"], label=label, **look)
    axes[1].plot(place, cells["model_mean_s"], **look)
    axes[2].plot(place, cells["model_sd_s"], **look)
    both = pd.concat([_probability(cells["model_accuracy"], name) for name in SIDES])
    order = both.to_numpy().argsort(kind="stable")
    for percent in PERCENT.values():
        axes[3].plot(place, cells[f"model_q{percent}_s"], **look, lw=1)
        # Shown where those of the data are known: others are of lapses.
        names = [f"{name}_q{percent}_s" for name in SIDES]
        times = pd.concat([cells[f"model_{n}"].where(cells[n].notna()) for n in names])
        alone: Look = {"marker": "_", "ms": 8} if times.notna().sum() == 1 else {}
        axes[4].plot(both.to_numpy()[order], times.to_numpy()[order], **{**look, "lw": 1, **alone})


def _probability(accuracy: pd.Series, name: str) -> pd.Series:
    return accuracy if name == "correct" else 1 - accuracy


def _wilson_ends(seen: pd.DataFrame) -> Array:
    """Return the distances of Wilson's interval from the share of response 1, (2, cells)."""
    share, answered = (seen[name].to_numpy(dtype=float) for name in ("accuracy", "answered"))
    low, high = wilson(share * answered, np.maximum(answered, 1))
    ends = np.clip(np.stack([share - low, high - share]), 0, None)
    return np.asarray(np.nan_to_num(ends), dtype=np.float64)


def _places(cells: pd.DataFrame) -> tuple[Array, list[str], list[str]]:
    """Return the position of each cell, the names of positions, and each cell's condition."""
    names = [name for name in conditions_of(cells) if cells[name].nunique() > 1]
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


@styled
def draw_comparison(table: pd.DataFrame, by_person: Mapping[str, Array], title: str) -> Figure:
    """Draw each model's score minus the best, nats, in total and for each person."""
    figure, grid = panels(1, 2, size=(7.2, 1.2 + 0.3 * len(table)))
    total, each = grid.ravel()
    place = np.arange(len(table))[::-1]
    bars = 2 * table["standard_error"]
    total.errorbar(table["difference"], place, xerr=bars, **DATA, marker="o", capsize=2)
    for row, name in zip(place, table.index, strict=True):
        scores = by_person[str(name)]
        each.plot(scores, np.full(len(scores), row), "|", color=PALETTE[0], ms=9)
    titles = ("a  All trials, with 2 standard errors", "b  Each participant")
    for ax, text in zip((total, each), titles, strict=True):
        ax.axvline(0, color=GREY, lw=0.8)
        ax.set(title=text, yticks=place, ylim=(-0.6, len(table) - 0.4))
        ax.set_xlabel("Score minus the highest (nats)")
        ax.set_yticklabels(table.index if ax is total else [""] * len(table))
    figure.suptitle(title, x=0.01, ha="left")
    return figure
