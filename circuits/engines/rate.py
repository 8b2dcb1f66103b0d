"""The rate engine: the table as delay differential equations, all trials at once, without noise.

Every population passes on the rate that its row states, ``baseline + gain * f(x)``; an
integrate-and-fire population is taken for its line, behind its membrane. The scheme is that of
``circuits.ticks``. No delay is shorter than a tick, so all ticks of the shortest delay are computed
together: only the filters go tick by tick.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from circuits import transfer
from circuits.activity import Activity, checked_drive, warn_beyond_range
from circuits.arrays import Array, Index
from circuits.fixed_point import wired
from circuits.spec import Circuit
from circuits.ticks import Clock, Scheme
from circuits.wiring import Wiring

MOST_TICKS = 64
"""Ticks computed together at most: more only cost memory."""


MOST_HZ = 1e6
"""Rates beyond stand for nothing: the loop is unstable."""


def run(
    circuit: Circuit,
    drive: npt.ArrayLike,
    *,
    step_ms: float,
    dt_ms: float = 0.1,
    sample_ms: float = 1.0,
    settle_ms: float = 300.0,
    rates: bool = True,
    drop_below: float | None = None,
) -> Activity:
    """Integrate the circuit's rates.

    Parameters
    ----------
    circuit : Circuit
        The table.
    drive : array (trials, steps, channels), nats
        Accumulated evidence; 0 is rest. Each reading is held until the next.
    step_ms, dt_ms, sample_ms, settle_ms : float
        Time from reading to reading, of a tick, from sample to sample, and at rest before the first
        reading; see ``Clock``.
    rates : bool
        Whether to keep the rates.
    drop_below : float, optional
        OUT, nats, below which a trial is over: what follows is NaN.

    Returns
    -------
    Activity
        Rates are means from sample to sample, OUT is low-passed and read at each sample's end.

    Raises
    ------
    ValueError
        If the drive does not fit the circuit, the circuit has no fixed point at rest, or a time is
        no multiple of the tick.
    """
    drive = checked_drive(circuit, drive)
    clock = Clock(drive.shape[1], step_ms, dt_ms, sample_ms, settle_ms)
    scheme = Scheme(wired(circuit), dt_ms)
    warn_beyond_range(circuit, drive)
    inputs = np.moveaxis(scheme.wiring.drive(drive), 0, -1)
    trials, level = len(drive), -np.inf if drop_below is None else float(drop_below)
    kept = np.full((clock.samples, scheme.wiring.blocks if rates else 0, trials), np.nan)
    output = np.full((clock.samples, circuit.channels, trials), np.nan)
    loop = _Loop(scheme)
    # Before the evidence all trials are alike.
    if clock.settle_ticks:
        loop.advance(clock.settle_ticks, np.zeros_like(loop.x))
    loop.select(np.zeros(trials, dtype=np.intp))
    left = np.arange(trials)
    for sample in range(clock.samples):
        step = sample * clock.sample_ticks // clock.step_ticks
        mean = loop.advance(clock.sample_ticks, inputs[step])
        if rates:
            kept[sample][:, left] = mean
        if not np.abs(loop.output).max() < MOST_HZ:
            late_ms = (sample + 1) * sample_ms
            raise ValueError(f"rates of {circuit.name} run away, {late_ms:g} ms after onset")
        output[sample][:, left] = loop.output
        over = scheme.wiring.activity(loop.output, circuit.readout).min(axis=0) < level
        if over.any():
            loop.select(~over)
            left, inputs = left[~over], inputs[..., ~over]
        if not left.size:
            break
    return Activity.from_blocks(
        scheme.wiring,
        kept.transpose(2, 0, 1) if rates else None,
        clock.time_ms,
        engine="rate",
        output_hz=output.transpose(2, 0, 1),
        about={"dt_ms": dt_ms, "settle_ms": settle_ms},
    )


class _Loop:
    """The state of all trials, and what moves it on.

    Arrays are (units, ..., trials) or (blocks, ..., trials). Sums run over one entry after the
    other, so that a trial's bytes do not depend on the trials beside it.
    """

    def __init__(self, scheme: Scheme) -> None:
        wiring = scheme.wiring
        units, x, rates = (start[:, None] for start in scheme.start)
        self.wiring, self.units, self.x, self.tick = wiring, units, x, 0
        self.deliver, self.weight = csr_array(wiring.deliver), csr_array(wiring.weight)
        self.unit_decay, self.block_decay = scheme.unit_decay[:, None], scheme.rate_decay[:, None]
        self.block_gain = 1 - scheme.rate_decay[:, None, None]
        self.constant, self.bias = wiring.constant[:, None, None], wiring.bias[:, None]
        self.bent = _bent(wiring)
        self.readout = wiring.blocks_of(wiring.circuit.readout)
        self.readout_decay = scheme.readout_decay
        self.output = rates[self.readout]
        self.delay = scheme.unit_delay[:, None]
        self.most = min(int(self.delay.min()), MOST_TICKS)
        # What blocks sent, as the units receive it: a ring of the last ticks.
        length = int(self.delay.max()) + self.most
        self.sent = np.repeat((self.deliver @ rates)[:, None], length, axis=1)

    def select(self, trials: Index) -> None:
        """Go on with some of the trials, or with one many times."""
        self.units, self.x = self.units[:, trials], self.x[:, trials]
        self.sent, self.output = (
            np.ascontiguousarray(self.sent[..., trials]),
            self.output[:, trials],
        )

    def advance(self, ticks: int, drive: Array) -> Array:
        """Go on for some ticks under a drive (blocks, trials); return the mean rates over them."""
        total = np.zeros_like(self.x)
        for first in range(0, ticks, self.most):
            rates = self._together(min(self.most, ticks - first), drive)
            for k in range(rates.shape[1]):
                total += rates[:, k]
                seen = rates[self.readout, k]
                self.output = self.readout_decay * self.output + (1 - self.readout_decay) * seen
        return total / ticks

    def _together(self, count: int, drive: Array) -> Array:
        """Go on for no more ticks than the shortest delay; return rates (blocks, ticks, trials)."""
        length = self.sent.shape[1]
        now = self.tick + np.arange(count)
        units = self.sent[np.arange(len(self.sent))[:, None], (now - self.delay) % length]
        units *= 1 - self.unit_decay[:, None]
        self.units = _filter(units, self.unit_decay, self.units)
        units += self.constant
        for law, rows in self.bent:
            units[rows] = law(units[rows])
        x = _product(self.weight, units)
        x += (drive + self.bias)[:, None]
        x *= self.block_gain
        self.x = _filter(x, self.block_decay, self.x)
        rates = np.moveaxis(self.wiring.rates(np.moveaxis(x, 0, -1)), -1, 0)
        self.sent[:, now % length] = _product(self.deliver, rates)
        self.tick += count
        return rates


def _filter(values: Array, decay: Array, state: Array) -> Array:
    """Low-pass values (rows, ticks, trials) in place from a state; return the state at the end."""
    for k in range(values.shape[1]):
        state = decay * state
        state += values[:, k]
        values[:, k] = state
    return state


def _product(matrix: csr_array, values: Array) -> Array:
    product: Array = matrix @ values.reshape(len(values), -1)
    return product.reshape(-1, *values.shape[1:])


def _bent(wiring: Wiring) -> list[tuple[transfer.Transfer, Index]]:
    """Return the transfers that are not linear, and the units that have them."""
    names = np.array([wiring.projection(u).transfer for u in range(wiring.units)])
    bent = sorted(set(names.tolist()) - {"linear"})
    return [(transfer.named(name), np.flatnonzero(names == name)) for name in bent]
