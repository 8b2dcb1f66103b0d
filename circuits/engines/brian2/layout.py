"""Array layout of the Brian2 engine, and its initial values.

Groups are ordered by trial. A unit of the wiring that serves a whole block is a *shared input*; if
every cell sums a pathway separately, each cell has an *own input*.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from circuits.arrays import Index
from circuits.declaration.rows import Projection
from circuits.dynamics import noise
from circuits.dynamics.ticks import Scheme, Timed, spike_hz, starting_state
from circuits.dynamics.wiring import Wiring, fan_in, units_of
from circuits.engines.brian2 import text as brian_text
from circuits.engines.brian2.noise import keys_at

Values = dict[tuple[str, str], npt.NDArray[Any]]
"""(group, variable) -> values."""
Columns = tuple[npt.NDArray[Any], ...]
"""Sources, targets, and further values of each synapse."""


@dataclass(frozen=True)
class Layout:
    """A circuit in several parallel trials."""

    scheme: Scheme  # the circuit with its tick
    trials: int  # in one network
    explicit: bool = False  # whether connections of probability 1 become synapses too
    courses: Timed | None = None  # changes from tick to tick, if any

    @property
    def wiring(self) -> Wiring:
        """The circuit as arrays."""
        return self.scheme.wiring

    @cached_property
    def populations(self) -> tuple[str, ...]:
        """Populations of cells, one group each."""
        return self.wiring.circuit.spiking()

    def is_own(self, p: Projection) -> bool:
        """Whether each target cell sums this pathway separately."""
        circuit = self.wiring.circuit
        return circuit.is_sparse(p) or (self.explicit and circuit.joins_cells(p))

    @cached_property
    def targets(self) -> list[list[int]]:
        """Blocks that each unit of the wiring reaches."""
        w, targets = self.wiring, []
        for p in w.circuit.projections:
            place = units_of(w.circuit, p)[2]
            blocks = w.blocks_of(p.target)
            targets += [list(blocks[place == k]) for k in range(place.max() + 1)]
        return targets

    @cached_property
    def shared_inputs(self) -> list[int]:
        """Units of the wiring that serve whole blocks."""
        return [u for u, p in enumerate(self.wiring.projections) if not self.is_own(p)]

    @cached_property
    def own_inputs(self) -> list[tuple[int, int, Index]]:
        """(unit of the wiring, target block, places of its cells' own inputs in a trial)."""
        begin, inputs = 0, []
        for u in sorted(set(range(self.wiring.units)) - set(self.shared_inputs)):
            for b in self.targets[u]:
                neurons = self.wiring.rows[b].neurons
                inputs.append((u, b, begin + np.arange(neurons)))
                begin += neurons
        return inputs

    @cached_property
    def units(self) -> dict[str, Index]:
        """The unit of the wiring of each shared and each own input of a trial, if there are any."""
        of_cells = [np.full(len(places), u) for u, _, places in self.own_inputs]
        own = np.concatenate([[], *of_cells])
        units = {"shared_inputs": np.array(self.shared_inputs), "own_inputs": own}
        return {name: of.astype(np.intp) for name, of in units.items() if len(of)}

    @cached_property
    def line(self) -> dict[int, int]:
        """Ticks of history needed for each block that feeds a shared input."""
        line: dict[int, int] = {}
        for place, b in zip(*np.nonzero(self.wiring.deliver[self.shared_inputs]), strict=True):
            delay = int(self.scheme.unit_delay[self.shared_inputs[place]])
            line[int(b)] = max(line.get(int(b), 0), delay)
        return line

    def line_end(self, block: int) -> int:
        """Return the place after a block's newest rate in the delay line of a trial."""
        return sum(list(self.line.values())[: list(self.line).index(block) + 1])

    def size(self, group: str) -> int:
        """Return the number of elements of a group in a trial."""
        circuit = self.wiring.circuit
        if group in self.populations:
            return circuit.channels_of(group) * circuit.population(group).neurons
        sizes = {name: len(of) for name, of in self.units.items()}
        sizes |= {"blocks": self.wiring.blocks, "line": sum(self.line.values())}
        return sizes[group]

    def index(self, group: str, places: npt.ArrayLike) -> Index:
        """Return the indices (trials, places) in a group from places in a trial."""
        first = np.arange(self.trials)[:, None] * self.size(group)
        return np.asarray(first + np.atleast_1d(places))

    def cells(self, block: int) -> Index:
        """Return the indices (trials, neurons) of a block's cells in their group."""
        row, channel = self.wiring.rows[block], self.wiring.channel[block]
        return self.index(row.name, channel * row.neurons + np.arange(row.neurons))

    # ---- connectivity

    def line_to_shared(self) -> Columns:
        """Return places in the delay line, shared inputs and nats/Hz."""
        w, parts = self.wiring, []
        for place, u in enumerate(self.shared_inputs):
            for b in np.flatnonzero(w.deliver[u]):
                at = self.line_end(int(b)) - self.scheme.unit_delay[u]
                ends = self.index("line", at), self.index("shared_inputs", place)
                parts.append((*ends, w.deliver[u, b]))
        return joined(parts)

    def shared_to_blocks(self) -> Columns:
        """Return shared inputs and blocks."""
        places = enumerate(self.shared_inputs)
        reached = [("shared_inputs", at, "blocks", b) for at, u in places for b in self.targets[u]]
        return joined([(self.index(*pair[:2]), self.index(*pair[2:])) for pair in reached])

    def cells_to_blocks(self, name: str) -> Columns:
        """Return cells, blocks and Hz per spike."""
        hz = spike_hz(self.wiring.circuit.population(name).neurons, self.scheme.dt_ms)
        blocks = self.wiring.blocks_of(name)
        return joined([(self.cells(b), self.index("blocks", b), hz) for b in blocks])

    def cells_to_own(self, name: str) -> Columns:
        """Return cells, own inputs, nats per spike and delays, ticks."""
        w, parts = self.wiring, []
        for u, target, places in self.own_inputs:
            for b in set(w.blocks_of(name)) & set(np.flatnonzero(w.deliver[u])):
                fan = fan_in(w.circuit, w.projections[u], int(w.channel[target]), int(w.channel[b]))
                jump = w.deliver[u, b] * 1000 / (self.scheme.dt_ms * fan.shape[1])
                own_inputs = self.index("own_inputs", places)[:, :, None]
                parts.append((self.cells(b)[:, fan], own_inputs, jump, self.scheme.unit_delay[u]))
        return joined(parts)

    def own_to_cells(self, name: str) -> Columns:
        """Return own inputs and their cells."""
        here = [part for part in self.own_inputs if self.wiring.rows[part[1]].name == name]
        return joined([(self.index("own_inputs", at), self.cells(b)) for _, b, at in here])

    # ---- values of the variables

    def fixed(self) -> Values:
        """Return the variables that are the same in every run."""
        values: Values = {}
        for name in self.populations:
            for b in self.wiring.blocks_of(name):
                here = {n: v for n, v in self.constants(b).items() if np.ndim(v)}
                here["cell"] = np.arange(self.wiring.rows[b].neurons)
                here["block"] = self.index("blocks", b)
                for variable, value in here.items():
                    empty = np.zeros(self.trials * self.size(name))
                    values.setdefault((name, variable), empty)[self.cells(b)] = value
        if self.line:
            newest = np.zeros(self.size("line"))
            newest[np.cumsum(list(self.line.values())) - 1] = 1
            values["line", "newest"] = np.tile(newest, self.trials)
        return values

    def constants(self, block: int) -> dict[str, Any]:
        """Return the constants of a block's cells: scalars, or (neurons,) if heterogeneous."""
        constants = self.scheme.constants(block)
        return {name: np.float64(value) for name, value in constants.items()}

    def start(self, seed: int, first_trial: int) -> Values:
        """Return the initial values of the variables that change from run to run."""
        w = self.wiring
        streams = noise.stream_keys(seed, first_trial + np.arange(self.trials), w.names)
        values = self._units() | self._blocks()
        keys = streams.ravel().astype(np.int64)
        values["blocks", "stream"] = keys
        values["blocks", "train"] = keys_at(keys, noise.TRAIN_TICK)
        for name in self.populations:
            values |= self._cells_start(name, streams)
        if self.line:
            line = np.repeat(self.scheme.start[2][list(self.line)], list(self.line.values()))
            values["line", "value_hz"] = np.tile(line, self.trials)
        return values

    def _cells_start(self, name: str, streams: npt.NDArray[np.uint64]) -> Values:
        row, blocks = self.wiring.circuit.population(name), self.wiring.blocks_of(name)
        constants = {b: self.scheme.constants(b) for b in blocks}
        pairs = [(constants[b], int(one[b])) for one in streams for b in blocks]
        begun = [starting_state(row.cell, *pair, row.neurons) for pair in pairs]
        variables = ("due",) if row.cell.renewal() else row.cell.state
        return {
            (name, variable): np.concatenate([state[i] for state in begun]).astype(np.float64)
            for i, variable in enumerate(variables)
        }

    def unit_laws(self, group: str) -> list[str]:
        """Return the name of the transfer of each unit of a trial."""
        return [self.wiring.projections[u].transfer for u in self.units[group]]

    def _units(self) -> Values:
        scheme, w = self.scheme, self.wiring
        values: Values = {}
        for group, of in self.units.items():
            one = {
                "u": scheme.start[0][of],
                "decay": scheme.unit_decay[of],
                "constant_nats": w.constant[of],
                "weight": np.array([w.projections[u].weight for u in of]),
                **brian_text.law_marks(self.unit_laws(group)),
            }
            if group == "own_inputs":
                one |= {"at_rest": scheme.start[0][of], "wait": scheme.unit_delay[of]}
            if self.courses:
                one["course"] = self.courses.of_unit[of]
            values |= {(group, name): np.tile(value, self.trials) for name, value in one.items()}
        return values

    def _blocks(self) -> Values:
        scheme, w = self.scheme, self.wiring
        one: dict[str, Any] = {
            "x": scheme.start[1],
            "rate_hz": scheme.start[2],
            "out_hz": scheme.start[2],
            "bias": w.bias,
            "decay": scheme.block_decay,
            "gain": 1 - scheme.block_decay,
            "baseline_hz": w.baseline_hz,
            "gain_hz_per_nat": w.gain_hz_per_nat,
            "lowest_hz": np.maximum(w.floor_hz, -1e300),
            "spiking": np.array([row.spiking for row in w.rows]) * 1.0,
            **brian_text.law_marks([row.transfer for row in w.rows]),
        }
        if self.courses:
            one["course"] = self.courses.of_block
        return {("blocks", name): np.tile(value, self.trials) for name, value in one.items()}


def joined(parts: list[tuple[Any, ...]]) -> Columns:
    """Return the columns of a list of tuples, each tuple broadcast, as flat arrays."""
    rows = [np.broadcast_arrays(*part) for part in parts]
    return tuple(
        np.concatenate([np.ravel(a) for a in column]) for column in zip(*rows, strict=True)
    )
