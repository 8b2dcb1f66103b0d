"""The circuit as text for a terminal and as a drawing for a figure, both from its table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from circuits.anatomy.printed_rates import at_rest, outside
from circuits.cells import Cell
from circuits.declaration.spec import DOPAMINE, GABA, NATS, Circuit, Population, Projection
from circuits.laws.posterior import off_nats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from circuits.activity import Activity

# Where the nuclei of the textbooks lie in a drawing; others are put in a row below.
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
ASSUMED = "assumed"
"""Source of a row that cites none."""
COLOURS = {"glutamate": "#b2182b", GABA: "#2166ac"}


def nuclei(circuit: Circuit) -> pd.DataFrame:
    """Return the populations as a table: one row per nucleus, units in the column names."""
    unit = circuit.unit.removesuffix("s")
    resting = _resting(circuit)
    rows = [
        {
            "nucleus": p.name,
            "cell": p.cell.kind,
            "channels": circuit.channels_of(p.name),
            "cells": p.neurons if p.spiking else 0,
            "releases": p.transmitter,
            "rest_hz": resting.get(p.name, math.nan),
            "baseline_hz": p.baseline_hz,
            f"gain_hz_per_{unit}": p.gain_hz_per_nat,
            "f": p.transfer,
            f"bias_{circuit.unit}": p.bias_nats,
            "tau_ms": p.tau_ms,
            "receptor": p.receptor,
            "spread": p.spread,
            "intact": _intact(p),
            "source": p.cite or ASSUMED,
        }
        for p in circuit.populations
    ]
    return _dropping(pd.DataFrame(rows), receptor="", spread=0.0, intact="1")


def pathways(circuit: Circuit) -> pd.DataFrame:
    """Return the projections as a table: one row a pathway, units in the column names."""
    rows = [
        {
            "pathway": f"{p.source} -> {p.target}",
            "reaches": p.pattern,
            "weight": p.weight,
            "delay_ms": p.delay_ms,
            "tau_ms": p.tau_ms,
            "probability": p.probability,
            "by_channel": " ".join(f"{factor:g}" for factor in p.factors),
            "intact": _intact(p),
            "f": p.transfer,
            "receptor": p.receptor,
            "source": p.cite or ASSUMED,
        }
        for p in circuit.projections
    ]
    return _dropping(
        pd.DataFrame(rows), probability=1.0, by_channel="", intact="1", f="linear", receptor=""
    )


def courses(circuit: Circuit) -> pd.DataFrame:
    """Return the courses as a table, one row each."""
    rows = [
        {
            "course": row.what,
            "amount": row.amount,
            "of": "level" if row.what == DOPAMINE else circuit.unit,
            "from_ms": row.from_ms,
            "to_ms": row.to_ms,
            "rise_ms": row.rise_ms,
            "decay_ms": row.decay_ms,
            "source": row.cite or ASSUMED,
        }
        for row in circuit.courses
    ]
    return pd.DataFrame(rows)


def _tables(circuit: Circuit) -> list[pd.DataFrame]:
    """Return the tables that have rows."""
    return [nuclei(circuit), pathways(circuit), *([courses(circuit)] if circuit.courses else [])]


def text(circuit: Circuit) -> str:
    """Return the whole circuit on one page."""
    tables = [_text(table) for table in _tables(circuit)]
    return "\n\n".join([_head(circuit), *tables, constants(circuit)])


def html(circuit: Circuit) -> str:
    """Return the page of ``text`` as HTML, its tables as tables."""
    tables = [
        table.to_html(index=False, border=0, float_format="{:.4g}".format)
        for table in _tables(circuit)
    ]
    head, foot = (
        f"<p>{escape(part).replace(chr(10), '<br>')}</p>"
        for part in (_head(circuit), constants(circuit))
    )
    return "\n".join([head, *tables, foot])


def _head(circuit: Circuit) -> str:
    """Return the facts of the whole circuit, a line each."""
    low, high = circuit.range_nats
    at_rest = (
        f"S = {circuit.reference_nats:.3g} nats at rest, works"
        if circuit.unit == NATS
        else f"in {circuit.unit}, not nats: no posterior follows from OUT; "
        f"{circuit.rest_drive:.3g} at rest, works"
    )
    gain = circuit.default_gain
    lead = (
        f"; follows a lead of up to {circuit.most_lead_nats:g} {circuit.unit} of drive per 100 ms"
        if math.isfinite(circuit.most_lead_nats)
        else ""
    )
    default = "no default gain" if gain is None else f"default gain {gain:g} per nat of evidence"
    return (
        f"{circuit.name}: {circuit.about}\n"
        f"{circuit.channels} channels, evidence into {circuit.input}, OUT from {circuit.readout}, "
        f"{'exact' if circuit.exact else 'not exact'}\n"
        f"{at_rest} from {low:g} to {high:g}; OUT is "
        f"read from {circuit.readable_nats[0]:.3g} to {circuit.readable_nats[1]:.3g}{lead}\n"
        f"{_drive(circuit)}, drive gain "
        f"{circuit.drive_gain:g}, read-out filter {circuit.readout_tau_ms:g} ms; {default}"
        f"{_off(circuit)}{_outside(circuit)}"
    )


def _resting(circuit: Circuit) -> dict[str, float]:
    """Return rates at rest, Hz, by the table's lines; none if there is no rest."""
    try:
        return at_rest(circuit)
    except ValueError:
        return {}


