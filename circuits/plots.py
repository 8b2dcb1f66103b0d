"""Plots of a circuit and of its rates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array
from circuits.declaration.rows import GABA
from circuits.declaration.table import CircuitTable
from circuits.errors import require

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Positions of the textbook nuclei in a drawing; others are placed in a row below.
PLACES = {
    "ctx": (1.2, 3.0),
    "common": (2.8, 3.0),
    "D1": (0.0, 2.0),
    "D2": (1.2, 2.1),
    "STN": (2.8, 2.0),
    "GPe": (1.3, 1.2),
    "SNr": (0.5, 0.0),
    "ctx_inh": (0.0, 3.0),
    "GPe_ctx": (2.4, 0.6),
}
COLOURS = {"glutamate": "#b2182b", GABA: "#2166ac"}


def draw(circuit: CircuitTable, ax: Axes) -> Axes:
    """Draw the circuit: arrows excite, bars inhibit, width follows the weight.

    Parameters
    ----------
    circuit : CircuitTable
        Completely lesioned nuclei are grey, their pathways dotted.
    ax : Axes
        Axes to draw on, which are returned.
    """
    others = [p.name for p in circuit.populations if p.name not in PLACES]
    places = PLACES | {name: (0.8 * i, -1.0) for i, name in enumerate(others)}
    joined = {(p.source, p.target) for p in circuit.projections}
    for p in circuit.projections:
        source = circuit.population(p.source)
        both = (p.target, p.source) in joined
        alive = circuit.intact_of(p.source).any() and circuit.axons_of(p).any() and p.weight != 0
        ax.annotate(
            "",
            xy=places[p.target],
            xytext=places[p.source],
            arrowprops={
                "arrowstyle": "-|>" if source.transmitter != GABA else "|-|,widthA=0,widthB=.35",
                "color": COLOURS[source.transmitter] if alive else "#999999",
                "linewidth": 0.6 + 1.2 * np.sqrt(min(abs(p.weight), 4.0)),
                "linestyle": "-" if alive else ":",
                "connectionstyle": f"arc3,rad={0.18 if both else 0.0}",
                "shrinkA": 16,
                "shrinkB": 17,
            },
        )
    for row in circuit.populations:
        left = np.unique(intact := circuit.intact_of(row.name))
        colour = COLOURS[row.transmitter] if intact.any() else "#999999"
        shown = intact[: 1 if len(left) == 1 else None]
        label = " ".join(f"{part:.0%}" for part in shown)
        ax.text(
            *places[row.name],
            row.name if left.tolist() in ([0], [1]) else f"{row.name}\n{label}",
            ha="center",
            va="center",
            bbox={"boxstyle": "round,pad=0.35", "facecolor": "white", "edgecolor": colour},
        )
    points = np.array([places[p.name] for p in circuit.populations])
    ax.set_xlim(points[:, 0].min() - 0.6, points[:, 0].max() + 0.6)
    ax.set_ylim(points[:, 1].min() - 0.4, points[:, 1].max() + 0.4)
    ax.set_axis_off()
    return ax


def rates(
    time_ms: Array,
    rates_hz: Mapping[str, npt.NDArray[np.floating]],
    ax: Axes | Sequence[Axes] | None = None,
) -> npt.NDArray[np.object_]:
    """Draw the rates of one trial, a panel per nucleus and a line per channel.

    Parameters
    ----------
    time_ms : array (ticks,)
        Times of the samples, ms from the onset of evidence.
    rates_hz : mapping of arrays (ticks, channels)
        The rates of each nucleus, Hz.
    ax : Axes, one per nucleus, optional
        Axes to draw on; by default a new figure.

    Returns
    -------
    array of Axes
        One per nucleus.

    Raises
    ------
    ValueError
        If the number of Axes is wrong.
    """
    axes = panels(len(rates_hz), ax)
    for panel, (name, values) in zip(axes, rates_hz.items(), strict=True):
        for channel in range(values.shape[1]):
            panel.plot(time_ms, values[:, channel], label=f"channel {channel}")
        panel.set_ylabel(f"{name}\n(Hz)")
        panel.tick_params(labelbottom=panel is axes[-1])
    axes[0].legend(loc="upper left", fontsize="small")
    axes[-1].set_xlabel("time from the onset of evidence (ms)")
    return axes


def panels(
    count: int, ax: Axes | Sequence[Axes] | None = None, height: float = 1.2
) -> npt.NDArray[np.object_]:
    """Return Axes to draw on, one below the other.

    Parameters
    ----------
    count : int
        Number of panels.
    ax : Axes or sequence of Axes, optional
        Existing Axes; by default a new figure.
    height : float
        Height per panel of a new figure, inches.

    Raises
    ------
    ValueError
        If something other than Axes, or the wrong number of them, is given.
    ImportError
        If Matplotlib is not installed.
    """
    try:
        import matplotlib.pyplot as plt
        from matplotlib.axes import Axes
    except ImportError as error:
        raise ImportError("a plot needs Matplotlib: pip install matplotlib") from error
    if ax is not None:
        given = np.ravel(np.asarray(ax, dtype=object))
        are_axes = all(isinstance(each, Axes) for each in given)
        require(are_axes, "ax", "must be Matplotlib Axes, as from plt.subplots()", ax)
        require(len(given) == count, "ax", f"must be {count} Axes, one per panel", len(given))
        return given
    size = (6.0, max(3.0, height * count))
    _, axes = plt.subplots(count, squeeze=False, figsize=size, layout="constrained")
    return np.asarray(axes[:, 0])
