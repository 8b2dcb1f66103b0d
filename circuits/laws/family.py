"""The family of circuits whose OUT is -ln P: how much of each constraint a circuit fails.

In the multi-hypothesis SPRT, channel i wants ``OUT_i = S - y_i`` with ``S = ln sum_j exp y_j``
(Bogacz & Gurney 2007). A circuit of this family has one nucleus with an exponential line, STN;
every other nucleus is a straight line. STN acts on others by its sum over channels alone,
``Sigma = sum_j exp x_j``, unchanged or bent to ``Sigma - ln Sigma`` (in GPe). The straight lines,
and all loops among them, can then be solved out of the equations, which leaves::

    x_i   =  p y_i + c_x sum_j y_j + b_x Sigma + l_x ln Sigma + B_x    (input of STN)
    OUT_i = -d y_i + c_o sum_j y_j + b_o Sigma + l_o ln Sigma + B_o

The sum over channels of ``exp x_i`` is Sigma. With p = 1 its logarithm is::

    ln Sigma = S + c_x sum_j y_j + b_x Sigma + l_x ln Sigma + B_x

Put this S into ``OUT_i = S - y_i``. Whatever the evidence, Sigma and sum_j y_j can take any values,
so each coefficient must vanish by itself. These are the constraints; all are per nat of evidence::

    exponent   p         = 1
    direct     d         = 1
    sum        b_x + b_o = 0
    log        l_x + l_o = 1
    common     c_x + c_o = 0    (only if the drive is not centred)
    offset     B_x + B_o = 0

With GPe's ``G_i = v (Sigma - ln Sigma) - omega y_i``, ``x_i = q y_i - w G_i`` and
``OUT_i = -a y_i + alpha Sigma - u G_i`` they are ``q + w omega = 1``, ``a - u omega = 1``,
``alpha = (u + w) v`` and ``(u + w) v = 1``. Input common to all of cortex moves p and d alike and
drops out; so do all gains and baselines in Hz, all delays and all time constants.

If all but the last hold, ``OUT_i = -ln P_i + offset`` at every S, while no nucleus is silent or
saturated. A loss f of STN multiplies Sigma by ``1 - f`` wherever it arrives. Then b_x and b_o are
multiplied by ``1 - f``, so that they still cancel, and ``ln((1 - f) Sigma)`` adds
``(l_x + l_o) ln(1 - f) = ln(1 - f)`` to the offset, whatever the weights: the survivors compute
the same posterior, and OUT is lower by ``-ln(1 - f)`` nats.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from circuits.arrays import Array
from circuits.declaration.rows import Projection
from circuits.declaration.table import CircuitTable
from circuits.dynamics.fixed_point import wired
from circuits.errors import InputError, require

TOLERANCE = 1e-4
"""Largest failure of a constraint that is ignored, nats or per nat."""
EXP, BENT, LINES = "exp", "s_minus_log_s", ("linear", "rectified", "saturating", "ramp")
OFFSET = "offset"


class Constraint(NamedTuple):
    """One constraint, its requirement, and by how much a circuit fails it."""

    name: str
    must: str
    fails_by: float  # nats for the offset, otherwise per nat of evidence, of Sigma or of ln Sigma

    @property
    def holds(self) -> bool:
        """Whether it holds to within ``TOLERANCE``."""
        return abs(self.fails_by) <= TOLERANCE

    def __str__(self) -> str:
        return f"{self.name}: {self.must}; it is off by {self.fails_by:+.3g}"


@dataclass(frozen=True)
class Reduced:
    """A circuit without its straight lines: effects on STN's input (first) and on OUT (second)."""

    stn: str
    gain: float  # of cortex, nats of its activity per nat of drive beyond that of other channels
    evidence: Array  # (2, channels, channels), effect on a channel of the activity of a channel
    terms: Array  # (2, channels, 3), coefficients of Sigma, ln Sigma and 1

    @property
    def direct(self) -> Array:
        """The effect of a channel's evidence beyond that of the other channels', (2,)."""
        return _beyond(self.evidence)

    @property
    def unlike(self) -> float:
        """The largest difference between channels, per nat or nats."""
        within = self.direct[:, None, None] * np.eye(self.evidence.shape[1])
        apart = np.abs(self.evidence - within - _across(self.evidence)[:, None, None]).max()
        return float(max(apart, np.ptp(self.terms, axis=1).max()))


def _across(effects: Array) -> Array:
    """Return the mean over pairs of different channels of effects (..., channels, channels)."""
    count, own = effects.shape[-1], np.trace(effects, axis1=-2, axis2=-1)
    return np.asarray((effects.sum(axis=(-2, -1)) - own) / (count * (count - 1)))


def _beyond(effects: Array) -> Array:
    """Return the mean effect of a channel on itself less that on others."""
    mean = np.trace(effects, axis1=-2, axis2=-1) / effects.shape[-1]
    return np.asarray(mean - _across(effects), dtype=np.float64)


