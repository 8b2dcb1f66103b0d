"""Figure G1: a stop signal in one trial, in spikes, and the closed form of the response to it."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bgmodel import Evidence, stream
from bgmodel.deciding.decision import first_crossing
from bgmodel.deciding.trace import Trace
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.simulated_evidence import gaussian_evidence
from bgmodel.stopping.circuit import closed_form, receiving, step_response
from bgmodel.stopping.inputs import StopSignal, with_stop
from bgmodel.support.files import read_table, write_table
from circuits.anatomy import DEFAULT, load_circuit
from circuits.engines import Ensemble
from circuits.errors import EditWarning
from figures.common import Settings, key, letter, run, where

POSTERIOR, D_PRIME, READINGS, STEP_MS = 0.82, 0.35, 90, 10.0
SSD_MS, END_MS, SHOWN_MS = 300.0, 400.0, 850.0
"""Stop-signal delay; end of the panel of c, and of the panels of the trial."""
RESPONDS_MS = 450.0
"""About the response time, without a signal, of the trial that is shown."""
SIGNALS = {
    "0.3 nats": ("C4", 0.3, np.inf),
    "0.5 nats": ("C2", 0.5, np.inf),
    "1 nat": ("C1", 1.0, np.inf),
    "1 nat for 100 ms": ("C3", 1.0, 100.0),
}
"""Colour, nats and duration of each signal, by label."""
TRIAL = "1 nat"
NUCLEI, CELLS, BAND = ("STN", "SNr"), 30, 38
FROM_ONSET = "time from the onset of evidence (ms)"
GO, STOP, CLOSED = "no signal", "stop signal", "closed form"
LINES: dict[str, dict[str, Any]] = {
    GO: {"color": "C0"}, STOP: {"color": "C1"},
    CLOSED: {"color": "k", "ls": "--", "lw": 1.0, "zorder": 3},
}  # fmt: skip


def signal_of(name: str) -> StopSignal:
    """Return a signal by its label."""
    _, nats, lasts = SIGNALS[name]
    with warnings.catch_warnings():
        # A pulse cancels nothing, as is shown.
        warnings.simplefilter("ignore", EditWarning)
        return StopSignal(amount_nats=nats, duration_ms=lasts)


def compute(settings: Settings, *, output: Path) -> None:
    """Run trials without and with each signal, in spikes, and c in rates without noise.

    Columns panel (out, spike, response, c or mean), name, time_ms and value: nats, or the number of
    a neuron of the chosen alternative's channel, whose nucleus is in the name.
    """
    model = BasalGanglia(load_circuit(DEFAULT), Ensemble(rates=False), seed=settings.seed)
    rng, trials = stream(settings.seed, "figG1"), max(settings.circuit_trials // 10, 12)
    given: dict[str, Any] = {"d_prime": D_PRIME, "t_max": READINGS, "step_ms": STEP_MS}
    evidence = gaussian_evidence(trials, seed=rng, **given)
    level = model.threshold(None, POSTERIOR)
    went = model.run(evidence)
    parts = [pd.DataFrame({"panel": "level", "name": "", "time_ms": 0.0, "value": [level]})]
    for name in SIGNALS:
        parts += _response(model, evidence, went, name)
    parts += _trial(model, evidence, went, level)
    write_table(pd.concat(parts), output, seed=settings.seed, settings=settings)


def with_signal(model: BasalGanglia, evidence: Evidence, name: str) -> tuple[Any, Evidence]:
    """Return a model with an input for the signal, and evidence with the signal."""
    signal = signal_of(name)
    given = with_stop(evidence, np.full(evidence.trials, SSD_MS), signal)
    return receiving(model, signal), given


def _response(
    model: BasalGanglia, evidence: Evidence, went: Trace, name: str
) -> list[pd.DataFrame]:
    """Return c, and the mean change of OUT of the leader in spikes, with its standard error."""
    time, added = step_response(model, signal_of(name), time_ms=END_MS)
    stopped, given = with_signal(model, evidence, name)
    change = stopped.run(given).out_nats - went.out_nats
    leader = went.out_nats.mean(axis=1).argmin(axis=1)
    change = np.take_along_axis(change, leader[:, None, None], axis=2)[..., 0]
    since = went.time_ms - SSD_MS
    # Every 20 ms; means of neighbouring samples would blur the step.
    shown = (since > 0) & (since <= END_MS) & (np.arange(len(since)) % 20 == 0)
    drawn = change[:, shown]
    error = drawn.std(axis=0) / np.sqrt(len(drawn))
    return [
        pd.DataFrame({"panel": "c", "name": name, "time_ms": time, "value": added}),
        pd.DataFrame({"panel": "mean", "name": name, "time_ms": since[shown],
                      "value": drawn.mean(axis=0), "error": error}),
    ]  # fmt: skip


def _trial(
    model: BasalGanglia, evidence: Evidence, went: Trace, level: float
) -> list[pd.DataFrame]:
    """Return OUT and spikes of a trial, without and with the signal."""
    made = first_crossing(went, level, forced=False, checked=False)
    far = np.where(made.choice >= 0, np.abs(made.time_ms - RESPONDS_MS), np.inf)
    one = int(far.argmin())
    channel = int(went.out_nats[one].mean(axis=0).argmin())
    part = evidence[one : one + 1]
    recording = replace(model, engine=model.engine.recording(NUCLEI))
    stopped, given = with_signal(recording, part, TRIAL)
    parts = [pd.DataFrame({"panel": "response", "name": GO, "time_ms": [made.time_ms[one]],
                           "value": level})]  # fmt: skip
    outs = {}
    for name, who, what in ((GO, recording, part), (STOP, stopped, given)):
        activity = who.activity(what, first_trial=one)
        outs[name] = who.trace(activity, what)
        for nucleus in NUCLEI:
            spikes = (activity.spikes or {})[nucleus]
            mine = (spikes["channel"] == channel) & (spikes["neuron"] < CELLS)
            kept = spikes[mine & (spikes["time_ms"] > 0)]
            parts.append(kept[["time_ms"]].assign(
                panel="spike", name=f"{nucleus}, {name}", value=kept["neuron"].to_numpy(float)
            ))  # fmt: skip
    added = step_response(model, signal_of(TRIAL), time_ms=STEP_MS * (READINGS + 1))[1]
    outs[CLOSED] = closed_form(outs[GO], np.array([SSD_MS]), signal_of(TRIAL), added)
    for name, trace in outs.items():
        value = trace.out_nats[0, :, channel]
        parts.append(pd.DataFrame({"panel": "out", "name": name, "time_ms": trace.time_ms,
                                   "value": value}))  # fmt: skip
    return parts


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw OUT and spikes of the trial, and the response of OUT to each signal."""
    table = read_table(data)
    level = where(table, panel="level")["value"].item()
    figure = plt.figure(figsize=(7.4, 4.2))
    grid = figure.add_gridspec(2, 2, width_ratios=[1.35, 1])
    out = figure.add_subplot(grid[0, 0])
    _out(out, table, level)
    letter(out, "a  one trial, in spikes")
    spikes = figure.add_subplot(grid[1, 0], sharex=out)
    _rasters(spikes, table)
    letter(spikes, f"b  spikes of {CELLS} cells of the leading channel")
    response = figure.add_subplot(grid[:, 1])
    _responses(response, table, level)
    letter(response, "c  response of OUT to a stop signal")
    key(figure, out, ncols=3)
    return figure


