"""The drawing of a circuit: nuclei at the places of textbooks, pathways routed around them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from circuits.arrays import Array
from circuits.declaration.rows import GABA, Population, Projection
from circuits.declaration.table import CircuitTable
from circuits.plots import GREY, PALETTE, one_panel, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PLACES = {
    "ctx": (1.5, 3.0),
    "ctx_inh": (-1.35, 3.0),
    "common": (4.35, 3.0),
    "D1": (0.0, 2.0),
    "D2": (1.0, 2.0),
    "GPe_ctx": (2.1, 2.0),
    "GPe": (1.2, 1.0),
    "STN": (3.2, 1.0),
    "SNr": (1.5, 0.0),
}
"""Centres of the textbook nuclei: cortex above, then striatum, GPe and STN, output below."""
WIDE = {"ctx": 1.95, "SNr": 1.95}
"""Half widths of boxes to which many pathways lead; others are ``HALF``."""
HALF = (0.4, 0.19)
"""Half width and height of a nucleus."""
FREE = (
    *((4.35, 2.0), (-1.35, 2.0), (-1.35, 1.0), (4.35, 1.0), (-1.35, 0.0), (4.35, 0.0)),
    *((0.0, -1.0), (1.0, -1.0), (2.0, -1.0), (3.0, -1.0), (-1.35, -1.0), (4.35, -1.0)),
)
"""Places of other nuclei, which take the free one that is nearest to their partners."""
COLOURS = {"glutamate": PALETTE[1], GABA: PALETTE[0]}
LOST = "0.6"
"""Colour of silenced nuclei and of pathways that transmit nothing."""
PARTS = ("_NMDA",)
"""Endings of rows for a second receptor of a nucleus, drawn in the box of the nucleus."""
SAMPLES = np.linspace(0, 1, 25)
GRID = 0.1
"""Distance between the points at which pathways leave and enter a nucleus."""
TIP = 0.06
"""Distance of the end of a pathway from its target."""
CLEAR = 0.15
"""Least distance between pathways, in the unit of ``PLACES``."""
NEAREST = 500
"""Number of pairs of points, the nearest ones, between which a pathway is tried."""
STAR: Any = {"marker": "*", "ms": 7, "mfc": "w", "mec": "k", "mew": 0.7}
"""The mark of an edited row."""
Curve = Array
"""Four control points (4, 2) of a cubic Bezier curve, or many of them (n, 4, 2)."""


@dataclass(frozen=True)
class Box:
    """A nucleus in the drawing: centre and half sizes."""

    x: float
    y: float
    wide: float = HALF[0]
    high: float = HALF[1]

    def ports(self) -> Array:
        """Return points on the border with the direction that leads outwards, (n, 4)."""
        # All boxes have their ports on one grid, so that straight pathways are possible.
        first, last = self.x - self.wide + 0.12, self.x + self.wide - 0.12
        across = np.arange(np.ceil(first / GRID), np.floor(last / GRID) + 1) * GRID
        up = self.y + np.array([-GRID, 0.0, GRID])
        sides = [
            *((x, self.y + s * self.high, 0.0, s) for x, s in product(across, (-1, 1))),
            *((self.x + s * self.wide, y, s, 0.0) for y, s in product(up, (-1, 1))),
        ]
        return np.array(sides, dtype=np.float64)

    def holds(self, points: Array, margin: float = 0.06) -> Array:
        """Return how many of the points (n, samples, 2) of each curve lie inside, (n,)."""
        away = np.abs(points - (self.x, self.y)) < (self.wide + margin, self.high + margin)
        return np.asarray(away.all(axis=-1).sum(axis=-1), dtype=np.float64)


def nucleus(name: str, names: set[str]) -> str:
    """Return the name of the box of a row: its own, or that of the nucleus it is a part of."""
    for ending in PARTS:
        if name.endswith(ending) and name.removesuffix(ending) in names:
            return name.removesuffix(ending)
    return name


def boxes(circuit: CircuitTable) -> dict[str, Box]:
    """Return the box of each nucleus, by name."""
    names = {p.name for p in circuit.populations}
    shown = [p.name for p in circuit.populations if nucleus(p.name, names) == p.name]
    known = [name for name in shown if name in PLACES]
    placed = {name: Box(*PLACES[name], wide=WIDE.get(name, HALF[0])) for name in known}
    free = list(FREE)
    for name in shown:
        if name in placed:
            continue
        if not free:
            lowest = min(box.y for box in placed.values()) - 1
            free = [(x, lowest) for x in (0.0, 1.0, 2.0, 3.0)]
        partners = {
            q
            for p in circuit.projections
            for q in (p.source, p.target)
            if name in (p.source, p.target) and q in placed
        }
        at = np.array([(placed[q].x, placed[q].y) for q in partners] or [(1.5, -1.0)])
        away = [float(np.hypot(*(at - place).T).sum()) for place in np.array(free)]
        placed[name] = Box(*free.pop(int(np.argmin(away))))
    return placed


def curves(source: Box, target: Box) -> Curve:
    """Return possible routes of a pathway, (n, 4, 2), which leave and enter at right angles."""
    if source == target:
        return _loops(source)
    starts, ends = source.ports(), target.ports()
    pairs = np.array(list(product(range(len(starts)), range(len(ends)))))
    a, b = starts[pairs[:, 0]], ends[pairs[:, 1]]
    b[:, :2] += TIP * b[:, 2:]
    apart = np.hypot(*(b[:, :2] - a[:, :2]).T)[:, None]
    near = np.argsort(apart[:, 0], kind="stable")[:NEAREST]
    a, b, apart = a[near], b[near], apart[near]
    ways = []
    for pull in (0.35, 0.7, 1.1):
        middle = a[:, :2] + pull * apart * a[:, 2:], b[:, :2] + pull * apart * b[:, 2:]
        ways.append(np.stack([a[:, :2], *middle, b[:, :2]], axis=1))
    return np.concatenate(ways)


def _loops(box: Box) -> Curve:
    ways = []
    for sx, sy in product((-1, 1), (-1, 1)):
        out = (box.x + sx * (box.wide - 0.15), box.y + sy * box.high)
        back = (box.x + sx * (box.wide + TIP), box.y + sy * 0.05)
        ways.append([out, (out[0], out[1] + 0.3 * sy), (back[0] + 0.35 * sx, back[1]), back])
    return np.array(ways)


def along(ways: Curve) -> Array:
    """Return points of Bezier curves (n, 4, 2) as an array (n, samples, 2)."""
    t = SAMPLES[:, None]
    basis = np.hstack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3])
    return np.asarray(np.einsum("st,ntd->nsd", basis, ways))


def routes(circuit: CircuitTable, placed: dict[str, Box]) -> dict[tuple[str, str], Curve]:
    """Return the way of each pathway between two boxes.

    Straight and short pathways choose first. Each takes the shortest way that passes through no
    nucleus and keeps its distance from the others, or the one with the fewest crossings.
    """
    names = {p.name for p in circuit.populations}
    pairs = [(nucleus(p.source, names), nucleus(p.target, names)) for p in _shown(circuit)]
    return _routed(tuple(dict.fromkeys(pairs)), tuple(placed.items()))


@lru_cache(maxsize=16)
def _routed(
    ends: tuple[tuple[str, str], ...], boxes_by_name: tuple[tuple[str, Box], ...]
) -> dict[tuple[str, str], Curve]:
    """Return the route of each pathway; cached, because most edits keep the anatomy."""
    placed = dict(boxes_by_name)
    taken: dict[tuple[str, str], Curve] = {}
    points: list[Array] = []
    ordered = sorted(ends, key=lambda pair: _gap(placed[pair[0]], placed[pair[1]]))
    for pair in ordered:
        ways = curves(placed[pair[0]], placed[pair[1]])
        inside = along(ways)[:, 1:-1]
        length = np.hypot(*np.diff(along(ways), axis=1).transpose(2, 0, 1)).sum(axis=1)
        straight = np.hypot(*(ways[:, 3] - ways[:, 0]).T)
        cost = length + 2 * (length - straight)
        for name, end in zip(pair, (ways[:, 0], ways[:, 3]), strict=True):
            if name not in WIDE:  # the middle of the upper or lower side, where it is free
                off = np.abs(end[:, 0] - placed[name].x)
                cost += 0.1 * np.where(off < placed[name].wide, off, 0)
        for name, box in placed.items():
            cost += (0.3 if name in pair else 1.0) * box.holds(inside, 0 if name in pair else 0.06)
        best = np.argsort(cost, kind="stable")[:200]
        if points:
            others = np.concatenate(points)
            near = inside[best][:, :, None] - others[None, None]
            close = (np.hypot(near[..., 0], near[..., 1]) < CLEAR).any(axis=2).sum(axis=1)
            best = best[np.argsort(cost[best] + 0.3 * close, kind="stable")]
        taken[pair] = ways[best[0]]
        points.append(along(ways[best[:1]])[0])
    return taken


def _gap(a: Box, b: Box) -> tuple[bool, float]:
    """Return whether no straight pathway joins two boxes, and their distance along the axes."""
    apart_x = max(0.0, abs(a.x - b.x) - a.wide - b.wide)
    apart_y = max(0.0, abs(a.y - b.y) - a.high - b.high)
    return bool(apart_x and apart_y), apart_x + apart_y


def _shown(circuit: CircuitTable) -> list[Projection]:
    """Return the pathways between boxes, without those from a nucleus to its own part."""
    names = {p.name for p in circuit.populations}
    return [
        p
        for p in circuit.projections
        if p.source == p.target or nucleus(p.source, names) != nucleus(p.target, names)
    ]


@styled
def draw(
    circuit: CircuitTable, ax: Axes | None = None, reference: CircuitTable | None = None
) -> Figure:
    """Draw the circuit, as ``Circuit.plot``."""
    figure, ax = one_panel(ax, (4.8, 4.0))
    names = {p.name for p in circuit.populations}
    placed = boxes(circuit)
    ways = routes(circuit, placed)
    drawn: dict[tuple[str, str], tuple[Projection, ...]] = {}
    for p in _shown(circuit):
        pair = nucleus(p.source, names), nucleus(p.target, names)
        rows = circuit.pathways(p.pair)
        drawn[pair] = max(drawn.get(pair, rows), rows, key=_strength)
    for pair, rows in drawn.items():
        _pathway(ax, circuit, rows, ways[pair], any(_differs(p, reference) for p in rows))
    for name, box in placed.items():
        row = circuit.population(name)
        _nucleus(ax, circuit, row, box, _differs(row, reference))
    sides = [(b.x - b.wide, b.x + b.wide, b.y - b.high, b.y + b.high) for b in placed.values()]
    low_x, high_x, low_y, high_y = zip(*sides, strict=True)
    ax.set_xlim(min(low_x) - 0.35, max(high_x) + 0.35)  # room for pathways outside of the boxes
    ax.set_ylim(min(low_y) - 0.3, max(high_y) + 0.3)
    ax.set_axis_off()
    _legend(ax, circuit, reference)
    return figure


def _differs(row: Population | Projection, reference: CircuitTable | None) -> bool:
    if reference is None:
        return False
    rows: tuple[Population | Projection, ...] = (*reference.populations, *reference.projections)
    return row not in rows


def _passes(circuit: CircuitTable, p: Projection) -> bool:
    alive = circuit.intact_of(p.source).any() and circuit.axons_of(p).any()
    return bool(alive and p.weight != 0)


def _strength(rows: Iterable[Projection]) -> float:
    """Return the weight of a pathway, the sum over its receptors."""
    return sum(abs(p.weight) for p in rows)


def _pathway(
    ax: Axes, circuit: CircuitTable, rows: tuple[Projection, ...], way: Curve, differs: bool
) -> None:
    """Draw one pathway with all of its receptors, and a white border where it crosses another."""
    from matplotlib.patches import FancyArrowPatch
    from matplotlib.path import Path
    from matplotlib.patheffects import Normal, Stroke

    source = circuit.population(rows[0].source)
    alive = tuple(p for p in rows if _passes(circuit, p))
    width = 0.6 + 1.0 * np.sqrt(min(_strength(alive or rows), 4.0))
    colour = COLOURS[source.transmitter] if alive else LOST
    bar, tip = "|-|,widthA=0,widthB=0.45", "-|>,head_length=0.5,head_width=0.25"
    arrow = FancyArrowPatch(
        path=Path(way, [Path.MOVETO, *[Path.CURVE4] * 3]),
        color=colour,
        lw=width,
        ls="-" if alive else ":",
        gid=rows[0].pair,
        zorder=2,
        arrowstyle=bar if source.transmitter == GABA else tip,
        mutation_scale=9,
    )
    arrow.set_path_effects([Stroke(linewidth=width + 2.5, foreground="w"), Normal()])
    ax.add_patch(arrow)
    if len(rows) > 1:
        x, y = along(way[None])[0][len(SAMPLES) // 3]
        label = " + ".join(p.synapse or "other" for p in alive)
        around = {"facecolor": "w", "edgecolor": "none", "pad": 0.3}
        ax.text(x, y, label, ha="center", va="center", size=5, color=colour, zorder=4, bbox=around)
    if differs:
        x, y = along(way[None])[0][len(SAMPLES) // 2]
        _star(ax, x, y)


def _star(ax: Axes, x: float, y: float) -> None:
    ax.plot(x, y, zorder=5, **STAR)


def _nucleus(ax: Axes, circuit: CircuitTable, row: Population, box: Box, differs: bool) -> None:
    from matplotlib.patches import FancyBboxPatch

    intact = circuit.intact_of(row.name)
    left = np.unique(intact)
    alive = bool(intact.any())
    ax.add_patch(
        FancyBboxPatch(
            (box.x - box.wide + 0.08, box.y - box.high + 0.08),
            2 * box.wide - 0.16,
            2 * box.high - 0.16,
            boxstyle="round,pad=0.08",
            facecolor="w",
            edgecolor=COLOURS[row.transmitter] if alive else LOST,
            lw=1.2,
            ls="-" if left.tolist() == [1] else "--",
            hatch="" if alive else "////",
            gid=row.name,
            zorder=3,
        )
    )
    parts = [p.name for p in circuit.populations if p.name in {row.name + end for end in PARTS}]
    apart = " " if row.name in WIDE else "\n"
    note = "".join(f"{apart}+ {name}" for name in parts)
    if row.clamped:
        note += "\nclamped"
    elif not alive:
        note += "\nsilenced"
    elif left.tolist() != [1]:
        shares = intact[: 1 if len(left) == 1 else None]
        note += "\n" + " / ".join(f"{100 * part:.0f}" for part in shares) + " % left"
    ax.text(
        box.x,
        box.y,
        f"{row.name}{note}",
        ha="center",
        va="center",
        fontsize=6 if "\n" in note else 7,
        linespacing=1.0,
        gid=row.name,
        zorder=4,
        bbox={"facecolor": "w", "edgecolor": "none", "pad": 0.5} if not alive else None,
    )
    if differs:
        _star(ax, box.x + box.wide - 0.02, box.y + box.high - 0.02)


def _legend(ax: Axes, circuit: CircuitTable, reference: CircuitTable | None) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Line2D([], [], color=COLOURS["glutamate"], marker=">", ms=4, label="Excites (glutamate)"),
        Line2D([], [], color=COLOURS[GABA], marker="|", ms=6, mew=1.5, label="Inhibits (GABA)"),
    ]
    passing = {p.pair for p in circuit.projections if _passes(circuit, p)}
    if any(p.pair not in passing for p in circuit.projections):
        handles.append(Line2D([], [], color=LOST, ls=":", label="Transmits nothing"))
    lost = [p for p in circuit.populations if not circuit.intact_of(p.name).any()]
    if lost:
        kinds = {"Clamped" if p.clamped else "Silenced" for p in lost}
        label = " or ".join(sorted(kinds)).capitalize()
        handles.append(Patch(fc="w", ec=LOST, hatch="////", label=label))
    if any(0 < part < 1 for p in circuit.populations for part in circuit.intact_of(p.name)):
        handles.append(Patch(fc="w", ec=GREY, ls="--", label="Partial lesion"))
    if reference is not None and reference != circuit:
        handles.append(Line2D([], [], ls="", label="Edited or new", **STAR))
    ax.legend(
        handles=handles,
        loc="upper center",
        bbox_to_anchor=(0.5, 0.0),
        ncols=2 if len(handles) in (2, 4) else 3,
        frameon=False,
        fontsize=7,
        handlelength=2.4,
    )
