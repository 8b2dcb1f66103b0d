"""Figure 3: a diagram of the pipeline."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from figures.common import Settings

BOXES = (
    ("tap", "TacTip on a grating,\nboth intervals:\nS1 = AA, S2 = AB"),
    ("decoder", "CNN reads two angles\n$\\psi_1$, $\\psi_2$"),
    ("evidence", "$\\Psi=\\psi_2-\\psi_1$\n$\\log p(\\Psi|S_2)/p(\\Psi|S_1)$"),
    ("integrator", "$Z_t = Z_{t-1}$ + evidence\n(SPRT, MSPRT,\nbasal ganglia)"),
    ("crossing", "R1: $Z\\leq-\\delta/2$\nR2: $Z\\geq\\delta/2$\nat $T_{max}$: sign of $Z$"),
    ("reward", "$r=\\xi W-T$\nW = $-1$ for an error,\n0 otherwise"),
)


def draw(settings: Settings, *, output: Path) -> Figure:
    """Draw the boxes, the loop over readings and the feedback from reward to threshold."""
    figure, ax = plt.subplots(figsize=(7.2, 1.9))
    ax.set(xlim=(-0.55, 5.55), ylim=(-1.15, 1.1))
    ax.set_axis_off()
    for i, (name, text) in enumerate(BOXES):
        box = Rectangle((i - 0.44, -0.5), 0.88, 1.0, fc=f"C{i}", alpha=0.13, ec="none")
        ax.add_patch(box)
        ax.text(i, 0.36, name, ha="center", va="center", fontweight="bold", color=f"C{i}")
        ax.text(i, -0.1, text, ha="center", va="center", fontsize=6.3)
        if i:
            _arrow(ax, (i - 0.56, 0), (i - 0.44, 0))
    _arrow(ax, (4, 0.52), (0, 0.52), bend=0.12)
    ax.text(2, 1.04, "no bound reached: tap again", ha="center", va="center", fontsize=7)
    _arrow(ax, (5, -0.52), (4, -0.52), bend=-0.45)
    ax.text(4.5, -1.02, "reward prediction error moves the gap $\\delta$", ha="center", fontsize=7)
    return figure


def _arrow(
    ax: Axes, start: tuple[float, float], end: tuple[float, float], bend: float = 0.0
) -> None:
    style = {"arrowstyle": "-|>", "color": "0.3", "lw": 1, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", end, start, arrowprops={**style, "connectionstyle": f"arc3,rad={bend}"})