def _off(circuit: Circuit) -> str:
    """Return a line on how far OUT lies off -ln P at the fixed point, or nothing without nats."""
    if circuit.unit != NATS:
        return ""
    try:
        low, high = off_nats(circuit)
        text = f"all rivals level {low:+.3f} to {high:+.3f}"
        if circuit.channels > 2:
            low, high = off_nats(circuit, 1)
            text += f", one rival and the others far behind {low:+.3f} to {high:+.3f}"
    except ValueError as error:
        text = f"not known ({error})"
    return f"\nOUT - (-ln P) at the fixed point, where it is read, nats: {text}"


def _outside(circuit: Circuit) -> str:
    """Return a line on rates at rest that are not the animal's, or nothing."""
    found = outside(circuit) if _resting(circuit) else ""
    return f"\n{found}" if found else ""


def _drive(circuit: Circuit) -> str:
    """Return what a channel is driven by."""
    if not circuit.centred:
        return "each channel driven by its own evidence"
    apart = "" if math.isinf(circuit.reach_nats) else f", at most {circuit.reach_nats:g} apart"
    return f"drives less their mean over channels{apart}"


def constants(circuit: Circuit) -> str:
    """Return the constants of each cell type, one line a type and the nuclei that have it."""
    per_unit = f"_per_{circuit.unit.removesuffix('s')}"
    owners: dict[Cell, list[str]] = {}
    for p in circuit.populations:
        owners.setdefault(p.cell, []).append(p.name)
    return "\n".join(
        f"{', '.join(names)}: {cell.kind}"
        + "".join(
            f", {name.replace('_per_nat', per_unit)} {value:g}"
            for name, value in vars(cell).items()
        )
        for cell, names in owners.items()
    )


def _text(table: pd.DataFrame) -> str:
    """Return a table as text, words to the left and numbers to the right."""
    words: dict[str, Any] = {
        str(name): f"{{:<{max(column.str.len().max(), len(str(name)))}}}".format
        for name, column in table.items()
        if not pd.api.types.is_numeric_dtype(column)
    }
    lines = table.to_string(index=False, float_format="{:.4g}".format, formatters=words)
    return "\n".join(line.rstrip() for line in lines.splitlines())


def draw(circuit: Circuit, ax: Axes) -> Axes:
    """Draw the circuit: arrows excite, bars inhibit, width follows the weight.

    Parameters
    ----------
    circuit : Circuit
        Nuclei that a lesion took whole are grey, its pathways dotted.
    ax : Axes
        Drawn on and returned.
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


def rates(activity: Activity, trial: int, ax: Axes | Sequence[Axes] | None = None) -> Any:
    """Draw the rates of one trial, a panel per nucleus and a line per channel.

    Parameters
    ----------
    activity : Activity
        With rates.
    trial : int
        Number of the trial.
    ax : Axes, one per nucleus, optional
        Drawn on; a new figure unless given.

    Returns
    -------
    array of Axes
        One per nucleus.

    Raises
    ------
    ValueError
        If no rates were kept, there is no such trial, or the Axes do not fit.
    """
    known = activity.rates_hz
    if not known:
        raise ValueError(f"the {activity.engine} engine kept no rates: ask for them (rates=True)")
    trials = len(activity.output_nats)
    if trial not in range(trials):
        raise ValueError(f"trial must lie in 0..{trials - 1}, got {trial}")
    axes = panels(len(known), ax)
    for panel, (name, values) in zip(axes, known.items(), strict=True):
        for channel in range(values.shape[2]):
            panel.plot(activity.time_ms, values[trial, :, channel], label=f"channel {channel}")
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
        Axes that are there already; a new figure unless given.
    height : float
        Height of a panel of a new figure, inches.

    Raises
    ------
    ValueError
        If another number of Axes is given.
    ImportError
        If Matplotlib is not installed.
    """
    if ax is not None:
        given = np.ravel(np.asarray(ax, dtype=object))
        if len(given) != count:
            raise ValueError(f"ax must be {count} Axes, one per panel, got {len(given)}")
        return given
    try:
        import matplotlib.pyplot as plt
    except ImportError as error:
        raise ImportError("a plot needs Matplotlib: pip install matplotlib") from error
    size = (6.0, max(3.0, height * count))
    _, axes = plt.subplots(count, squeeze=False, figsize=size, layout="constrained")
    return np.asarray(axes[:, 0])


def _intact(p: Population | Projection) -> str:
    left = [p.intact * part for part in p.intact_by_channel or (1.0,)]
    clamped = isinstance(p, Population) and p.clamped
    return " ".join(f"{part:g}" for part in left) + (", clamped" if clamped else "")


def _dropping(table: pd.DataFrame, **defaults: object) -> pd.DataFrame:
    """Leave out columns that say nothing."""
    silent = [name for name, value in defaults.items() if (table[name] == value).all()]
    return table.drop(columns=silent)
