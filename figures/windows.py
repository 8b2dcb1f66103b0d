"""Rates by choice and strength in the three windows of recordings from monkey STN.

Branam, Gold & Ding 2024 recorded 203 cells of the subthalamic nucleus, 100-300 and 300-500 ms after
the onset of motion and within 100 ms of the saccade, for both choices and five coherences (30
numbers per cell), and distinguished three types.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.support.arrays import Array, Integers

EARLY_MS, LATE_MS, ABOUT_MS = (100.0, 300.0), (300.0, 500.0), 100.0
WINDOWS = ("100-300 ms", "300-500 ms", "response ± 100 ms")
PREFERRED = {True: "its own choice", False: "the other choice"}


def averaged(
    rates: Mapping[str, npt.NDArray[Any]],
    time_ms: Array,
    choice: Integers,
    at_ms: Array,
    rest: Mapping[str, float],
) -> pd.DataFrame:
    """Return mean rates above rest, Hz, of a channel in each window, by choice.

    The first two windows include only trials whose response is later.

    Parameters
    ----------
    rates : dict of array (trials, samples, 2), Hz
        Rates of each nucleus; channels are equivalent.
    time_ms : array (samples,), ms
        Sample times, from the onset of motion.
    choice : int array (trials,)
        0 or 1; trials without a choice are ignored.
    at_ms : array (trials,), ms
        Response times.
    rest : dict of float
        Resting rates, Hz.

    Returns
    -------
    DataFrame
        Columns nucleus, window, own (whether the channel was chosen), hz, se and trials.
    """
    seen: dict[str, tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]] = {}
    for window, (low, high) in zip(WINDOWS, (EARLY_MS, LATE_MS), strict=False):
        inside = (time_ms >= low) & (time_ms < high)
        seen[window] = np.broadcast_to(inside, (len(at_ms), len(time_ms))), at_ms >= high
    seen[WINDOWS[2]] = np.abs(time_ms - at_ms[:, None]) <= ABOUT_MS, at_ms >= ABOUT_MS
    rows = []
    for name, each in rates.items():
        for window, (inside, counted) in seen.items():
            for own in PREFERRED:
                # The cells of each channel prefer its choice: use both channels of every trial.
                values = np.concatenate(
                    [
                        _mean(each[..., k], inside)[counted & (choice == (k if own else 1 - k))]
                        for k in (0, 1)
                    ]
                )
                count = len(values)
                row = {"nucleus": name, "window": window, "own": own, "trials": count}
                row["hz"] = values.mean() - rest[name] if count else np.nan
                row["se"] = values.std() / np.sqrt(count) if count else np.nan
                rows.append(row)
    return pd.DataFrame(rows)


def _mean(rates: npt.NDArray[Any], inside: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
    """Return the mean rate (trials,) of samples inside a window."""
    total = np.where(inside, rates, 0.0).sum(axis=1, dtype=np.float64)
    return np.asarray(total / np.maximum(inside.sum(axis=1), 1))


def patterns(strengths: Sequence[float]) -> dict[str, Array]:
    """Return simplified patterns of three theories of STN, (windows, choices, strengths).

    The first is modulated by choice and strength, and positive before the response; the second is
    early and the same for both choices; the third rises with time and strength, but not choice.
    """
    strength = np.array(strengths) / max(strengths)
    sign = np.array([1.0, -1.0])[None, :, None]
    rises = np.array([0.0, 0.5, 1.0])[:, None, None]
    falls = np.array([1.0, 0.3, 0.0])[:, None, None]
    return {
        "choice × strength": rises * sign * strength + rises,
        "early, both choices": falls * np.ones((1, 2, len(strength))),
        "ramp with strength": rises * np.ones((1, 2, 1)) * strength,
    }


def likeness(rows: pd.DataFrame, strengths: Sequence[float]) -> dict[str, float]:
    """Return the correlation of the 30 means of a nucleus with each pattern.

    Parameters
    ----------
    rows : DataFrame
        Columns window, own, strength and hz. Means without trials are ignored.
    strengths : sequence of float
        In the order of the patterns.
    """
    order = rows.set_index(["window", "own", "strength"])["hz"]
    own = np.array([order[w, o, s] for w in WINDOWS for o in PREFERRED for s in strengths])
    there = np.isfinite(own)
    return {
        name: float(np.corrcoef(own[there], pattern.ravel()[there])[0, 1])
        for name, pattern in patterns(strengths).items()
    }


def finish_rows(
    axes: Any, labels: Iterable[str], strengths: Sequence[float], ticks: Sequence[str], what: str
) -> None:
    """Label panels: one row per nucleus, one column per window, and one for the similarity.

    Parameters
    ----------
    axes : array of Axes (nuclei, 4)
        Panels.
    labels : iterable of str
        Name of each nucleus.
    strengths, ticks : sequence of float, sequence of str
        Positions of the ticks of strength, and their labels.
    what : str
        Axis label of strength.
    """
    for row, label in zip(axes, labels, strict=True):
        for ax in row[:3]:
            ax.axhline(0, color="0.8", lw=0.8, zorder=0)
            ax.set(xscale="log")
            ax.set_xticks(strengths, ticks, fontsize=6)
            ax.set_xticks([], minor=True)
        share_height(row[:3])
        row[0].set_ylabel(f"{label}\n(Hz above rest)")
    for ax in axes[-1, :3]:
        ax.set_xlabel(what)
    axes[-1, 3].set_xlabel("r with a pattern")


def name_patterns(ax: Any, names: Sequence[str]) -> None:
    """Label the bars of similarity to each pattern, from the top."""
    ax.axvline(0, color="0.6", lw=0.8)
    ax.set(xlim=(-1, 1), ylim=(-0.6, len(names) - 0.4))
    ax.invert_yaxis()
    ax.set_yticks(range(len(names)), names, fontsize=6)


def share_height(axes: Iterable[Any]) -> None:
    """Give panels a common vertical range, with labels only on the first."""
    axes = list(axes)
    low = min(ax.get_ylim()[0] for ax in axes)
    high = max(ax.get_ylim()[1] for ax in axes)
    for ax in axes:
        ax.set_ylim(low, high)
    for ax in axes[1:]:
        ax.tick_params(labelleft=False)
