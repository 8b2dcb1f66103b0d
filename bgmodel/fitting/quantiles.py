"""Quantiles of correct and wrong response times, data and model, and where these differ most."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from bgmodel.fitting.exact.responses import QUANTILES
from bgmodel.support.arrays import Array, Integers

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

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
