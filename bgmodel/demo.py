"""The whole chain on shipped taps: evidence, spikes against the optimal test, reward."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from bgmodel.deciding.decision import Decision, crossing_of_each
from bgmodel.deciding.trace import Trace
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.sprt import Msprt
from bgmodel.learning.from_reward import FromReward, learn
from bgmodel.learning.reinforce import Learner
from bgmodel.plots import acquisition
from bgmodel.support.seeds import stream
from bgmodel.tactile.task import SameDifferent
from circuits.anatomy import DEFAULT, load_circuit
from circuits.engines import Plain
from circuits.plots import (
    FROM_ONSET,
    GREY,
    PALETTE,
    channel_lines,
    legend_above,
    panels,
    raster,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NUCLEI = {
    "ctx": "Cortex",
    "D1": "Striatum, D1",
    "D2": "Striatum, D2",
    "STN": "STN",
    "GPe": "GPe",
    "SNr": "SNr (output)",
}
TASK = SameDifferent(period_mm=2.0, t_max=8)
"""Are two taps of gratings, 2 mm apart, of one orientation? A reading every 50 ms."""
NAMES = ("same", "different")
"""The alternatives."""
XI, RUNS, LEARNER = 50.0, 5, Learner(episodes=2000)
"""Cost of an error (readings), number of runs of the learner, and a short course of learning."""
STEP_MS, SETTLE_MS = 0.2, 100.0
"""Step of the simulation and time before the onset, ms: twice and a third of the defaults."""
CELLS = 30
"""Cells per channel in the raster."""
TEST, CIRCUIT = "MSPRT", "circuit"


@dataclass(frozen=True)
class Demo:
    """A threshold learned from reward, and one trial decided with it by spikes and by the test."""

    learned: FromReward  # the boundary separation that reward taught the optimal test
    evidence: Evidence  # readings of one trial of taps
    spikes: dict[str, pd.DataFrame]  # by nucleus: channel, neuron and time_ms
    traces: dict[str, Trace]  # OUT of "circuit" and "MSPRT", nats
    decisions: dict[str, Decision]  # of both; they may be undecided at the end of the readings
    threshold_nats: float  # on OUT of both: the learned separation, at the circuit's gain
    readable_nats: float  # highest OUT within the range of the read-out
    gain: float  # nats in the circuit per nat of evidence; the same for the test

    def summary(self) -> str:
        """Return a description of the chain in a few sentences."""
        test, spikes = (self._outcome(name) for name in (TEST, CIRCUIT))
        separation = self.learned.learned.mean()
        posterior = np.exp(-self.threshold_nats)
        return (
            "A simulated TacTip taps gratings, a neural network decodes the angle of each tap, and "
            "the log-likelihoods of the angles are the evidence: are two gratings the same or "
            f"different? One reading every {TASK.step_ms:g} ms.\n"
            f"Reward, minus the readings taken and minus {XI:g} for an error, taught the optimal "
            f"test to decide at a boundary separation of {separation:.2f} nats (best "
            f"{self.learned.best:.2f}; excess cost {self.learned.regret:.1f} %). At the circuit's "
            f"gain of {self.gain:.2g} that is a posterior of {posterior:.2f}.\n"
            f"On one trial with this threshold the test {test}; the spiking circuit, on the same "
            f"readings, {spikes}. OUT is the firing rate of SNr in nats: for the leading "
            "alternative it follows the test's -ln P. Use --seed N for another trial."
        )

    def _outcome(self, name: str) -> str:
        choice, time_ms = int(self.decisions[name].choice[0]), self.decisions[name].time_ms[0]
        if choice < 0:
            return "made no choice before the end"
        truth = np.asarray(self.evidence.truth)[0]
        right = "right" if choice == truth else "wrong"
        return f"chose {NAMES[choice]!r} ({right}) after {time_ms:.0f} ms"


def demo(seed: int = 1) -> Demo:
    """Let reward teach a threshold on shipped taps, and decide one trial with it.

    Parameters
    ----------
    seed : int
        Seed of the evidence, of learning and of the noise of cells.

    Raises
    ------
    ValueError
        If the seed is not a whole number >= 0.
    """
    learned = learn(TASK, xi=XI, runs=RUNS, seed=seed, learner=LEARNER)
    # The plain engine has the same spikes as the compiled one, without compiling; its usual
    # step and settling would take three times as long.
    engine = Plain(dt_ms=STEP_MS, settle_ms=SETTLE_MS, spikes=tuple(NUCLEI))
    usual = TASK.evidence(200, seed=stream(seed, "demo", "usual"))
    model = BasalGanglia(load_circuit(DEFAULT, 2), engine, seed=seed).adapted_to(usual)
    evidence = TASK.evidence(1, seed=stream(seed, "demo"))
    activity = model.activity(evidence, checked=False)
    traces = {
        CIRCUIT: model.trace(activity, evidence),
        TEST: Msprt(model.gain).run(evidence),
    }
    threshold = float(Msprt.threshold(model.gain * learned.learned.mean()))
    decisions = {
        name: crossing_of_each(trace, np.array([threshold]), forced=False, checked=False)
        for name, trace in traces.items()
    }
    assert activity.spikes is not None
    readable = model.circuit.readable_nats[1]
    return Demo(
        learned, evidence, activity.spikes, traces, decisions, threshold, readable, model.gain
    )


@styled
def draw(demo: Demo) -> Figure:
    """Draw the learned threshold, evidence, OUT with -ln P, and the spikes of every nucleus."""
    figure, grid = panels(
        3 + len(NUCLEI), size=(6.4, 9.0), height_ratios=[1.7, 1.5, 2.0] + [1] * len(NUCLEI)
    )
    learning, *axes = grid[:, 0]
    _learning(learning, demo.learned)
    _evidence(axes[0], demo.evidence)
    _out(axes[1], demo)
    for panel, (name, label) in zip(axes[2:], NUCLEI.items(), strict=True):
        spikes = demo.spikes[name]
        shown = spikes[spikes["time_ms"] > 0]
        raster(panel, shown, channels=demo.evidence.hypotheses, neurons=CELLS, ms=1.2)
        panel.set_ylabel(label, rotation=0, ha="right", va="center")
    marks = "vertical lines: decisions of test (dashed) and circuit"
    axes[2].set_title(f"Spikes of {CELLS} cells per alternative; {marks}")
    axes[-1].set_xlabel(FROM_ONSET)
    for panel in axes:
        panel.set_xlim(0, (TASK.t_max + 1) * TASK.step_ms)
        panel.tick_params(labelbottom=panel is axes[-1])
        for name, style in ((TEST, "--"), (CIRCUIT, "-")):
            panel.axvline(demo.decisions[name].time_ms[0], color="k", lw=0.8, ls=style)
    return figure


def _learning(panel: Axes, learned: FromReward) -> None:
    wide = learned.table.pivot(index="run", columns="episode", values="mean")
    acquisition(panel, wide, color=PALETTE[3], label=f"Median and 10 to 90 % of {RUNS} runs")
    panel.axhline(learned.best, color="k", lw=0.8, ls="--", label="Best")
    panel.set(xlabel="Trial of learning", ylabel="Boundary\nseparation (nats)")
    panel.set_xlim(0, LEARNER.episodes)
    legend_above(panel, 2, "Reward moves the threshold of the test")


def _evidence(panel: Axes, evidence: Evidence) -> None:
    total = evidence.own_totals[0]
    total = np.concatenate([total, total[-1:]])  # a reading lasts for a step
    channel_lines(panel, _long(np.arange(len(total)) * evidence.step_ms, total), steps=True)
    truth = int(np.asarray(evidence.truth)[0])
    for i, (line, name) in enumerate(zip(panel.lines, NAMES, strict=True)):
        line.set_label(name.capitalize() + " (true)" * (i == truth))
    panel.set_ylabel("Evidence\n(nats)")
    legend_above(panel, 4, "Summed log-likelihoods of taps, the input of each channel")


def _out(panel: Axes, demo: Demo) -> None:
    for name, style in ((CIRCUIT, {"lw": 1.3}), (TEST, {"ls": "--", "lw": 1.0})):
        trace = demo.traces[name]
        rows = _long(trace.time_ms, np.asarray(trace.out_nats[0]))
        channel_lines(panel, rows, steps=name == TEST, **style)
        label = "OUT of the circuit" if name == CIRCUIT else "−ln P, MSPRT at its gain"
        panel.plot([], [], color="0.3", label=label, **style)
    level = demo.threshold_nats
    panel.axhline(level, color="k", lw=0.8, ls=":", label="Learned threshold")
    top = max(2.0, 1.2 * demo.readable_nats)
    panel.axhspan(demo.readable_nats, top, color="0.94", lw=0, zorder=0)
    panel.text(6, 0.975 * top, "Beyond the read-out", va="top", fontsize=7, color=GREY)
    panel.set(ylabel="OUT (nats)", ylim=(0, top))
    legend_above(panel)


def _long(time_ms: np.ndarray, values: np.ndarray) -> pd.DataFrame:
    ticks, count = values.shape
    return pd.DataFrame(
        {
            "channel": np.tile(np.arange(count), ticks),
            "time_ms": np.repeat(np.asarray(time_ms), count),
            "value": values.ravel(),
        }
    )
