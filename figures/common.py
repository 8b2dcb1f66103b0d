"""Code shared by all figures: settings, captions, steps, and saving of pictures."""

from __future__ import annotations

import inspect
import os
import signal
import traceback
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from importlib import import_module
from multiprocessing import parent_process
from pathlib import Path
from threading import Thread
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from bgmodel.support.files import replacing
from bgmodel.tactile.pressing import PERIODS_MM
from circuits.anatomy import DEFAULT, load_circuit
from circuits.declaration.table_writer import identity
from figures.rooms import Caption, origin, rooms
from figures.stamps import KEY, Stamp, stamp_of

mpl.use("Agg")
COLOUR = {1.5: "C0", 2.0: "C1", 2.5: "C2"}
# For circuits that are edited many times over. Each starts at its own rest: a third of the usual
# time to settle will do.
BRIEF_MS = 100.0
STYLE = Path(__file__).with_name("style.mplstyle")


@dataclass(frozen=True)
class Settings:
    """Parameters of the figures."""

    seed: int = 2023
    # Not printed in the paper.  t_max lets 1.5 mm integrate without limit on the others; xi puts
    # the optimum of 1.5 and of 2.0 mm inside 0..8 nats (figure 5c shows how it moves).
    t_max: int = 30
    xi: float = 50.0
    training_taps: int = 1000
    held_out_taps: int = 1200
    orientation_taps: int = 200
    epochs: int = 8
    search_trials: int = 1_400_000
    sweep_trials: int = 12_000
    repeats: int = 10
    episodes: int = 40_000
    delta_step: float = 0.1
    circuit_trials: int = 300
    varied_trials: int = 100
    # Number of changes of the circuit's numbers: those that move its fixed point most.
    varied: int = 40
    # Of these, the number also made in spikes.
    varied_in_spikes: int = 3
    # Cells of figure C4, over those of the table.
    most_cells: float = 3.0
    # Step between levels of figure D2 that are also run in spikes.
    spiking_levels: int = 5
    # Of a reading in figures C3 and C4 a; an easier task takes less time.
    d_prime: float = 0.6

    @property
    def separations(self) -> np.ndarray:
        """Gaps of the exhaustive search, 0..8 nats."""
        return np.linspace(0, 8, round(8 / self.delta_step) + 1)

    @property
    def periods_mm(self) -> tuple[float, ...]:
        """All gratings, mm."""
        return PERIODS_MM


FULL = Settings()
FAST = Settings(
    training_taps=500,
    held_out_taps=300,
    orientation_taps=60,
    epochs=4,
    search_trials=60_000,
    sweep_trials=3_000,
    repeats=2,
    episodes=4_000,
    delta_step=0.5,
    circuit_trials=100,
    varied_trials=100,
    varied=8,
    varied_in_spikes=2,
    most_cells=1.0,
    spiking_levels=9,
    d_prime=1.6,
)


def captions(settings: Settings) -> dict[str, Caption]:
    """Return the caption of each figure of all rooms, with the numbers of a run filled in."""
    numbers = {field.name: _shown(getattr(settings, field.name)) for field in fields(settings)}
    return {name: each for room in rooms() for name, each in room.captions(numbers).items()}


def _shown(value: float | tuple[float, ...]) -> str:
    """Return one or more numbers as text, with thousands separated and no trailing zeros."""
    if isinstance(value, tuple):
        return ", ".join(map(_shown, value))
    # No-break spaces keep a number on one line.
    return f"{value:,}".replace(",", "\u202f") if isinstance(value, int) else f"{value:g}"


