"""A layout as a Brian2 network, and its recorded activity.

Within a tick, groups run in the slot ``groups`` by order: delay line, units, blocks, cells. Sums
over synapses run one order before their target group. Spikes are counted afterwards.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from keyword import iskeyword
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from circuits.activity import Activity, spike_table
from circuits.arrays import Array
from circuits.cells.renewal import intervals
from circuits.dynamics import noise
from circuits.dynamics.ticks import Clock
from circuits.engines.brian2 import text as brian_text
from circuits.engines.brian2.layout import Columns, Layout, Values
from circuits.engines.brian2.noise import functions
from circuits.errors import require

ORDER = {"line": -6, "shared_inputs": -4, "own_inputs": -4, "blocks": -2}
"""Order of the groups within a tick; cells follow at 0, 1 and 2."""
Group = dict[str, Any]
"""Arguments and values of a group, as ``assembled`` takes them."""


class BrianNetwork:
    """All trials of a circuit as groups and connections of a network.

    ``drive`` is (trials, steps, columns), nats; ``start`` the initial values of ``Layout.start``;
    ``spikes`` the populations whose spikes are recorded. A nucleus may not have the name of a
    group.
    """

    def __init__(
        self, layout: Layout, clock: Clock, drive: Array, start: Values, spikes: Iterable[str] = ()
    ) -> None:
        self.layout, self.clock, self.drive = layout, clock, drive
        self.spikes = layout.wiring.circuit.spiking(spikes)
        self.values = layout.fixed() | start
        x = layout.wiring.drive(drive)
        readings = np.moveaxis(x, 1, 0).reshape(clock.steps, -1)
        timed = {"reading": (readings, clock.step_ms)}
        if layout.courses:
            timed["factors"] = layout.courses.factors.T, clock.dt_ms
            timed["added"] = layout.courses.nats.T, clock.dt_ms
        names = {
            "settle_ticks": clock.settle_ticks,
            "sample_ticks": clock.sample_ticks,
            "out_decay": layout.scheme.readout_decay,
            "dt_s": clock.dt_ms / 1000,
            "word_ticks": noise.TICKS_A_WORD,
        }
        self.sample_ticks = int(np.gcd(clock.settle_ticks, clock.sample_ticks))
        self.groups: dict[str, Group] = {}
        self.connections: list[Group] = []
        for name in layout.units:
            self._units(name)
        self._blocks()
        if layout.line:
            self._line()
        for name in layout.populations:
            self._cells(name)
        self.parts: Group = {
            "dt_ms": clock.dt_ms,
            "sampled_ms": self.sample_ticks * clock.dt_ms,
            "monitored": [object_name(name) for name in self.spikes],
            "names": names,
            "timed": timed,
            "intervals": np.array([intervals(c) for c in layout.scheme.renewals] or [np.zeros(1)]),
            "groups": self.groups,
            "connections": self.connections,
        }

    # ---- groups and connections

    def _group(self, name: str, model: str, about: Any = "", **more: Group) -> Group:
        key = object_name(name)
        require(key not in self.groups, "name", "must differ from other groups of the network", key)
        values = {v: value for (owner, v), value in self.values.items() if owner == name}
        group = {
            "about": about,
            "size": self.layout.trials * self.layout.size(name),
            "order": ORDER.get(name, 0),
            "model": model,
            "spikes": {},
            "names": {},
            "values": values,
            "links": {},
        }
        self.groups[key] = group | more
        return self.groups[key]

    def _connect(
        self, source: str, target: str, columns: Columns, add: str, value: str = ""
    ) -> None:
        """Connect two groups by a sum, ``a = b``, or by increments at spikes, ``a += b``."""
        if not columns:
            return
        ends = {"source": object_name(source), "target": object_name(target)}
        connection = {**ends, "add": add, "values": {value: columns[2]} if value else {}}
        connection |= {"i": columns[0], "j": columns[1]}
        if len(columns) > 3:
            connection["delay_ticks"] = columns[3]
        self.connections.append(connection)

    def _texts(self, state: str, ticks: tuple[str, str], laws: list[str]) -> tuple[str, str]:
        timed = bool(self.layout.courses)
        state += brian_text.law_state(laws) + brian_text.COURSE_STATE * timed
        return state, ticks[timed].format(law=brian_text.law(laws))

    def _units(self, name: str) -> None:
        ticks = brian_text.UNIT_TICK, brian_text.TIMED_UNIT_TICK
        state, tick = self._texts(brian_text.UNIT_STATE, ticks, self.layout.unit_laws(name))
        if name == "own_inputs":
            state, tick = state + brian_text.OWN_INPUT_STATE, brian_text.OWN_INPUT_HEAR + tick
        paths = (self.layout.wiring.projections[u].name for u in self.layout.units[name])
        about = f"in this order: {', '.join(dict.fromkeys(paths))}"
        self._group(name, state, about)["code"] = [(ORDER[name], 1, tick)]

    def _blocks(self) -> None:
        ticks = brian_text.BLOCK_TICK, brian_text.TIMED_BLOCK_TICK
        laws = [row.transfer for row in self.layout.wiring.rows]
        state, tick = self._texts(brian_text.BLOCK_STATE, ticks, laws)
        self._group("blocks", state)["code"] = [(ORDER["blocks"], 1, tick)]
        if self.layout.shared_inputs:
            columns = self.layout.shared_to_blocks()
            self._connect("shared_inputs", "blocks", columns, "nats_post = sent_pre")

    def _line(self) -> None:
        layout, line = self.layout, self._group("line", brian_text.LINE_STATE)
        block = np.repeat(list(layout.line), list(layout.line.values()))
        after = np.minimum(np.arange(line["size"]) + 1, line["size"] - 1)
        blocks = layout.index("blocks", block).ravel()
        line["links"] = {
            "now_hz": ("blocks", "rate_hz", blocks),
            "next_hz": ("line", "value_hz", after),
        }
        line["code"] = [(ORDER["line"], 1, brian_text.LINE_TICK)]
        add = "heard_post = nats_per_hz*value_hz_pre"
        self._connect("line", "shared_inputs", layout.line_to_shared(), add, "nats_per_hz")

    def _cells(self, name: str) -> None:
        layout, row = self.layout, self.layout.wiring.circuit.population(name)
        renewal = row.cell.renewal()
        text = brian_text.RENEWAL if renewal else row.cell.brian
        text = text or row.cell.lacks("brian", "the brian2 engine")
        block = layout.wiring.blocks_of(name)[0]
        constants = layout.constants(block)
        names = {n: v for n, v in constants.items() if not np.ndim(v)}
        hears = row.cell.hears
        of_kind = brian_text.RENEWAL_STATE if renewal else brian_text.TICKING_STATE
        state = [brian_text.CELL_STATE, of_kind, f"{hears} : 1"]
        state += [f"{n} : 1" for n in row.cell.state]
        state += [f"{n} : 1 (constant)" for n in constants if n not in names]
        hear, own_inputs = brian_text.HEAR[hears], layout.own_to_cells(name)
        if own_inputs:
            hear = brian_text.OWN_HEAR[hears].format(law=brian_text.law([row.transfer]))
            state.append(brian_text.OWN_STATE)
            names["filter_decay"] = layout.scheme.block_decay[block]
            names |= {n: getattr(row, n) for n in ("baseline_hz", "gain_hz_per_nat")}
        heard = "hz" if "block_hz" in hear else "x"
        state.append(f"block_{heard} : 1 (linked)")
        spikes = {"threshold": text.spike, "reset": text.reset}
        about = f"{row.neurons} cells in each channel: {row.cite}"
        cells = self._group(name, "\n".join(state), about, names=names, spikes=spikes)
        key = "train" if renewal else "key"
        links = {key: key, f"block_{heard}": heard}
        cells["links"] = {n: ("blocks", theirs, "block") for n, theirs in links.items()}
        # The gather is separate: within the tick it would prevent vectorisation.
        cells["code"] = [(1, 1, hear), (2, 1, text.tick)]
        if renewal:
            names["of_cells"] = layout.scheme.renewals.index(row.cell)
        else:
            cells["code"].insert(0, (0, noise.TICKS_A_WORD, brian_text.DRAW))
        add = "rate_hz_post += a_spike"
        self._connect(name, "blocks", layout.cells_to_blocks(name), add, "a_spike")
        if own_inputs:
            self._connect("own_inputs", name, own_inputs, "own_post = sent_pre")
        if layout.own_inputs:
            add = "arrived_post += a_spike"
            self._connect(name, "own_inputs", layout.cells_to_own(name), add, "a_spike")

    # ---- results

    def activity(self, network: Any, seed: int, first_trial: int) -> Activity:
        """Return the recorded activity of Brian2's network after its run with a seed."""
        w, clock = self.layout.wiring, self.clock
        last = clock.settle_ticks + clock.sample_ticks * (1 + np.arange(clock.samples))
        spikes = {name: self._spike_table(network, name) for name in self.spikes}
        return Activity.from_blocks(
            w,
            self._sampled(network, "window_hz", last),
            clock.time_ms,
            engine="brian2",
            output_hz=self._sampled(network, "out_hz", last)[..., w.blocks_of(w.circuit.readout)],
            spikes=spikes or None,
            about=clock.about(seed, first_trial),
        )

    def _sampled(self, network: Any, variable: str, ticks: npt.NDArray[np.int64]) -> Array:
        samples = np.array(getattr(network["samples"], variable))
        rows = samples[:, ticks // self.sample_ticks]
        return rows.reshape(self.layout.trials, -1, len(ticks)).transpose(0, 2, 1)

    def _spike_table(self, network: Any, name: str) -> pd.DataFrame:
        neurons = self.layout.wiring.circuit.population(name).neurons
        monitor = network[f"spikes_{object_name(name)}"]
        tick = np.round(np.array(monitor.t / monitor.clock.dt)).astype(np.int64)
        kept = (tick >= self.clock.settle_ticks) & (tick < self.clock.ticks)
        trial, place = np.divmod(np.array(monitor.i[:])[kept], self.layout.size(name))
        late = tick[kept] - self.clock.settle_ticks
        return spike_table(trial, place // neurons, place % neurons, late, self.clock.dt_ms)


def object_name(name: str) -> str:
    """Return a name that Brian2 allows for a population; "STN" is unchanged."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII)
    return plain if plain[0].isalpha() and not iskeyword(plain) else f"n_{plain}"


def assembled(brian: Any, parts: dict[str, Any]) -> Any:
    """Return the Brian2 network of ``BrianNetwork.parts``; scripts hold this function's source.

    It has groups, synapses, spike monitors, and samples of the blocks' rates.
    """
    ms, dt_ms, names = brian.ms, parts["dt_ms"], parts["names"]
    clocks = {n: brian.Clock(n * dt_ms * ms) for n in (1, names["word_ticks"])}
    timed = {n: brian.TimedArray(v, dt=apart * ms) for n, (v, apart) in parts["timed"].items()}
    shared = functions(brian, parts["intervals"]) | timed | names
    numpy = {"codeobj_class": brian.NumpyCodeObject}  # what the functions have code for
    on_tick = {"clock": clocks[1]} | numpy
    wide = dict.fromkeys(("stream", "train", "key", "block"), np.int64)
    made, others = {}, []
    for name, part in parts["groups"].items():
        made[name] = brian.NeuronGroup(
            part["size"], part["model"], name=name, order=part["order"], dtype=wide, **on_tick,
            namespace=shared | part["names"], **part["spikes"],
        )  # fmt: skip
        for variable, value in part["values"].items():
            setattr(made[name], variable, value)
    for name, part in parts["groups"].items():
        for variable, (source, theirs, index) in part["links"].items():
            setattr(made[name], variable, brian.linked_var(made[source], theirs, index=index))
        for order, ticks, code in part["code"]:
            made[name].run_regularly(code, clock=clocks[ticks], when="groups", order=order)
    for part in parts["connections"]:
        # By increments at spikes, or by a sum.
        add, values = part["add"], part["values"]
        model = "".join(f"{variable} : 1 (constant)\n" for variable in values)
        kind = {"on_pre": add} if "+=" in add else {"model": f"{model}{add} : 1 (summed)"}
        ends = made[part["source"]], made[part["target"]]
        synapses = brian.Synapses(*ends, **{"model": model} | kind, **on_tick)
        synapses.connect(i=part["i"], j=part["j"])
        for variable, value in values.items():
            setattr(synapses, variable, value)
        if "delay_ticks" in part:
            # Spikes arriving in this slot take effect one tick later.
            synapses.delay = (part["delay_ticks"] - 1) * dt_ms * ms
        others.append(synapses)
    for name in parts["monitored"]:
        others.append(brian.SpikeMonitor(made[name], name=f"spikes_{name}", **numpy))
    recorded = ["window_hz", "out_hz"]
    every = {"dt": parts["sampled_ms"] * ms, "when": "end", "name": "samples"}
    samples = brian.StateMonitor(made["blocks"], recorded, record=True, **every, **numpy)
    return brian.Network(*made.values(), *others, samples)
