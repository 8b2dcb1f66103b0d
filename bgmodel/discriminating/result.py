"""The result of a search, and its figure: the information of each value of an axis, and trials."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from bgmodel.bootstrap import Z95
from bgmodel.discriminating.designs import TaskInformation, planned
from bgmodel.discriminating.sequential import FACTOR, LEAST_RIGHT
from bgmodel.discriminating.space import Sessions, Space
from bgmodel.experiments.models import DecisionModel
from bgmodel.support.files import json_text, provenance
from bgmodel.support.saved import Facts
from bgmodel.support.tables import Readable
from circuits.errors import InputError, require
from circuits.plots import GREY, PALETTE, panels, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bgmodel.experiments.experiment import Experiment

NAMES = {
    "channels": "N", "d_prime": "d'", "conflict": "conflict", "stop_nats": "stop signal, nats",
    "edits": "", "accuracy": "accuracy", "deadline_ms": "deadline, ms", "session": "session",
}  # fmt: skip
"""The label of each axis."""
LEAST_NATS = 1e-5
"""Information is drawn from here on."""
WIDE = 300.0
"""Ratio of the ends of an axis with few ticks."""


def label(axis: str, value: str) -> str:
    """Return the label of a value of an axis."""
    return "no manipulation" if value == "none" else f"{NAMES[axis]} {value}".strip()


@styled
def draw(rows: pd.DataFrame, sequential: pd.DataFrame, title: str) -> Figure:
    """Draw a map of the space, and the trials that the best task needs."""
    # An axis of one value is no axis.
    several = rows[rows.groupby("axis")["value"].transform("size") > 1]
    rows = several if len(several) else rows
    figure, axes = panels(1, 2, size=(7.4, 0.2 * len(rows) + 1.5), width_ratios=[1.4, 1])
    draw_map(axes[0, 0], rows)
    draw_trials(axes[0, 1], sequential)
    for ax, name in zip(axes[0], "ab", strict=True):
        ax.set_title(name, loc="left", fontweight="bold")
    _legend(figure)
    figure.suptitle(title, x=0.01, ha="left")
    return figure


def _legend(figure: Figure) -> None:
    """Explain points, lines and crosses."""
    from matplotlib.lines import Line2D

    predicted = "Predicted, with 95 % interval (in a its lower end)"
    figure.legend(
        handles=[
            Line2D([], [], color=GREY, lw=1, marker="o", ms=4, label=predicted),
            Line2D([], [], color="k", ls="", marker="x", ms=6, label="Simulated experiments"),
        ],
        loc="outside lower center", ncols=2, fontsize=7,
    )  # fmt: skip


def draw_map(ax: Axes, rows: pd.DataFrame) -> None:
    """Draw the best task's information at each value of each axis, with its lower 95 % bound."""
    nats = np.maximum(rows["nats"], LEAST_NATS)
    low = np.maximum(rows["low"], LEAST_NATS)
    y = np.arange(len(rows))
    ax.hlines(y, low, nats, color=GREY, lw=1)
    ax.plot(nats, y, "o", ms=4, color=PALETTE[0])
    for start in np.flatnonzero(rows["axis"].ne(rows["axis"].shift()))[1:]:
        ax.axhline(start - 0.5, color="0.85", lw=0.6)
    names = [label(row["axis"], row["value"]) for row in rows.to_dict("records")]
    ax.set_yticks(y, [fill(name, 28) for name in names])
    _log_axis(ax, low.min() / 2, nats.max() * 2)
    ax.set(ylim=(len(rows) - 0.5, -0.5), xlabel="Most information per trial (nats)")


def draw_trials(ax: Axes, sequential: pd.DataFrame) -> None:
    """Draw predicted and simulated numbers of trials, for either model being true."""
    known = np.isfinite(sequential["median"])
    if known.any():
        ends = sequential.loc[known, ["low", "high", "simulated_median"]]
        _log_axis(ax, ends.min().min() / 2, ends.max().max() * 2)
    else:
        ax.set_xticks([])
    for y, row in enumerate(sequential.to_dict("records")):
        style: dict[str, Any] = {"color": PALETTE[y % len(PALETTE)]}
        if known.iloc[y]:
            ax.hlines(y, row["low"], row["high"], lw=2, **style)
            ax.plot(row["median"], y, "o", ms=5, **style)
            ax.plot(row["simulated_median"], y, "kx", ms=6)
        else:
            text = f"more than {row['low']:,.0f}" if np.isfinite(row["low"]) else "no number"
            ax.text(0.03, y, text, transform=ax.get_yaxis_transform(), va="center", fontsize=7)
    names = [fill(f"{name} true", 24) for name in sequential["truth"]]
    ax.set_yticks(range(len(sequential)), names)
    ax.set(ylim=(len(sequential) - 0.5, -0.5), xlabel=f"Trials until a Bayes factor of {FACTOR:g}")


