"""What the Brian2 engine runs every tick, as text, in the order of a tick; and the cell types.

For a cell type of your own, add a dataclass to ``circuits.cells`` and one ``CellText`` to
``CELL_TEXT``. Nuclei and pathways are rows of the table and need nothing here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from circuits import noise, transfer
from circuits.cells import Cell, Escape, Lif, Phase
from circuits.spec import Population
from circuits.ticks import jitter, lif_tick, refractory_ticks
from circuits.wiring import Array

# ---- delay line of the blocks' rates, oldest first: each element takes over the next one's value

LINE_STATE = """
value_hz : 1
newest : 1 (constant)       # 1 in the element that takes over the rate of its block
now_hz : 1 (linked)
next_hz : 1 (linked)
"""

LINE_TICK = "value_hz = newest*now_hz + (1 - newest)*next_hz"

# ---- units: a relay hears the delay line, a socket hears spikes

UNIT_STATE = """
heard : 1                   # nats that arrive in this tick
u : 1                       # filtered, without its constant
sent : 1                    # what the targets get
decay : 1 (constant)
constant_nats : 1 (constant)
weight : 1 (constant)
"""

UNIT_TICK = """
u = decay*u + (1 - decay)*heard
x = u + constant_nats
sent = weight*({law})
"""

# A variable called delay would hide the delay of the synapses that end here.
SOCKET_STATE = """
arrived : 1
at_rest : 1 (constant)      # arrives until the first spikes can
wait : integer (constant)   # the tick when they can
"""

SOCKET_HEAR = """
heard = arrived + at_rest*int(t_in_timesteps < wait)
arrived = 0
"""

# ---- blocks: one channel of one population

BLOCK_STATE = """
rate_hz : 1                 # r of the last tick; then of this one, when its spikes are counted
nats : 1                    # sum over the relays
x : 1                       # filtered input, nats; unfiltered for cells that filter for themselves
hz : 1                      # the rate that x stands for
window_hz : 1               # mean of r since the last sample
out_hz : 1                  # low-pass of r
bias : 1 (constant)
decay : 1 (constant)
gain : 1 (constant)
baseline_hz : 1 (constant)
gain_hz_per_nat : 1 (constant)
lowest_hz : 1 (constant)
spiking : 1 (constant)      # 1 for cells, 0 for a unit of rate
stream : integer (constant) # of the noise
word_ticks : integer (constant)
key : integer
"""

BLOCK_TICK = """
first = int((t_in_timesteps - 1 - settle_ticks) % sample_ticks == 0)
window_hz = (1 - first)*window_hz + rate_hz/sample_ticks
out_hz = out_decay*out_hz + (1 - out_decay)*rate_hz
evidence = reading(t - onset, i)*int(t_in_timesteps >= settle_ticks)
x = decay*x + gain*(nats + bias + evidence)
line_hz = baseline_hz + gain_hz_per_nat*({law})
hz = line_hz*int(line_hz > lowest_hz)
rate_hz = (1 - spiking)*hz
key = tick_key(stream, t_in_timesteps // word_ticks)
"""

# ---- cells

CELL_STATE = """
word : integer
cell : integer (constant)   # number within its block
block : integer (constant)
key : integer (linked)
"""

HEAR = {"nats": "nats = single(block_x)", "hz": "hz = block_hz"}

OWN_STATE = """
own : 1                     # sum over the cell's sockets
own_x : 1
"""

OWN_HEAR = {
    "nats": "nats = single(block_x + own)",
    "hz": """
own_x = decay*own_x + (1 - decay)*own
x = block_x + own_x
hz = clip(baseline_hz + gain_hz_per_nat*({law}), 0, inf)
""",
}


@dataclass(frozen=True)
class CellText:
    """Brian2 text of one cell type.

    Parameters
    ----------
    hears : str
        What a cell is given every tick: its input ``nats``, or the rate ``hz`` that it stands for.
    state : str
        Its variables.
    begins : str
        The one that ``ticks.starting_state`` sets.
    constants : callable
        (cell, factors (3,) or (3, neurons), dt_ms) -> the constants of the text, of all cells or of
        each.
    tick : str
        Code of one tick. ``gauss(word, t_in_timesteps)`` is noise of unit variance, of 8 bits of
        which ``ones(word, t_in_timesteps)`` are one; ``chance(word)`` is uniform in 0..1,
        ``single(x)`` rounds to single precision, ``chosen(test, a, b)`` is a where the test holds
        and b elsewhere.
    spike, reset : str
        Condition of a spike, and what follows.
    word, word_ticks : str, int
        ``"byte_counts"`` and 4 for ``gauss`` and ``ones``, ``"random_word"`` and 1 for ``chance``.
    """

    hears: str
    state: str
    begins: str
    constants: Callable[[Any, Array, float], dict[str, Any]]
    tick: str
    spike: str
    reset: str
    word: str = "byte_counts"
    word_ticks: int = noise.TICKS_A_WORD


def _lif_constants(cell: Lif, factors: Array, dt_ms: float) -> dict[str, Any]:
    constants = lif_tick(cell, factors, dt_ms)
    names = ("keep", "rest", "slope", "kick", "threshold")
    held = refractory_ticks(cell.refractory_ms, dt_ms)
    return {name: np.float64(constants[name]) for name in names} | {"held": held}


def _phase_constants(cell: Phase, factors: Array, dt_ms: float) -> dict[str, Any]:
    return {"kick": np.float64(jitter(cell, factors)), "factor": np.float64(np.float32(factors[0]))}


def _escape_constants(cell: Escape, factors: Array, dt_ms: float) -> dict[str, Any]:
    return {"held": refractory_ticks(cell.refractory_ms, dt_ms), "factor": factors[0]}


CELL_TEXT: dict[type[Cell], CellText] = {
    Lif: CellText(
        hears="nats",
        state="""
            v : 1
            ready : integer
        """,
        begins="v",
        constants=_lif_constants,
        tick="""
            push = single(rest + slope*nats)
            push = single(push + kick*ones(word, t_in_timesteps))
            v = chosen(t_in_timesteps >= ready, single(push + keep*v), v)
        """,
        spike="v >= threshold",
        reset="""
            v = 0
            ready = t_in_timesteps + held + 1
        """,
    ),
    Phase: CellText(
        hears="hz",
        state="phi : 1",
        begins="phi",
        constants=_phase_constants,
        tick="""
            width = single(kick*single(sqrt(hz*dt_s)))
            push = single(single(factor*single(hz*dt_s)) - 4*width)
            push = single(push + width*ones(word, t_in_timesteps))
            phi = single(phi + push)
        """,
        spike="phi >= 1",
        reset="phi = phi - 1",
    ),
    Escape: CellText(
        hears="hz",
        state="""
            fired : 1
            ready : integer
        """,
        begins="fired",
        constants=_escape_constants,
        tick="""
            hit = chosen(chance(word) < -expm1(-factor*hz*dt_s), 1.0, 0.0)
            fired = chosen(t_in_timesteps >= ready, hit, 0.0)
        """,
        spike="fired > 0",
        reset="ready = t_in_timesteps + held + 1",
        word="random_word",
        word_ticks=1,
    ),
}
"""The cell types that Brian2 can run."""


def cell_text(row: Population) -> CellText:
    """Return the text of a population's cells; raises ValueError if there is none."""
    if type(row.cell) not in CELL_TEXT:
        known = ", ".join(kind.__name__ for kind in CELL_TEXT)
        raise ValueError(f"{row.name}: CELL_TEXT has no {type(row.cell).__name__}, only {known}")
    return CELL_TEXT[type(row.cell)]


# ---- transfers: one expression in x, whichever of some names an element has


def law(names: Iterable[str]) -> str:
    """Return the text of named transfers of x; where there are several, ``is_name`` marks each."""
    unique = sorted(set(names))
    texts = {name: transfer.named(name).brian.format(x="x") for name in unique}
    if len(unique) == 1:
        return texts[unique[0]]
    return " + ".join(f"is_{name}*({text})" for name, text in texts.items())


def law_state(names: Iterable[str]) -> str:
    """Return the equations of the marks that ``law`` needs."""
    unique = sorted(set(names))
    return "".join(f"is_{name} : 1 (constant)\n" for name in unique if len(unique) > 1)


def law_marks(names: list[str]) -> dict[str, Array]:
    """Return what the marks hold, an element a name."""
    unique, kinds = sorted(set(names)), np.array(names, dtype=object)
    return {f"is_{name}": (kinds == name) * 1.0 for name in unique if len(unique) > 1}
