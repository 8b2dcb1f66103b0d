"""Figure C2: one decision of the spiking circuit, and its mean rates over many decisions.

Single-trial rates are smoothed, which removes GPe's rhythm near 33 Hz; the raster shows it, and so
do the response-aligned means, in bins of 5 ms.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from scipy.ndimage import gaussian_filter1d

from bgmodel import Decision, Evidence, Msprt, Trace, first_crossing, stream
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.simulated_evidence import gaussian_evidence
from bgmodel.support.files import read_table, write_table
from circuits.anatomy import DEFAULT, load_circuit
from circuits.engines import Ensemble
from circuits.plots import channel_lines, raster
from figures.common import GAIN, Settings, letter, run

CIRCUIT = load_circuit(DEFAULT, 4)
NUCLEI = ("ctx", "D1", "D2", "STN", "GPe", "SNr")
D_PRIME, READINGS, STEP_MS = 0.5, 40, 50.0
THRESHOLD_NATS = -np.log(0.85)
SAMPLE_MS = 5.0
CELLS = 30
SMOOTH_MS = 15.0
BEFORE_MS, AFTER_MS = 500, 200
END_MS = (READINGS + 1) * STEP_MS
OUT_SHOWN = 2.4
NARROW = {"handlelength": 1.6, "columnspacing": 1, "handletextpad": 0.4}


def compute(settings: Settings, *, output: Path) -> None:
    """Follow the first trial in full, and average all of them."""
    given: dict[str, Any] = {"d_prime": D_PRIME, "t_max": READINGS, "step_ms": STEP_MS}
    rng, trials = stream(settings.seed, "figC2"), settings.circuit_trials // 3
    evidence = gaussian_evidence(trials, channels=CIRCUIT.channels, seed=rng, **given)
    model = BasalGanglia(CIRCUIT, Ensemble(sample_ms=SAMPLE_MS), GAIN, settings.seed)
    table = pd.concat([one_trial(model, evidence[:1]), averages(model, evidence)])
    write_table(table, output, seed=settings.seed, settings=settings)


def one_trial(model: BasalGanglia, evidence: Evidence) -> pd.DataFrame:
    """Return the data of a single trial: columns panel, name, channel, time_ms and value.

    Panels are evidence (nats), spike (value is the neuron), rate (Hz, smoothed), out (nats; name is
    circuit or MSPRT) and decision.
    """
    activity = replace(model, engine=model.engine.recording(NUCLEI)).activity(evidence)
    total = evidence.own_totals[0]
    parts = [_long("evidence", "L", np.arange(len(total)) * evidence.step_ms, total)]
    for name in NUCLEI:
        spikes = (activity.spikes or {})[name]
        shown = spikes[(spikes["neuron"] < CELLS) & (spikes["time_ms"] > 0)]
        parts.append(
            shown[["channel", "time_ms"]].assign(panel="spike", name=name, value=shown["neuron"])
        )
        rates = gaussian_filter1d(activity.rates_hz[name][0], SMOOTH_MS / SAMPLE_MS, axis=0)
        parts.append(_long("rate", name, activity.time_ms, rates))
    traces = {"circuit": model.trace(activity, evidence), "MSPRT": Msprt(GAIN).run(evidence)}
    for name, trace in traces.items():
        parts.append(_long("out", name, trace.time_ms, trace.out_nats[0]))
        decided = decide(trace)
        row = {"channel": decided.choice, "time_ms": decided.time_ms, "value": THRESHOLD_NATS}
        parts.append(pd.DataFrame(row).assign(panel="decision", name=name))
    return pd.concat(parts)


def averages(model: BasalGanglia, evidence: Evidence) -> pd.DataFrame:
    """Return mean rates of the chosen channel (0) and of the others (1), in the same columns.

    Panels are onset, all trials, those without a response by their lowest OUT at the end; response,
    those that responded; and trials, how many that were.
    """
    activity = model.activity(evidence)
    trace = model.trace(activity, evidence)
    choice = first_crossing(trace, THRESHOLD_NATS).choice
    decided = decide(trace)
    done = np.flatnonzero(decided.choice >= 0)
    last = np.rint(decided.time_ms[done] / SAMPLE_MS).astype(int)
    around = np.arange(-round(BEFORE_MS / SAMPLE_MS), round(AFTER_MS / SAMPLE_MS) + 1)
    counts = {"name": ["onset", "response"], "value": [float(evidence.trials), float(len(done))]}
    parts = [pd.DataFrame(counts).assign(panel="trials", channel=0, time_ms=0.0)]
    for name in NUCLEI:
        pairs = chosen_and_others(activity.rates_hz[name], choice)
        parts.append(_long("onset", name, activity.time_ms, pairs.mean(axis=0)))
        # Sample k ends at (k + 1) sample_ms; samples beyond the trial are missing.
        at = last[:, None] - 1 + around
        there = (at >= 0) & (at < pairs.shape[1])
        cut = pairs[done[:, None], np.where(there, at, 0)]
        cut[~there] = np.nan
        if len(done):
            parts.append(_long("response", name, around * SAMPLE_MS, np.nanmean(cut, axis=0)))
    return pd.concat(parts)


def chosen_and_others(rates: npt.NDArray[Any], choice: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return rates (trials, ticks, 2) of the chosen channel and the mean of the others."""
    chosen = np.take_along_axis(rates, choice[:, None, None], axis=2)[..., 0].astype(np.float64)
    others = (rates.sum(axis=2, dtype=np.float64) - chosen) / (rates.shape[2] - 1)
    return np.stack([chosen, others], axis=2)


