"""The tick scheme of ``circuits.ticks`` in plain NumPy: the oracle of the engines."""

from dataclasses import replace

import numpy as np
import pandas as pd

from circuits import noise
from circuits.activity import Activity, checked_drive
from circuits.cells import Escape, Lif
from circuits.fixed_point import wired
from circuits.ticks import (
    Clock,
    Scheme,
    cell_factors,
    jitter,
    lif_tick,
    refractory_ticks,
    spike_hz,
    starting_state,
)
from circuits.wiring import fan_in


def single(x):
    """Round to single precision; a product of two such numbers is exact before it is added."""
    return np.float32(x).astype(np.float64)


class Cells:
    """The cells of one block in one trial."""

    def __init__(self, scheme, block, stream):
        w, self.dt_ms, self.stream = scheme.wiring, scheme.dt_ms, stream
        self.row, self.cell, self.wiring, self.block = w.row(block), w.row(block).cell, w, block
        self.neurons, self.decay = self.row.neurons, scheme.block_decay[block]
        self.factors = cell_factors(w.circuit, self.row.name, int(w.channel[block]))
        start = starting_state(self.cell, self.factors, stream, self.neurons, self.dt_ms)
        self.state = single(start)
        if isinstance(self.cell, Lif):
            constants = lif_tick(self.cell, self.factors, self.dt_ms)
            self.constants = {name: single(value) for name, value in constants.items()}
        self.x = np.full(self.neurons, scheme.start[1][block])
        held_ms = getattr(self.cell, "refractory_ms", 0.0)
        self.held_ticks = refractory_ticks(held_ms, self.dt_ms)
        self.ready = np.zeros(self.neurons, dtype=int)

    def tick(self, k, nats):
        """Return which cells spike at tick k under an input (neurons,) in nats."""
        free = k >= self.ready
        if isinstance(self.cell, Lif):
            fired = self.lif(k, nats, free)
        else:
            self.x = self.decay * self.x + (1 - self.decay) * nats
            all_blocks = np.zeros((self.neurons, self.wiring.blocks))
            all_blocks[:, self.block] = self.x
            mean = self.wiring.rates(all_blocks)[:, self.block] * (self.dt_ms / 1e3)
            fired = (self.escape if isinstance(self.cell, Escape) else self.phase)(k, mean, free)
        self.ready[fired] = k + self.held_ticks + 1
        return fired

    def lif(self, k, nats, free):
        c = self.constants
        push = single(c["rest"] + c["slope"] * single(nats))
        push = single(push + c["kick"] * self.ones(k))
        self.state = np.where(free, single(push + c["keep"] * self.state), self.state)
        fired = self.state >= c["threshold"]
        self.state[fired] = 0.0
        return fired

    def phase(self, k, mean, free):
        width = single(single(jitter(self.cell, self.factors)) * single(np.sqrt(mean)))
        push = single(single(single(self.factors[0]) * single(mean)) - 4 * width)
        self.state = single(self.state + single(push + width * self.ones(k)))
        fired = self.state >= 1
        self.state[fired] -= 1
        return fired

    def escape(self, k, mean, free):
        words = noise.words(self.stream, k, self.neurons)
        return free & (words < -np.expm1(-mean * self.factors[0]) * 2.0**32)

    def ones(self, k):
        """Return the number of ones among the 8 bits of each cell at tick k."""
        return np.rint(noise.bits8(self.stream, k, self.neurons) * np.sqrt(2) + 4)


class Sparse:
    """What the cells of one target block get through one projection of their own connections."""

    def __init__(self, scheme, path, channel):
        w = scheme.wiring
        self.p = p = w.circuit.projections[path]
        place = np.unique(w.circuit.pattern(p), axis=0, return_inverse=True)[1].ravel()
        unit = np.flatnonzero(w.path == path)[place[channel]]
        self.unit = unit
        self.sources = np.flatnonzero(w.deliver[unit])
        self.delay, self.decay = scheme.unit_delay[unit], scheme.unit_decay[unit]
        self.jump = w.deliver[unit] / (scheme.dt_ms / 1e3)
        self.constant, self.rest = w.constant[unit], scheme.start[0][unit]
        self.u = np.full(w.circuit.population(p.target).neurons, self.rest)
        self.fan = {b: fan_in(w.circuit, p, channel, int(w.channel[b])) for b in self.sources}

    def tick(self, k, spiked):
        """Return the input (neurons,), nats, at tick k; ``spiked[k][block]`` are past spikes."""
        arrived = np.full(len(self.u), self.rest)
        if k >= self.delay:
            arrived = np.zeros(len(self.u))
            for b, fan in self.fan.items():
                arrived += self.jump[b] * spiked[k - self.delay][b][fan].mean(axis=1)
        self.u = self.decay * self.u + (1 - self.decay) * arrived
        return self.p.weight * (self.u + self.constant)