def begin() -> None:
    """Start a process that runs steps; it ends only with its parent, which handles Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def end() -> None:
        parent = parent_process()
        if parent:
            parent.join()
        os._exit(1)

    Thread(target=end, daemon=True).start()


def make(script: str, step: str, inputs: Sequence[str], output: str, fast: bool) -> None:
    """Make a table or a picture by running a step of a script.

    RuntimeError if the step failed (stderr has the details), or tried to end its process, which
    other steps share.
    """
    try:
        module = script.removesuffix(".py").replace("/", ".")
        function = getattr(import_module(module), step)
        _make(function, [Path(path) for path in inputs], Path(output), fast)
    except BaseException as error:
        # In quiet mode Snakemake does not print it.
        traceback.print_exc()
        raise RuntimeError(f"{script}, step {step}") from error


def _make(step: Callable[..., Any], inputs: Sequence[Path], output: Path, fast: bool) -> None:
    # Steps share processes, so a step must not change how the next one warns or draws.
    with warnings.catch_warnings(), mpl.rc_context():
        plt.style.use(STYLE)
        settings = FAST if fast else FULL
        made = step(settings, *inputs, output=output)
        if isinstance(made, Figure):
            save(made, output, stamp_of(Path(inspect.getfile(step)), inputs, settings))


def save(figure: Figure, path: Path, stamp: Stamp) -> None:
    """Write a picture as PNG, with its stamp, and PDF, completely or not at all, without a date."""
    png = {"Software": None, KEY: stamp.text()}
    for ending, metadata in ((".pdf", {"CreationDate": None}), (".png", png)):
        with replacing(path.with_suffix(ending)) as partial:
            figure.savefig(partial, metadata=metadata)
    plt.close(figure)
    print(f"drawn: {path.with_suffix('.png')}", flush=True)


def letter(ax: Any, text: str) -> None:
    """Put a panel letter at the top left."""
    ax.set_title(text, loc="left", fontweight="bold")


def where(table: pd.DataFrame, **values: object) -> pd.DataFrame:
    """Return the rows of a table whose columns have the given values."""
    for name, value in values.items():
        table = table[table[name] == value]
    return table


def off(rows: pd.DataFrame, name: str = "value") -> np.ndarray:
    """Return the distances from values to the ends of their intervals, (2, rows)."""
    ends = ("low", "high") if name == "value" else (f"{name}_low", f"{name}_high")
    value, low, high = (rows[each].to_numpy(float) for each in (name, *ends))
    away: np.ndarray = np.maximum(np.stack([value - low, high - value]), 0)
    return away


def bars(
    ax: Any,
    at: Any,
    rows: pd.DataFrame,
    name: str = "value",
    *,
    unit: float = 1.0,
    across: bool = False,
    **style: Any,
) -> None:
    """Draw values, over ``unit``, with their intervals at positions on the other axis.

    Columns of the rows are value, low and high, or NAME, NAME_low and NAME_high. Values run
    upwards, or ``across``; the style is that of ``Axes.errorbar``.
    """
    value, away = rows[name] / unit, off(rows, name) / unit
    if across:
        ax.errorbar(value, at, xerr=away, **style)
    else:
        ax.errorbar(at, value, away, **style)


def key(figure: Figure, *axes: Any, more: Sequence[Artist] = (), **style: Any) -> None:
    """Put one legend below all panels: labels of some of them, each once, and ``more`` marks."""
    shown: dict[Any, Any] = {}
    for ax in axes:
        handles, labels = ax.get_legend_handles_labels()
        shown |= dict(zip(labels, handles, strict=True))
    shown |= {mark.get_label(): mark for mark in more}
    style = {"loc": "outside lower center"} | style
    figure.legend(list(shown.values()), list(shown), **style)


OLDER = "table made with an older circuit"
"""Note under a figure whose table was not made with the present default circuit."""


def older(table: Path) -> bool:
    """Whether any circuit that a table of a room was made with is not the present one."""
    made_with = origin(table)["parameters"]["circuits"]
    today = {key: ([DEFAULT, *key.split()][-2], int(key.split()[-1])) for key in made_with}
    return any(identity(load_circuit(*today[key])) != each for key, each in made_with.items())


def say_if_older(figure: Figure, *tables: Path) -> None:
    """Warn, and write under a figure, if one of its tables was made with an older circuit."""
    names = [table.name for table in tables if older(table)]
    if names:
        note = f"{OLDER}: {', '.join(names)}"
        warnings.warn(note, stacklevel=2)
        written = figure.supxlabel(note)
        for legend in figure.legends:
            # A legend below all panels gets the note as its title, so that they do not overlap.
            written.set_text("")
            legend.set_title(note)
            written = legend.get_title()
        written.set(color="C1", fontsize=7)