def _log_axis(ax: Axes, *ends: float) -> None:
    """Give a logarithmic axis ticks at 1, 2 and 5, or at 1 if it is wide."""
    from matplotlib.ticker import FuncFormatter, LogLocator

    low, high = ends
    ax.set_xscale("log")
    ax.set_xlim(low, high)
    subs = (1,) if high > WIDE * low else (1, 2, 5)
    ax.xaxis.set_major_locator(LogLocator(subs=subs, numticks=8))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    ax.minorticks_off()


SEPARABLE, INSEPARABLE = "can be told apart", "cannot tell"
"""Verdicts."""
UNRECORDED = "must not be given with a plan: an experiment measures choices and times, not spikes"


@dataclass(frozen=True, repr=False)
class Discrimination(Facts):
    """What tells two models apart.

    Parameters
    ----------
    models : tuple of DecisionModel
        The first and the second model; of encodings of recorded cells the names alone.
    space : Space or Sessions
        The tasks that both can be in, or the sessions in which cells were recorded.
    table : DataFrame
        One row per task that was tried: channels, d_prime, conflict, stop_nats, edits, accuracy,
        deadline_ms; or per session: session, cells, trials. Then first_nats and first_error, the
        information per trial if the first model is true, with its standard error; second_nats and
        second_error; nats, the smaller of both, and low, its lower end, by which tasks are ranked.
    check : TaskInformation
        The best task, simulated again with another seed, or all sessions together.
    sequential : DataFrame
        One row per model: truth (the model that makes the trials), nats and error, the median
        number of trials until a Bayes factor of 10 with its 95 % interval (median, low, high),
        Wald's mean (wald_mean), and the median of simulated experiments with the share that end in
        favour of the truth (simulated_median, right, experiments).
    same : tuple of int
        Numbers of alternatives at which the models are one rule with different thresholds.
    settings : dict
        Options of the search, what was left out of the space, and tasks that could not be run.
    """

    models: tuple[DecisionModel, DecisionModel]
    space: Space | Sessions
    table: pd.DataFrame
    check: TaskInformation[Any]
    sequential: pd.DataFrame
    same: tuple[int, ...]
    settings: dict[str, Any]

    @property
    def verdict(self) -> str:
        """``SEPARABLE``, if the check of the best task tells in both directions, or not."""
        return SEPARABLE if np.isfinite(self.sequential["median"]).all() else INSEPARABLE

    @property
    def most_nats(self) -> float:
        """Largest upper end (95 %) of the information per trial over all tasks tried, nats.

        It is 0 at numbers of alternatives at which the models are one rule.
        """
        table = self.table
        if self.same:
            table = table[~table["channels"].isin(self.same)]
        ends = [
            np.maximum(table[f"{way}_nats"], 0) + Z95 * table[f"{way}_error"]
            for way in ("first", "second")
        ]
        return float(np.max(ends, initial=0.0))

    @property
    def one_rule(self) -> bool:
        """Whether the models are one rule in every task, so that none can tell them apart."""
        return isinstance(self.space, Space) and set(self.same) == set(self.space.channels)

    def facts(self) -> dict[str, str]:
        """Return the models, the verdict, the best task and the trials that it needs."""
        names = {"first": self.models[0].name, "second": self.models[1].name}
        return names | {"verdict": self.sentence(), "best": self.check.design.text()}

    def sentence(self) -> str:
        """Return the verdict in one sentence, with the trials needed or the bound."""
        if self.one_rule:
            return f"{INSEPARABLE}: they are one rule with different thresholds, so no task can"
        if self.verdict == INSEPARABLE:
            least, right = self.sequential[["low", "right"]].min()
            if isinstance(self.space, Sessions) and right < LEAST_RIGHT:
                return (
                    f"{INSEPARABLE}: after a pilot of this size {100 * (1 - right):.0f} % of "
                    "simulated experiments favour the false encoding; record a longer pilot"
                )
            return (
                f"{INSEPARABLE}: no {self.space.unit} of {len(self.table)} tells more than "
                f"{self.most_nats:.1g} nats per trial (upper 95 %), and at least {_number(least)} "
                "trials are needed"
            )
        parts = [
            f"{_number(one['median'])} [{_number(one['low'])}, {_number(one['high'])}] trials if "
            f"{one['truth']} is true"
            for one in self.sequential.to_dict("records")
        ]
        return f"{SEPARABLE}: {', '.join(parts)}"

    def summary(self) -> pd.DataFrame:
        """Return the trials that the best task needs; see ``sequential``."""
        return Readable(self.sequential)

    def to_dataframe(self) -> pd.DataFrame:
        """Return ``table``."""
        return self.table

    def axes(self) -> pd.DataFrame:
        """Return a map of the space: what the best task with each value of each axis tells.

        Of recorded cells the only axis is the session.

        Columns axis, value, tried (number of tasks), and nats and low of the best of them.
        """
        rows = []
        for name in self.space.axis_names:
            for value, part in self.table.groupby(name, sort=name != "edits"):
                text = name in ("edits", "session")
                shown = (str(value) or "none") if text else f"{value:g}"
                best = part.iloc[int(part["low"].argmax())]
                best_nats = {"tried": len(part), "nats": best["nats"], "low": best["low"]}
                rows.append({"axis": name, "value": shown, **best_nats})
        return pd.DataFrame(rows)

    def text(self) -> str:
        """Return the report that the command prints."""
        shown = self.table.nlargest(8, "low").round(4).to_string(index=False)
        parts = [
            f"{self.models[0].name} against {self.models[1].name}: {self.sentence()}",
            f"best task: {self.check.design.text()}",
        ]
        check = "trials until a Bayes factor of 10, from the check of the best task; nats per trial"
        tried = "the best tasks of the search; values of the best are too good, hence the check"
        if pilots := self.settings.get("pilots"):
            parts[1] = f"recorded: {self.check.design.text()}; fits to {pilots} simulated pilots"
            check = "further trials until a Bayes factor of 10; nats per trial"
            tried = "the sessions that tell most"
        else:
            parts.append(
                f"thresholds {self.settings['thresholds']}, non-decision time "
                f"{self.settings['non_decision']}; {len(self.table)} tasks tried"
            )
        if recorded := self.settings["recording"]:
            window = "{:g} to {:g} ms".format(*recorded["window_ms"])
            cells = f"{recorded['cells']} cell{'s' if recorded['cells'] > 1 else ''}"
            parts.append(f"recorded: spikes of {cells} of {recorded['nucleus']}, {window}")
        if self.same:
            numbers = ", ".join(f"N = {n}" for n in self.same)
            parts.append(f"one rule with different thresholds at {numbers}")
        if self.settings["left_out"]:
            parts.append(f"left out of the space: {', '.join(self.settings['left_out'])}")
        if self.settings["refused"]:
            parts.append(f"{len(self.settings['refused'])} kinds of trials could not be run")
        table = self.sequential.round(4).to_string(index=False)
        return "\n".join([*parts, "", check, table, "", tried, shown])

    def experiment(self, folder: str | Path = ".") -> Experiment:
        """Return the best task as an experiment, in which the second model is the manipulation.

        Parameters
        ----------
        folder : path
            Folder of the experiment's file, from which the path of a circuit's file is given.

        Raises
        ------
        ValueError
            If a model is a test, if no edits turn one circuit into the other, or if cells are
            recorded, which experiments do not support.
        """
        recording = self.settings["recording"]
        require(not recording, "recording", UNRECORDED, recording)
        if not isinstance(self.space, Space):
            raise InputError(f"recorded {UNRECORDED}", "recorded")
        median = float(self.sequential["median"].max())
        return planned(
            self.models, self.check, self.space, median, self.sentence(),
            self.settings["check_seed"], folder,
        )  # fmt: skip

    def plot(self) -> Figure:
        """Draw a map of the space, and the trials that the best task needs."""
        title = f"{self.models[0].name} against {self.models[1].name}: {self.verdict}"
        return draw(self.axes(), self.sequential, title)

    def to_json(self, path: str | Path | None = None) -> str:
        """Return the result as JSON, with settings, seeds and versions; write it to a path."""
        rest = {name: value for name, value in self.settings.items() if name != "seed"}
        about = provenance(self.settings["seed"], **rest, space=self.space)
        tables = {"sequential": self.sequential, "axes": self.axes(), "records": self.table}
        return json_text({**self.facts(), **about, **tables}, path)


def _number(count: float) -> str:
    """Return a number of trials with three digits."""
    return f"{float(f'{count:.3g}'):,.0f}" if np.isfinite(count) else "infinitely many"
