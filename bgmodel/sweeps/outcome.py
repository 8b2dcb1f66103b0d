"""Results of a sweep: one table with a row per point and measure, and a figure."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from bgmodel.bootstrap import RESAMPLES, interval, resampled, weights_of
from bgmodel.deciding.calibration import miscalibrated
from bgmodel.deciding.measures import CUT_OFF, NO_DIFFUSION, OF_ALL, OF_DIFFUSION
from bgmodel.deciding.tradeoff import decides_without_evidence
from bgmodel.experiments.expected import FEWEST_DECIDED
from bgmodel.experiments.record import MANY_MISSED
from bgmodel.plots import labelled
from bgmodel.support.seeds import stream
from bgmodel.sweeps.plan import Plan, Point, measures_of
from bgmodel.sweeps.shards import REMARK, read
from circuits.arrays import Array
from circuits.declaration.edits import FRACTION, VERBS
from circuits.errors import EditWarning, InputError
from circuits.plots import look, panels, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LINES = 4
"""Largest number of lines in a panel."""
MARKERS = "os^D"
AT_ONCE = 20_000_000
"""Largest number of bootstrap weights in memory at a time."""


def measured(point: Point, folder: Path) -> pd.DataFrame:
    """Return the measures of one point, with gain and remark (a warning, or why the run ended).

    Intervals (95 %) are from a bootstrap over trials, the same for points of one size. Values are
    NaN if the circuit could not be run.
    """
    behaviour, remark = read(point, folder)
    if behaviour is None:
        table = pd.DataFrame({"measure": measures_of(point)}).assign(
            value=np.nan, low=np.nan, high=np.nan
        )
        return table.assign(trials=0, gain=point.used_gain, **{REMARK: remark})
    trials = len(behaviour.decision.choice)
    measures = [behaviour.measures(weights) for weights in _weights(point.seed, trials)]
    joined = {name: np.concatenate([part[name] for part in measures]) for name in measures[0]}
    rows = [(name, *interval(joined[name])) for name in joined]
    table = pd.DataFrame(rows, columns=["measure", "value", "low", "high"])
    values = {name: float(joined[name][0]) for name in joined}
    two = behaviour.hypotheses == 2
    caution = _caution(values, point.foreperiod_ms)
    against = "the circuit decides against the evidence" if behaviour.against_evidence() else ""
    remark = "; ".join(text for text in (remark, against, caution, _uncalibrated(values)) if text)
    table = table.assign(trials=trials, gain=point.used_gain, **{REMARK: remark})
    if two and not caution and (withheld := _withheld(values)):
        theirs = "; ".join(text for text in (remark, withheld) if text)
        table.loc[table["measure"].isin(OF_DIFFUSION), REMARK] = theirs
    return table


def _caution(values: dict[str, float], foreperiod_ms: float) -> str:
    """Return a caution about the other measures, or an empty string."""
    if decides_without_evidence(values["premature"], values["anticipatory"], foreperiod_ms):
        return "the circuit decides without evidence"
    if values["decided"] < FEWEST_DECIDED:
        return f"fewer than {FEWEST_DECIDED} trials are decided in time"
    if values["missed"] > MANY_MISSED:
        return (
            "many trials are not decided in time: accuracy and times refer to the decided ones; "
            f"{', '.join(OF_ALL)} are of all trials"
        )
    return ""


def _uncalibrated(values: dict[str, float]) -> str:
    """Return a caution about uncalibrated posteriors, or an empty string."""
    sure = miscalibrated(values["mean_posterior"], values["accuracy"], values["decided"])
    if not sure:
        return ""
    return f"the evidence is too {sure}: posteriors at the decision are not the proportion correct"


def _withheld(values: dict[str, float]) -> str:
    """Return why the parameters of a diffusion are unknown, or an empty string."""
    if values["missed"] > CUT_OFF:
        return f"{', '.join(OF_DIFFUSION)} are withheld: the deadline cuts off late decisions"
    if np.isnan(values[OF_DIFFUSION[-1]]):
        return f"{', '.join(OF_DIFFUSION)} are withheld: {NO_DIFFUSION}"
    return ""


def _weights(seed: int, trials: int) -> Iterator[Array]:
    """Yield equal weights of all trials, then bootstrap weights in batches."""
    if trials * RESAMPLES <= AT_ONCE:
        yield weights_of(trials, seed)
        return
    rng, left = stream(seed, "bootstrap"), RESAMPLES
    yield np.ones((1, trials))
    while left:
        some = min(left, max(1, AT_ONCE // trials))
        yield resampled(trials, some, rng)[1:]
        left -= some


def gathered(plan: Plan, tables: list[pd.DataFrame]) -> pd.DataFrame:
    """Return the measures of all points as one table, and warn of keys that change none."""
    rows = []
    for point, measures in zip(plan.each, tables, strict=True):
        table = measures.drop(columns="gain") if "gain" in point else measures
        for place, (key, value) in enumerate(point.items()):
            table.insert(place, key, value)
        rows.append(table)
    table = pd.concat(rows, ignore_index=True)
    for key in plan.axes:
        if _idle(table, key, list(plan.axes)):
            EditWarning.warn(
                f"no measure depends on {key}: it has no effect on the engine, or none within a "
                "trial; check its units and times"
            )
    return table


def _idle(table: pd.DataFrame, key: str, axes: list[str]) -> bool:
    """Whether points that differ only in a key have the same measures."""
    known = table[table["value"].notna()]
    others = ["measure", *(other for other in axes if other != key)]
    values = known.groupby(others, sort=False)["value"].agg(["size", "nunique"])
    compared = values[values["size"] > 1]
    return bool(len(compared) and (compared["nunique"] == 1).all())


@styled
def draw(plan: Plan, table: pd.DataFrame) -> Figure:
    """Draw the selected measures of a sweep over one key or two.

    Over one key, or two of which one has at most ``LINES`` values, measures are lines with 95 %
    intervals (bootstrap over trials), one per value of the key with fewer. Other grids are maps
    without intervals.
    """
    axes = plan.axes
    if len(axes) > 2:
        raise InputError(f"a figure has one key or two, got {', '.join(axes)}", "axes", axes)
    lines = len(axes) == 1 or min(map(len, axes.values())) <= LINES
    count = len(plan.show)
    figure, grid = panels(1, count, size=(max(3.4, (2.5 if lines else 3.0) * count), 2.8))
    for panel, measure in zip(grid[0], plan.show, strict=True):
        rows = table[table["measure"] == measure]
        (_lines if lines else _map)(panel, axes, rows, measure)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    if lines and len(axes) == 2:
        columns = 4 if count > 1 else 2
        figure.legend(handles, labels, loc="outside lower center", ncols=columns)
    few, most = table["trials"].min(), table["trials"].max()
    many = f"{most}" if few == most else f"{few} to {most}"
    bars = "; bars: 95 % intervals" if lines else ""
    marked = "; *: see remark in the table" if (table[REMARK] != "").any() else ""
    figure.suptitle(
        f"{plan.name or plan.circuit}\n{many} trials per point{bars}{marked}", x=0.01, ha="left"
    )
    return figure


def _places(values: list[Any]) -> list[float]:
    """Return the positions of values on an axis: numbers at their values, names side by side."""
    if all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in values):
        return [float(v) for v in values]
    return [float(k) for k in range(len(values))]


def _label(key: str) -> str:
    """Return the axis label of a key."""
    verb = VERBS.get(key.partition(" ")[0])
    return f"{key} (fraction)" if verb is not None and verb.takes == FRACTION else key


def _lines(panel: Axes, axes: dict[str, list[Any]], rows: pd.DataFrame, measure: str) -> None:
    """Draw a measure over the key with more values, a line per value of the other."""
    across = max(axes, key=lambda key: len(axes[key]))
    (other,) = [key for key in axes if key != across] or [""]
    places = _places(axes[across])
    spread = 0.0
    if other:
        apart = np.ptp(places) / max(1, len(places) - 1) or 1.0
        spread = 0.06 * apart
    for k, value in enumerate(axes.get(other, [None])):
        here = rows[rows[other] == value] if other else rows
        shift = spread * (k - (len(axes.get(other, [None])) - 1) / 2)
        place = [places[axes[across].index(each)] + shift for each in here[across]]
        order = np.argsort(place)
        ends = np.abs(here[["low", "high"]].to_numpy() - here[["value"]].to_numpy()).T
        style = {**look(k), "marker": MARKERS[k % len(MARKERS)], "ms": 4, "capsize": 2}
        panel.errorbar(
            np.asarray(place)[order],
            here["value"].to_numpy()[order],
            np.nan_to_num(ends[:, order]),
            elinewidth=0.8,
            label=f"{_label(other)} = {value}",
            **style,
        )
        for x, y, remark in zip(place, here["value"], here[REMARK], strict=True):
            if remark and np.isfinite(y):
                panel.annotate("*", (x, y), xytext=(4, 4), textcoords="offset points")
    if places != axes[across]:
        panel.set_xticks(places, [str(v) for v in axes[across]])
    panel.set_xlabel(_label(across))
    panel.set_ylabel(labelled(measure))


def _map(panel: Axes, axes: dict[str, list[Any]], rows: pd.DataFrame, measure: str) -> None:
    (down, rights), (across, values) = axes.items()
    seen = np.full((len(rights), len(values)), np.nan)
    marks = np.full(seen.shape, "", dtype=object)
    columns = [down, across, "value", REMARK]
    for first, second, number, remark in rows[columns].itertuples(index=False):
        place = rights.index(first), values.index(second)
        seen[place], marks[place] = number, "*" if remark else ""
    shown = panel.imshow(seen, origin="lower", aspect="auto", cmap="viridis")
    panel.figure.colorbar(shown, ax=panel, label=labelled(measure))
    panel.set_xticks(range(len(values)), [str(v) for v in values])
    panel.set_yticks(range(len(rights)), [str(v) for v in rights])
    panel.set_xlabel(_label(across))
    panel.set_ylabel(_label(down))
    if seen.size <= 60:
        middle = np.nanmean(seen) if np.isfinite(seen).any() else 0.0
        for (row, column), value in np.ndenumerate(seen):
            text = f"{value:.{2 if abs(value) < 10 else 0}f}" if np.isfinite(value) else "-"
            colour = "w" if value < middle else "k"
            text += str(marks[row, column])
            panel.text(column, row, text, ha="center", va="center", fontsize=6, color=colour)