@lru_cache(maxsize=64)
def reduced(circuit: CircuitTable) -> Reduced:
    """Solve the straight lines of a circuit out of its equations; InputError says why it can't."""
    circuit.check_nats("OUT = -ln P")
    wiring = wired(circuit.steady)
    curved = [row.name for row in circuit.populations if row.transfer == EXP]
    must = "must be exp in one nucleus, as in STN"
    require(len(curved) == 1, "transfer", must, ", ".join(curved), owner=circuit.name)
    for row in circuit.populations:
        must = f"must be one of {', '.join((EXP, *LINES))}"
        known = row.transfer in (EXP, *LINES)
        require(known, "transfer", must, row.transfer, owner=row.name)
    stn, cortex = wiring.blocks_of(curved[0]), wiring.blocks_of(circuit.input)
    lines = wiring.deliver * wiring.gain_hz_per_nat
    tone = wiring.deliver @ wiring.baseline_hz + wiring.constant
    terms = [_terms(p, lines[u, stn], tone[u], curved[0]) for u, p in enumerate(wiring.projections)]
    lines[:, stn] = 0.0
    each = np.eye(wiring.blocks)
    driven = np.linalg.solve(each - wiring.weight @ lines, wiring.drive(np.eye(circuit.channels)).T)
    activity = wiring.weight @ lines[:, cortex]
    lines[:, cortex] = 0.0
    shared = wiring.weight @ np.array(terms)
    shared[:, 2] += wiring.bias
    effects = np.linalg.solve(each - wiring.weight @ lines, np.hstack([activity, shared]))
    ends = np.stack([effects[stn], effects[wiring.blocks_of(circuit.readout)]])
    count, gain = circuit.channels, float(_beyond(np.asarray(driven[cortex])))
    return Reduced(curved[0], gain, ends[..., :count], ends[..., count:])


def _terms(p: Projection, delivered: Array, tone: float, stn: str) -> tuple[float, float, float]:
    """Return the coefficients of Sigma, ln Sigma and 1 in the sum of one pathway's synapses."""
    if p.source != stn:
        must = f"must be linear, as only the sum over {stn} may be bent"
        require(p.transfer == "linear", "transfer", must, p.transfer, owner=p.name)
        return 0.0, 0.0, tone
    if np.ptp(delivered) > TOLERANCE:
        problem = f"{p.name} must transmit the sum over {stn}, with all channels alike"
        raise InputError(problem, "pattern")
    share = float(delivered[0])
    if p.transfer == "linear":
        return share, 0.0, tone
    must = f"must be linear or {BENT}"
    require(p.transfer == BENT, "transfer", must, p.transfer, owner=p.name)
    if share <= 0 or abs(tone) > TOLERANCE:
        problem = f"{p.name} must transmit a multiple of the sum over {stn}, it transmits {share:g}"
        raise InputError(f"{problem} of it and a constant {tone:.3g}", "intact")
    return share, -1.0, -float(np.log(share))


def constraints(circuit: CircuitTable) -> tuple[Constraint, ...]:
    """Return the constraints with how much a circuit fails each.

    InputError if it has no such equations, for example because its unit is not nats, no nucleus has
    an exponential line, or a pathway from STN keeps channels apart.
    """
    parts = reduced(circuit)
    stn, out = parts.stn, circuit.readout
    (p, d), (sigma, log, offset) = parts.direct, parts.terms.sum(axis=0).mean(axis=0)
    common = f"evidence common to all channels must cancel in {stn} and {out}"
    misses = (
        ("exponent", f"evidence must reach {stn} with a weight of 1 in all", p * parts.gain - 1),
        ("direct", f"evidence must reach {out} with a weight of -1 in all", d * parts.gain + 1),
        ("sum", f"the sum over {stn} must cancel in {stn} and {out}", sigma),
        ("log", f"its logarithm must reach {stn} and {out} with weights that add to 1", log - 1),
        ("common", common, _across(parts.evidence).sum()),
        ("alike", "all channels must have the same weights", parts.unlike),
        (OFFSET, f"{out} must rest at -ln P, nats", offset),
    )
    return tuple(Constraint(name, must, float(value)) for name, must, value in misses)


def failures(circuit: CircuitTable) -> list[str]:
    """Return one line for each constraint that a circuit fails; none for a member."""
    try:
        return [str(one) for one in constraints(circuit) if not one.holds]
    except ValueError as error:
        return [str(error)]


def offset_nats(circuit: CircuitTable) -> float | None:
    """Return OUT - (-ln P), nats, if it is the same at every S; otherwise None."""
    try:
        *weights, offset = constraints(circuit)
    except ValueError:
        return None
    return offset.fails_by if all(one.holds for one in weights) else None


def shift_nats(circuit: CircuitTable, before: CircuitTable | None = None) -> float | None:
    """Return by how much an edit raises OUT, nats, or None if that differs with the evidence.

    ``before`` is by default the circuit before its edits. For a loss of a fraction f of STN the
    shift is ``ln(1 - f)``.
    """
    before = circuit.unedited if before is None else before
    if before is None or before.channels != circuit.channels:
        return None
    offsets = offset_nats(before), offset_nats(circuit)
    return None if offsets[0] is None or offsets[1] is None else offsets[1] - offsets[0]