def _out(ax: Axes, table: pd.DataFrame, level: float) -> None:
    for name, style in LINES.items():
        rows = where(table, panel="out", name=name)
        ax.plot(rows["time_ms"], rows["value"], label=f"OUT, {name}", **style)
    ax.axhline(level, color="0.6", lw=0.8, ls=":", zorder=0)
    ax.axvline(SSD_MS, color="C1", lw=0.8, ls=":", zorder=0)
    ax.annotate("threshold", (SHOWN_MS, level), (0, 2), textcoords="offset points", ha="right",
                fontsize=7, color="0.4")  # fmt: skip
    response = where(table, panel="response")
    ax.plot(response["time_ms"], response["value"], "o", ms=5, color=LINES[GO]["color"])
    ax.set(xlim=(0, SHOWN_MS), ylim=(-0.05, None), ylabel="OUT of the leader (nats)")
    ax.tick_params(labelbottom=False)


def _rasters(ax: Axes, table: pd.DataFrame) -> None:
    """Show the spikes of each nucleus without and with the signal, one band each."""
    bands = [(nucleus, kind) for nucleus in NUCLEI for kind in (GO, STOP)]
    for k, (nucleus, kind) in enumerate(bands):
        rows = where(table, panel="spike", name=f"{nucleus}, {kind}")
        at = rows["value"] - k * BAND
        ax.plot(rows["time_ms"], at, "|", ms=1.6, mew=0.6, color=LINES[kind]["color"])
    ax.axvline(SSD_MS, color="C1", lw=0.8, ls=":", zorder=0)
    middles = [CELLS / 2 - k * BAND for k in range(len(bands))]
    ax.set_yticks(middles, [f"{n},\n{k}" for n, k in bands], fontsize=7)
    ax.tick_params(left=False)
    ax.spines["left"].set_visible(False)
    ax.set(ylim=(-(len(bands) - 1) * BAND - 2, CELLS + 1), xlabel=FROM_ONSET)


def _responses(ax: Axes, table: pd.DataFrame, level: float) -> None:
    """Show c in rates, as lines, and the mean change of OUT in spikes, as points."""
    for name, (colour, *_) in SIGNALS.items():
        rows = where(table, panel="c", name=name)
        ax.plot(rows["time_ms"], rows["value"], color=colour, label=name)
        seen = where(table, panel="mean", name=name)
        ax.errorbar(seen["time_ms"], seen["value"], 1.96 * seen["error"], fmt="o", ms=2, lw=0.6,
                    color=colour)  # fmt: skip
    ax.axhline(level, color="0.6", lw=0.8, ls=":", zorder=0)
    ax.annotate("threshold", (END_MS, level), (0, 2), textcoords="offset points", ha="right",
                fontsize=7, color="0.4")  # fmt: skip
    ax.legend(title="input to STN", loc="upper right", bbox_to_anchor=(1, 0.9))
    ax.set(xlabel="time from the stop signal (ms)", ylabel="c(t): change of OUT (nats)")
    ax.set(xlim=(0, END_MS))


if __name__ == "__main__":
    run(compute=compute, draw=draw)
