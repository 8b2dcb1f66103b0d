"""One decision of the spiking circuit and of the MSPRT: the first thing to look at."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from bgmodel.deciding.decision import Decision, first_crossing
from bgmodel.deciding.trace import Trace
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.sprt import Msprt, threshold_from_posterior
from bgmodel.simulated_evidence import separated_evidence
from bgmodel.support.seeds import stream
from circuits.anatomy import DEFAULT, load_circuit
from circuits.engines import Plain
from circuits.plots import FROM_ONSET, GREY, channel_lines, legend_above, panels, raster, styled

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
POSTERIOR, D_PRIME, READINGS, STEP_MS = 0.85, 0.8, 20, 50.0
CELLS = 30
"""Cells per channel in the raster."""


@dataclass(frozen=True)
class Demo:
    """One trial: evidence, activity of the circuit, and both decisions.

    Parameters
    ----------
    evidence : Evidence
        Evidence of one trial; the first alternative is true.
    spikes : dict of DataFrame
        Spikes by nucleus: channel, neuron and time_ms.
    traces : dict of Trace
        OUT of "circuit" and "MSPRT", nats.
    decisions : dict of Decision
        Decisions of both; they may be undecided at the end of the readings.
    readable_nats : float
        Highest OUT within the range of the read-out.
    gain : float
        Nats in the circuit per nat of evidence; the same for the test.
    """

    evidence: Evidence
    spikes: dict[str, pd.DataFrame]
    traces: dict[str, Trace]
    decisions: dict[str, Decision]
    readable_nats: float
    gain: float

    def summary(self) -> str:
        """Return a description of the trial in a few sentences."""
        test, own = (_outcome(self.decisions[name]) for name in ("MSPRT", "circuit"))
        return (
            f"One trial with {self.evidence.hypotheses} alternatives, of which alternative 1 is "
            f"true, and a reading of evidence every {STEP_MS:g} ms. The optimal test (MSPRT, on "
            f"evidence scaled by the circuit's gain of {self.gain:g}) {test}; the spiking circuit, "
            f"on the same readings, {own}. OUT is the firing rate of SNr in nats. For the leading "
            "alternative it follows the test's -ln P, and the first alternative whose OUT falls to "
            f"-ln {POSTERIOR:g} is chosen. Use --seed N for another trial."
        )


def _outcome(decision: Decision) -> str:
    choice = int(decision.choice[0])
    if choice < 0:
        return "made no choice before the end"
    right = "right" if choice == 0 else "wrong"
    return f"chose alternative {choice + 1} ({right}) after {decision.time_ms[0]:.0f} ms"


def demo(seed: int = 1, alternatives: int = 3) -> Demo:
    """Run the default circuit and the MSPRT at its gain on one trial of Gaussian evidence.

    Parameters
    ----------
    seed : int
        Seed of the evidence and of the noise of cells.
    alternatives : int
        Number of alternatives, 2 to 12.

    Returns
    -------
    Demo
        The trial: evidence and OUT in nats, spikes in ms from the onset of evidence.

    Raises
    ------
    ValueError
        If the circuit has too few channels, or the seed is not a whole number >= 0.
    """
    table = load_circuit(DEFAULT, alternatives)
    evidence = separated_evidence(
        1,
        READINGS,
        D_PRIME / np.sqrt(2),
        rng=stream(seed, "demo"),
        hypotheses=alternatives,
        step_ms=STEP_MS,
    )
    # The plain engine has the same spikes as the compiled one, without compiling.
    model = BasalGanglia(table, Plain(spikes=tuple(NUCLEI)), seed=seed).adapted_to(evidence)
    activity = model.activity(evidence)
    traces = {
        "circuit": model.trace(activity, evidence),
        "MSPRT": Msprt(model.gain).run(evidence),
    }
    criterion = threshold_from_posterior(POSTERIOR, alternatives)
    decisions = {
        name: first_crossing(trace, float(criterion), forced=False)
        for name, trace in traces.items()
    }
    assert activity.spikes is not None
    return Demo(evidence, activity.spikes, traces, decisions, table.readable_nats[1], model.gain)


@styled
def draw(found: Demo) -> Figure:
    """Draw evidence, OUT with -ln P, and the spikes of every nucleus."""
    figure, grid = panels(
        2 + len(NUCLEI),
        size=(6.4, 8.2),
        sharex=True,
        height_ratios=[1.7, 2.2] + [1] * len(NUCLEI),
    )
    axes = grid[:, 0]
    _evidence(axes[0], found.evidence)
    _out(axes[1], found)
    for panel, (name, label) in zip(axes[2:], NUCLEI.items(), strict=True):
        spikes = found.spikes[name]
        shown = spikes[spikes["time_ms"] > 0]
        raster(panel, shown, channels=found.evidence.hypotheses, neurons=CELLS, ms=1.2)
        panel.set_ylabel(label, rotation=0, ha="right", va="center")
    marks = "vertical lines: decisions of test (dashed) and circuit"
    axes[2].set_title(f"Spikes of {CELLS} cells per alternative; {marks}")
    axes[-1].set_xlabel(FROM_ONSET)
    axes[-1].set_xlim(0, (READINGS + 1) * STEP_MS)
    for panel in axes:
        for name, style in (("MSPRT", "--"), ("circuit", "-")):
            panel.axvline(found.decisions[name].time_ms[0], color="k", lw=0.8, ls=style)
    return figure


def _evidence(panel: Axes, evidence: Evidence) -> None:
    total = evidence.own_totals[0]
    channel_lines(panel, _long(np.arange(len(total)) * evidence.step_ms, total), steps=True)
    for i, line in enumerate(panel.lines):
        line.set_label(f"Alternative {i + 1}" + (" (true)" if i == 0 else ""))
    panel.set_ylabel("Evidence\n(nats)")
    legend_above(panel, 4, "Summed evidence for each alternative, the input of its channel")


def _out(panel: Axes, found: Demo) -> None:
    for name, style in (("circuit", {"lw": 1.3}), ("MSPRT", {"ls": "--", "lw": 1.0})):
        trace = found.traces[name]
        rows = _long(trace.time_ms, np.asarray(trace.out_nats[0]))
        channel_lines(panel, rows, steps=name == "MSPRT", **style)
        label = "OUT of the circuit" if name == "circuit" else "−ln P, MSPRT at its gain"
        panel.plot([], [], color="0.3", label=label, **style)
    panel.axhline(
        -np.log(POSTERIOR), color="k", lw=0.8, ls=":", label=f"Criterion −ln {POSTERIOR:g}"
    )
    top = max(2.0, 1.2 * found.readable_nats)
    panel.axhspan(found.readable_nats, top, color="0.94", lw=0, zorder=0)
    right = (READINGS + 1) * STEP_MS - 8
    panel.text(
        right, 0.975 * top, "Beyond the read-out", ha="right", va="top", fontsize=7, color=GREY
    )
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
