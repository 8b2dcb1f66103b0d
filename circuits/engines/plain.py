"""The plain engine: the scheme of ``circuits.dynamics.ticks`` in NumPy, one trial at a time.

Slow but short: the readable reference for the other spiking engines, with which tests compare them.
Its spikes are those of the Brian2 and the spikes engine.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from circuits.activity import Activity, spike_tables, warn_beyond_range
from circuits.arrays import Array, Index, Truths
from circuits.cells import renewal
from circuits.declaration.table import CircuitTable
from circuits.dynamics import noise
from circuits.dynamics.fixed_point import wired
from circuits.dynamics.ticks import Clock, Scheme, Timed, spike_hz, starting_state, timed
from circuits.dynamics.wiring import fan_in, units_of
from circuits.engines.shipped import Plain
from circuits.engines.stream import Onward, Stream

Fired = dict[int, Truths]
"""Cells of each block that fired in a tick."""


def run(
    circuit: CircuitTable, drive: Array, engine: Plain, step_ms: float, seed: int, first: int
) -> Activity:
    """Run a circuit of spiking cells in NumPy; the arguments are those of ``Engine.run``."""
    noise.stream_key(seed, first, "")  # says at once if they are out of range
    names = circuit.spiking(engine.spikes)
    warn_beyond_range(circuit, drive)
    wiring = wired(circuit)
    clock = engine.clock(wiring, drive.shape[1], step_ms)
    scheme = Scheme(wiring, clock.dt_ms)
    kept = [b for name in names for b in scheme.wiring.blocks_of(name)]
    courses = timed(scheme.wiring, clock)
    late, every = clock.settle_ticks, clock.sample_ticks
    rates, outputs, spikes = [], [], []
    for t, readings in enumerate(drive):
        trial = _Trial(scheme, clock, courses, seed, first + t)
        ticks = (trial.tick(k, readings) for k in range(clock.ticks))
        fired = [[now[b] for b in kept] for now in ticks]
        sampled = trial.rates[late:].reshape(clock.samples, every, -1)
        rates.append(sampled.mean(axis=1))
        outputs.append(trial.outputs[late + every - 1 :: every])
        spikes.append(_listed(kept, fired[late:]))
    return Activity.from_blocks(
        scheme.wiring,
        np.array(rates),
        clock.time_ms,
        engine=engine.id,
        output_hz=np.array(outputs),
        spikes=spike_tables(scheme.wiring, names, spikes, clock.dt_ms),
        about=clock.about(seed, first),
    )


def stream(
    circuit: CircuitTable, engine: Plain, *, step_ms: float, steps: int, seed: int, trial: int
) -> Stream:
    """Begin a trial in NumPy; the arguments are those of ``Engine.stream``."""
    wiring = wired(circuit)
    clock = engine.clock(wiring, steps, step_ms)
    scheme = Scheme(wiring, clock.dt_ms)
    one, w = _Trial(scheme, clock, timed(scheme.wiring, clock), seed, trial), scheme.wiring
    every = clock.sample_ticks

    def begin(drive: Array, out: Array) -> Onward:
        def onward(first: int, last: int) -> None:
            for k in range(first, last):
                one.tick(k, drive)
                late = k + 1 - clock.settle_ticks
                if late > 0 and late % every == 0:
                    out[late // every - 1] = w.activity(one.outputs[k], circuit.readout)

        return onward

    return Stream(circuit, clock, begin)


class _Trial:
    """The state of one trial; ``tick`` advances it by the four steps of the scheme."""

    def __init__(self, scheme: Scheme, clock: Clock, courses: Timed, seed: int, trial: int) -> None:
        w = scheme.wiring
        self.scheme, self.clock, self.courses, self.w = scheme, clock, courses, w
        self.cells = {
            b: (_Renewal if row.cell.renewal() else _Ticking)(
                scheme, b, noise.stream_key(seed, trial, w.names[b])
            )
            for b, row in enumerate(w.rows)
            if row.spiking
        }
        self.own, weight = _own_inputs(scheme)
        self.common = replace(w, weight=weight)
        self.units, self.x, self.rest = scheme.start
        self.readout = w.blocks_of(w.circuit.readout)
        self.output = self.rest[self.readout]
        self.rates = np.tile(self.rest, (clock.ticks, 1))
        self.outputs = np.zeros((clock.ticks, len(self.readout)))
        self.fired: list[Fired] = []
        self.longest = int(scheme.unit_delay.max(initial=1))

    def tick(self, k: int, drive: Array) -> Fired:
        """Advance by tick k with a drive (steps, channels); return which cells fired."""
        scheme, w = self.scheme, self.w
        # 1. units
        past = [self.rates[k - d] if k >= d else self.rest for d in scheme.unit_delay]
        arrived = np.einsum("ub,ub->u", w.deliver, np.array(past).reshape(w.units, w.blocks))
        self.units = scheme.unit_decay * self.units + (1 - scheme.unit_decay) * arrived
        # 2. blocks
        step = self.clock.step_of(k)
        reading = drive[step] if step >= 0 else np.zeros(w.circuit.columns)
        factors, added = self.courses.at(k)
        nats = self.common.inputs(self.units + w.constant, factors) + w.drive(reading) + added
        self.x = scheme.block_decay * self.x + (1 - scheme.block_decay) * nats
        self.rates[k] = w.rates(self.x)
        # 3. cells
        fired: Fired = {}
        for b, cells in self.cells.items():
            each = (path.tick(k, self.fired, factors) for path in self.own[b])
            sparse_nats = sum(each, np.float64(0.0))
            fired[b] = cells.tick(k, nats[b] + sparse_nats)
            self.rates[k, b] = fired[b].sum() * cells.spike_hz
        self.fired.append(fired)
        if k >= self.longest:
            self.fired[k - self.longest] = {}  # no longer needed
        # 4. read-out
        low = scheme.readout_decay
        self.output = low * self.output + (1 - low) * self.rates[k, self.readout]
        self.outputs[k] = self.output
        return fired


class _Cells:
    """The cells of one block in one trial; subclasses say when they ``fire``."""

    def __init__(self, scheme: Scheme, block: int, stream: int) -> None:
        w = scheme.wiring
        self.row, self.stream, self.dt_s = w.rows[block], stream, scheme.dt_ms / 1000
        self.wiring, self.block, self.neurons = w, block, self.row.neurons
        self.spike_hz = spike_hz(self.neurons, scheme.dt_ms)
        self.decay = scheme.block_decay[block]
        self.constants = scheme.constants(block)
        # A scalar as long as all cells receive the same input.
        self.x = np.full(1, scheme.start[1][block])

    def tick(self, k: int, nats: Any) -> Truths:
        """Return which cells fire at tick k with an input, nats, of all cells or of each."""
        heard = nats
        if self.row.cell.hears == "hz":  # expected spikes in a tick, of all cells or of each
            self.x = self.decay * self.x + (1 - self.decay) * nats
            heard = self.wiring.block_rates(self.block, self.x) * self.dt_s
        return self.fire(k, heard)

    def fire(self, k: int, heard: Any) -> Truths:
        """Return which cells fire at tick k, given their input in nats or in expected spikes."""
        raise NotImplementedError

    def _each(self, value: Any) -> Any:
        """Return a value of all cells, or of each, as an array over cells."""
        # numpy.broadcast_to takes longer than most uses of the values.
        per_cell = np.shape(value) == (self.neurons,)
        return value if per_cell else np.broadcast_to(value, self.neurons)


class _Renewal(_Cells):
    """Cells that fire when their expected spikes reach the end of an interval."""

    def __init__(self, scheme: Scheme, block: int, stream: int) -> None:
        super().__init__(scheme, block, stream)
        cell = self.row.cell
        self.slow = self._each(np.float64(self.constants["slow"]))
        self.intervals = renewal.intervals(cell)
        self.expected, self.counts = np.zeros(1), np.zeros(self.neurons, np.uint32)
        (self.due,) = starting_state(cell, self.constants, stream, self.neurons)

    def fire(self, k: int, heard: Any) -> Truths:
        self.expected = self.expected + heard
        fired: Truths = self.expected >= self.due
        who = np.flatnonzero(fired)
        self.counts[who] += np.uint32(1)
        words = noise.train_words(self.stream, who, self.counts[who])
        self.due[who] += self.slow[who] * renewal.wait(self.intervals, words)
        return fired


class _Ticking(_Cells):
    """Cells whose type has a tick."""

    def __init__(self, scheme: Scheme, block: int, stream: int) -> None:
        super().__init__(scheme, block, stream)
        cell = self.row.cell
        self.step = cell.tick or cell.lacks("tick", "the plain engine")
        self.state: tuple[Any, ...] = starting_state(cell, self.constants, stream, self.neurons)

    def fire(self, k: int, heard: Any) -> Truths:
        if k % noise.TICKS_A_WORD == 0:
            words = noise.words(self.stream, k // noise.TICKS_A_WORD, self.neurons)
            self.counts = noise.byte_counts(words)
        ones = noise.counts_at(self.counts, k)
        fired, *state = self.step(heard, ones, *self.state, *self.constants.values())
        self.state = tuple(self._each(value) for value in state)
        per_cell: Truths = self._each(fired)
        return per_cell


class _OwnInputs:
    """Input of the cells of one block through the sparse connections of one projection."""

    def __init__(self, scheme: Scheme, path: int, channel: int) -> None:
        w = scheme.wiring
        p = w.circuit.projections[path]
        place = units_of(w.circuit, p)[2]
        unit = np.flatnonzero(w.path == path)[place[channel]]
        self.unit, self.weight, self.constant = unit, p.weight, w.constant[unit]
        self.delay, self.decay = scheme.unit_delay[unit], scheme.unit_decay[unit]
        self.jump = w.deliver[unit] / (scheme.dt_ms / 1000)
        self.rest = scheme.start[0][unit]
        self.u = np.full(w.circuit.population(p.target).neurons, self.rest)
        sources = np.flatnonzero(w.deliver[unit])
        self.fan = {int(b): fan_in(w.circuit, p, channel, int(w.channel[b])) for b in sources}

    def tick(self, k: int, fired: list[Fired], factors: Array) -> Array:
        """Return the input (neurons,), nats, at tick k, given the spikes of all earlier ticks.

        Weights are multiplied by ``factors`` (units of the wiring,).
        """
        arrived = np.full(len(self.u), self.rest)
        if k >= self.delay:
            arrived = np.zeros(len(self.u))
            for b, fan in self.fan.items():
                arrived += self.jump[b] * fired[k - self.delay][b][fan].mean(axis=1)
        self.u = self.decay * self.u + (1 - self.decay) * arrived
        return np.asarray(self.weight * factors[self.unit] * (self.u + self.constant))


def _own_inputs(scheme: Scheme) -> tuple[dict[int, list[_OwnInputs]], Array]:
    """Return each block's sparse pathways, and the remaining weights, for whole blocks."""
    w, circuit = scheme.wiring, scheme.wiring.circuit
    inputs: dict[int, list[_OwnInputs]] = {b: [] for b in range(w.blocks)}
    weight = w.weight.copy()
    for i, p in enumerate(circuit.projections):
        if circuit.is_sparse(p):
            weight[:, w.path == i] = 0
            for channel, b in enumerate(w.blocks_of(p.target)):
                inputs[int(b)].append(_OwnInputs(scheme, i, channel))
    return inputs, weight


def _listed(blocks: list[int], fired: list[list[Truths]]) -> Index:
    """Return block, cell and tick of each spike of a trial, from the cells that fired."""
    rows = [np.empty((0, 3), np.intp)]
    for i, b in enumerate(blocks):
        tick, cell = np.nonzero([now[i] for now in fired])
        rows.append(np.stack([np.full(len(tick), b), cell, tick], axis=1))
    return np.concatenate(rows)