def decide(trace: Trace) -> Decision:
    """Return decisions by threshold crossing only, without forced choices."""
    return first_crossing(trace, THRESHOLD_NATS, forced=False)


def _long(panel: str, name: str, time_ms: npt.ArrayLike, values: npt.ArrayLike) -> pd.DataFrame:
    """Return values (ticks, channels) as rows."""
    values = np.asarray(values)
    ticks, count = values.shape
    return pd.DataFrame(
        {
            "panel": panel,
            "name": name,
            "channel": np.tile(np.arange(count), ticks),
            "time_ms": np.repeat(np.asarray(time_ms), count),
            "value": values.ravel(),
        }
    )


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw the trial from evidence to OUT, and below it one row per nucleus."""
    panels = {str(kind): part for kind, part in read_table(data).groupby("panel")}
    tight = ConstrainedLayoutEngine(h_pad=0.02, hspace=0.01)
    figure = plt.figure(figsize=(7.2, 6.2), layout=tight)
    grid = figure.add_gridspec(
        1 + len(NUCLEI), 4, height_ratios=[2.1] + [1] * len(NUCLEI), width_ratios=[2, 1.3, 1, 1]
    )
    evidence, out = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1:])
    _evidence(evidence, panels)
    _out(out, panels["out"], panels["decision"])
    lettered = [evidence, out]
    for k, name in enumerate(NUCLEI):
        first, rates = figure.add_subplot(grid[k + 1, 0]), figure.add_subplot(grid[k + 1, 1])
        averaged = [figure.add_subplot(grid[k + 1, i], sharey=rates) for i in (2, 3)]
        row = [first, rates, *averaged]
        _nucleus(row, {kind: part[part["name"] == name] for kind, part in panels.items()})
        first.set_ylabel(name, rotation=0, ha="right", va="center", fontweight="bold")
        _axes(row, last=k == len(NUCLEI) - 1)
        lettered += row if k == 0 else []
        if name == "GPe":
            # Below the lines.
            tightly = {"borderaxespad": 0, "borderpad": 0.1, "labelspacing": 0.1}
            averaged[0].legend(loc="lower right", handlelength=1, **tightly)
        _marks(row[:2], panels["decision"])
    _marks([evidence, out], panels["decision"])
    counts = panels["trials"].set_index("name")["value"].astype(int)
    titles = (
        "a  evidence of one trial",
        "b  OUT of the same trial",
        f"c  spikes, {CELLS} cells per channel",
        "d  rates (Hz)",
        f"e  {counts['onset']} trials",
        f"f  {counts['response']} responses",
    )
    for ax, title in zip(lettered, titles, strict=True):
        letter(ax, title)
    return figure


def _evidence(ax: Any, panels: dict[str, pd.DataFrame]) -> None:
    channel_lines(ax, panels["evidence"], steps=True, lw=1.1)
    # The first trial of separated_evidence belongs to the first hypothesis.
    names = ["channel 1 (true)", *map(str, range(2, CIRCUIT.channels + 1))]
    boxed = {"frameon": True, "edgecolor": "none", "framealpha": 1, "borderpad": 0.1}
    ax.legend(ax.lines, names, ncols=CIRCUIT.channels, loc="upper left", **NARROW, **boxed)
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + 0.15 * (high - low))
    ax.set(ylabel="evidence (nats)", xlabel="time from onset (ms)", xlim=(0, END_MS))


def _out(ax: Any, traces: pd.DataFrame, decisions: pd.DataFrame) -> None:
    for name, style in (("circuit", {"lw": 1.2}), ("MSPRT", {"ls": "--", "lw": 0.9})):
        here = traces[traces["name"] == name]
        channel_lines(ax, here, steps=name == "MSPRT", **style)
        ax.plot([], [], color="0.3", label=name, **style)
    ax.axhline(THRESHOLD_NATS, color="k", lw=0.8, ls=":", label="threshold −ln 0.85")
    ax.plot(decisions["time_ms"], decisions["value"], "ko", ms=3.5, zorder=3, label="decision")
    beyond = {"color": "0.94", "lw": 0, "zorder": 0, "label": "outside the readable range"}
    ax.axhspan(CIRCUIT.readable_nats[1], OUT_SHOWN, **beyond)
    ax.set(ylabel=f"OUT (nats, gain {GAIN:g})", xlabel="time from onset (ms)", xlim=(0, END_MS))
    ax.set_ylim(0, OUT_SHOWN)
    # Below the other channels, right of both decisions.
    ax.legend(loc="lower right", bbox_to_anchor=(1.0, 0.09), **NARROW)


def _nucleus(row: list[Any], panels: dict[str, pd.DataFrame]) -> None:
    spikes = panels["spike"].rename(columns={"value": "neuron"})
    raster(row[0], spikes, channels=CIRCUIT.channels, neurons=CELLS)
    channel_lines(row[1], panels["rate"], lw=0.9)
    for ax, kind in zip(row[2:], ("onset", "response"), strict=True):
        for channel, (colour, label) in enumerate((("k", "chosen"), ("0.6", "others"))):
            one = panels[kind][panels[kind]["channel"] == channel]
            ax.plot(one["time_ms"], one["value"], color=colour, lw=0.9, label=label)
    row[3].axvline(0, color="k", lw=0.8)


def _axes(row: list[Any], *, last: bool) -> None:
    for ax in row[:3]:
        ax.set(xlim=(0, END_MS), xticks=[0, 1000, 2000])
    row[0].set_xticks([0, 500, 1000, 1500, 2000])
    row[3].set(xlim=(-BEFORE_MS, AFTER_MS), xticks=[-400, 0])
    row[1].set_ylim(0, None)
    row[1].locator_params(axis="y", nbins=3)
    for ax in row[2:]:
        ax.tick_params(labelleft=False)
    for ax, what in zip(row, ("onset", "onset", "onset", "response"), strict=True):
        ax.tick_params(labelbottom=last)
        if last:
            ax.set_xlabel(f"time from {what} (ms)" if ax is row[0] else f"from {what} (ms)")


def _marks(axes: list[Any], decisions: pd.DataFrame) -> None:
    for ax in axes:
        for name, time_ms in zip(decisions["name"], decisions["time_ms"], strict=True):
            ax.axvline(time_ms, color="k", lw=0.8, ls="--" if name == "MSPRT" else "-")


if __name__ == "__main__":
    run(compute=compute, draw=draw)
