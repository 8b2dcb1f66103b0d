"""Code that the Brian2 engine runs every tick, in the order within a tick.

Cell types provide their own code (``Cell.brian``); nuclei and pathways are rows of the table.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from circuits.arrays import Array
from circuits.cells.cell import BrianText
from circuits.declaration import transfer

# ---- delay line of the blocks' rates, oldest first: each element copies the next one's value

LINE_STATE = """
value_hz : 1
newest : 1 (constant)       # 1 in the element that takes over the rate of its block
now_hz : 1 (linked)
next_hz : 1 (linked)
"""

LINE_TICK = "value_hz = newest*now_hz + (1 - newest)*next_hz"

# ---- units: a shared input reads the delay line, an own input receives spikes

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

# Effects of courses on units (dopamine) and blocks: rows of tables, 0 for none.
COURSE_STATE = "course : integer (constant)\n"

TIMED_UNIT_TICK = UNIT_TICK.replace("({law})", "(({law})*factors(t, course))")

# A variable called delay would hide the delay of the synapses that end here.
OWN_INPUT_STATE = """
arrived : 1
at_rest : 1 (constant)      # arrives until the first spikes can
wait : integer (constant)   # the tick when they can
"""

OWN_INPUT_HEAR = """
heard = arrived + at_rest*int(t_in_timesteps < wait)
arrived = 0
"""

# ---- blocks: one channel of one population

BLOCK_STATE = """
rate_hz : 1                 # r of the last tick; then of this one, when its spikes are counted
nats : 1                    # sum over the shared inputs
x : 1                       # filtered input, nats; unfiltered for cells that filter for themselves
hz : 1                      # rate at the input x
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
train : integer (constant)  # key of the intervals of renewal cells
key : integer
"""

BLOCK_TICK = """
first = int((t_in_timesteps - 1 - settle_ticks) % sample_ticks == 0)
window_hz = (1 - first)*window_hz + rate_hz/sample_ticks
out_hz = out_decay*out_hz + (1 - out_decay)*rate_hz
evidence = reading(t - settle_ticks*dt, i)*int(t_in_timesteps >= settle_ticks)
x = decay*x + gain*(nats + bias + evidence)
line_hz = baseline_hz + gain_hz_per_nat*({law})
hz = line_hz*int(line_hz > lowest_hz)
rate_hz = (1 - spiking)*hz
key = tick_key(stream, t_in_timesteps // word_ticks)
"""

TIMED_BLOCK_TICK = BLOCK_TICK.replace("bias + evidence", "bias + evidence + added(t, course)")

# ---- cells

CELL_STATE = """
cell : integer (constant)   # number within its block
block : integer (constant)
"""

TICKING_STATE = """
word : integer
key : integer (linked)
"""

DRAW = "word = byte_counts(cell, key)"

RENEWAL_STATE = """
expected : 1                # number of spikes expected so far
due : 1                     # the same at the next spike
fired : integer             # spikes so far
train : integer (linked)
"""

RENEWAL = BrianText(
    tick="expected = expected + hz*dt_s",
    spike="expected >= due",
    reset="""
fired = fired + 1
due = due + slow*interval(of_cells, cell, fired, train)
""",
)

HEAR = {"nats": "nats = single(block_x)", "hz": "hz = block_hz"}

OWN_STATE = """
own : 1                     # sum over the cell's own inputs
own_x : 1
"""

OWN_HEAR = {
    "nats": "nats = single(block_x + own)",
    "hz": """
own_x = filter_decay*own_x + (1 - filter_decay)*own
x = block_x + own_x
hz = clip(baseline_hz + gain_hz_per_nat*({law}), 0, inf)
""",
}


# ---- transfers: one expression in x that covers all the transfers of a group


def law(names: Iterable[str]) -> str:
    """Return the code of named transfers of x; if there are several, ``is_name`` selects one."""
    unique = sorted(set(names))
    texts = {name: transfer.named(name).brian.format(x="x") for name in unique}
    if len(unique) == 1:
        return texts[unique[0]]
    return " + ".join(f"is_{name}*({text})" for name, text in texts.items())


def law_state(names: Iterable[str]) -> str:
    """Return the equations of the selectors used by ``law``."""
    unique = sorted(set(names))
    return "".join(f"is_{name} : 1 (constant)\n" for name in unique if len(unique) > 1)


def law_marks(names: list[str]) -> dict[str, Array]:
    """Return the values of the selectors, one element per name."""
    unique, kinds = sorted(set(names)), np.array(names, dtype=object)
    return {f"is_{name}": (kinds == name) * 1.0 for name in unique if len(unique) > 1}