def run(circuit, drive, *, step_ms, seed, dt_ms=0.1, sample_ms=1.0, settle_ms=300.0, first_trial=0,
        spikes=()):  # fmt: skip
    """Return the Activity of a circuit under a drive (trials, steps, channels)."""
    drive = checked_drive(circuit, drive)
    clock = Clock(drive.shape[1], step_ms, dt_ms, sample_ms, settle_ms)
    scheme = Scheme(wired(circuit), dt_ms)
    w = scheme.wiring
    ran = [one(scheme, clock, y, seed, first_trial + t) for t, y in enumerate(drive)]
    frames = {name: [] for name in spikes}
    for name in spikes:
        for t, (_, _, spiked) in enumerate(ran):
            for channel, b in enumerate(w.blocks_of(name)):
                k, j = np.nonzero([now[b] for now in spiked[clock.settle_ticks :]])
                frames[name].append(pd.DataFrame({
                    "trial": t, "channel": channel, "neuron": j, "time_ms": (k + 1) * dt_ms,
                }))  # fmt: skip
    return Activity.from_blocks(
        w, np.array([r for r, _, _ in ran]), clock.time_ms, engine="reference",
        output_hz=np.array([o for _, o, _ in ran]),
        spikes={name: pd.concat(f, ignore_index=True) for name, f in frames.items()},
    )  # fmt: skip


def one(scheme, clock, drive, seed, trial):
    """Return rates (samples, blocks), read-out (samples, channels), spikes of each tick."""
    w, circuit = scheme.wiring, scheme.wiring.circuit
    cells = {
        b: Cells(scheme, b, noise.stream_key(seed, trial, w.names[b]))
        for b in range(w.blocks) if w.row(b).spiking
    }  # fmt: skip
    own = {b: [] for b in cells}
    weight = w.weight.copy()
    for i, p in enumerate(circuit.projections):
        ends = circuit.population(p.source), circuit.population(p.target)
        if p.probability < 1 and all(end.spiking for end in ends):
            weight[:, w.path == i] = 0
            for channel, b in enumerate(w.blocks_of(p.target)):
                own[b].append(Sparse(scheme, i, channel))
    common = replace(w, weight=weight)
    u, x, rest = scheme.start
    u, x = u.copy(), x.copy()
    readout = w.blocks_of(circuit.readout)
    o, low = rest[readout], scheme.readout_decay
    past, spiked = np.tile(rest, (clock.ticks, 1)), []
    outputs = np.zeros((clock.ticks, len(readout)))
    for k in range(clock.ticks):
        before = [past[k - d] if k >= d else rest for d in scheme.unit_delay]
        arrived = np.einsum("ub,ub->u", w.deliver, np.array(before).reshape(w.units, w.blocks))
        u = scheme.unit_decay * u + (1 - scheme.unit_decay) * arrived
        step = clock.step_of(k)
        reading = drive[step] if step >= 0 else np.zeros(circuit.channels)
        nats = common.inputs(u + w.constant) + w.drive(reading)
        x = scheme.block_decay * x + scheme.block_gain * nats
        past[k] = w.rates(x)
        now = {}
        for b, group in cells.items():
            now[b] = group.tick(k, nats[b] + sum((s.tick(k, spiked) for s in own[b]), 0.0))
            past[k, b] = now[b].sum() * spike_hz(len(now[b]), clock.dt_ms)
        spiked.append(now)
        o = low * o + (1 - low) * past[k, readout]
        outputs[k] = o
    late, every = clock.settle_ticks, clock.sample_ticks
    rates = past[late:].reshape(clock.samples, every, w.blocks).mean(axis=1)
    return rates, outputs[late + every - 1 :: every], spiked
