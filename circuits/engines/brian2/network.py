"""A layout as a Brian2 network, and its recorded activity.

Within a tick, groups run in the slot ``groups`` by order: delay line, units, blocks, cells. Sums
over synapses run one order before their target group. Spikes are counted afterwards.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from circuits.activity import Activity, spike_table
from circuits.arrays import Array
from circuits.dynamics import noise
from circuits.dynamics.ticks import Clock
from circuits.engines.brian2 import text as brian_text
from circuits.engines.brian2.layout import Columns, Layout, Values
from circuits.engines.brian2.noise import functions, load_brian, looked_up

ORDER = {"line": -6, "shared_inputs": -4, "own_inputs": -4, "blocks": -2}
"""Order of the groups within a tick; cells follow at 0, 1 and 2."""
WIDE = ("stream", "key", "block")
"""Variables of 64 bits."""


class Network:
    """All trials of a circuit as one network.

    Parameters
    ----------
    layout : Layout
        The array layout.
    clock : Clock
        Times of the run.
    spikes : names
        Populations whose spikes are recorded.

    Raises
    ------
    ValueError
        If one has no cells, or a cell type has no Brian2 code.
    """

    def __init__(self, layout: Layout, clock: Clock, spikes: Iterable[str] = ()) -> None:
        recorded = layout.wiring.circuit.spiking(spikes)
        self.brian, self.layout, self.clock = load_brian(), layout, clock
        self.ms = self.brian.ms
        self.tick = self.brian.Clock(clock.dt_ms * self.ms, name="tick")
        self.word_tick = self.brian.Clock(
            noise.TICKS_A_WORD * clock.dt_ms * self.ms, name="word_tick"
        )
        none = np.zeros((clock.steps, layout.trials * layout.wiring.blocks))
        self.reading = self.brian.TimedArray(none, dt=clock.step_ms * self.ms, name="reading")
        self.names = {
            **functions(),
            "reading": self.reading,
            "onset": clock.settle_ticks * clock.dt_ms * self.ms,
            "settle_ticks": clock.settle_ticks,
            "sample_ticks": clock.sample_ticks,
            "out_decay": layout.scheme.readout_decay,
            "dt_s": clock.dt_ms / 1000,
            "word_ticks": noise.TICKS_A_WORD,
        }
        if layout.courses:
            self.names["factors"] = looked_up(layout.courses.factors)
            self.names["added"] = looked_up(layout.courses.nats)
        self.objects: list[Any] = []
        self.groups: dict[str, Any] = {}
        self.spikes: dict[str, Any] = {}
        for name in layout.units:
            self._units(name)
        self._blocks()
        if layout.line:
            self._line()
        for name in layout.populations:
            self._cells(name)
        for name in recorded:
            self.spikes[name] = self.brian.SpikeMonitor(self.groups[name], name=f"spikes_{name}")
        self.sample_ticks = int(np.gcd(clock.settle_ticks, clock.sample_ticks))
        self.samples = self.brian.StateMonitor(
            self.groups["blocks"],
            ["window_hz", "out_hz"],
            record=True,
            dt=self.sample_ticks * clock.dt_ms * self.ms,
            when="end",
            name="samples",
        )
        self.network = self.brian.Network(self.objects, self.samples, *self.spikes.values())
        self.set(layout.fixed())

    # ---- building

    def _group(
        self, name: str, state: str, names: dict[str, Any] | None = None, **other: Any
    ) -> Any:
        group = self.brian.NeuronGroup(
            self.layout.trials * self.layout.size(name),
            state,
            name=re.sub(r"\W", "_", f"group_{name}"),
            clock=self.tick,
            order=ORDER.get(name, 0),
            namespace=self.names | (names or {}),
            dtype={n: np.int64 for n in WIDE if re.search(rf"\b{n} : integer( \(c|\n|$)", state)},
            **other,
        )
        self.groups[name] = group
        self.objects.append(group)
        return group

    def _every_tick(self, group: Any, code: str, what: str = "tick", **other: Any) -> None:
        given = {"clock": self.tick, "when": "groups", "order": group.order} | other
        self.objects.append(group.run_regularly(code, name=f"{group.name}_{what}", **given))

    def _link(self, group: Any, variable: str, source: str, theirs: str, index: Any) -> None:
        linked = self.brian.linked_var(self.groups[source], theirs, index=index)
        setattr(group, variable, linked)

    def _connect(
        self, source: str, target: str, columns: Columns, add: str, value: str = ""
    ) -> None:
        """Connect two groups by a sum, ``a = b``, or by increments at spikes, ``a += b``."""
        if not columns:
            return
        model = f"{value} : 1 (constant)\n" if value else ""
        spikes = "+=" in add
        synapses = self.brian.Synapses(
            self.groups[source],
            self.groups[target],
            model + ("" if spikes else f"{add} : 1 (summed)"),
            on_pre=add if spikes else None,
            name=re.sub(r"\W", "_", f"{source}_to_{target}"),
            clock=self.tick,
        )
        synapses.connect(i=columns[0], j=columns[1])
        if value:
            setattr(synapses, value, columns[2])
        if len(columns) > 3:
            # Spikes arriving in this slot take effect one tick later.
            synapses.delay = (columns[3] - 1) * self.clock.dt_ms * self.ms
        self.objects.append(synapses)

    def _texts(self, state: str, ticks: tuple[str, str], laws: list[str]) -> tuple[str, str]:
        """Return the equations and the code of a tick, with courses if there are any."""
        timed = bool(self.layout.courses)
        state += brian_text.law_state(laws) + brian_text.COURSE_STATE * timed
        return state, ticks[timed].format(law=brian_text.law(laws))

    def _units(self, name: str) -> None:
        ticks = brian_text.UNIT_TICK, brian_text.TIMED_UNIT_TICK
        state, tick = self._texts(brian_text.UNIT_STATE, ticks, self.layout.unit_laws(name))
        if name == "own_inputs":
            state, tick = state + brian_text.OWN_INPUT_STATE, brian_text.OWN_INPUT_HEAR + tick
        self._every_tick(self._group(name, state), tick)

    def _blocks(self) -> None:
        ticks = brian_text.BLOCK_TICK, brian_text.TIMED_BLOCK_TICK
        state, tick = self._texts(brian_text.BLOCK_STATE, ticks, self.layout.block_laws)
        self._every_tick(self._group("blocks", state), tick)
        if self.layout.shared_inputs:
            self._connect(
                "shared_inputs", "blocks", self.layout.shared_to_blocks(), "nats_post = sent_pre"
            )

    def _line(self) -> None:
        layout, line = self.layout, self._group("line", brian_text.LINE_STATE)
        block = np.repeat(list(layout.line), list(layout.line.values()))
        after = np.minimum(np.arange(len(line)) + 1, len(line) - 1)
        self._link(line, "now_hz", "blocks", "rate_hz", layout.index("blocks", block).ravel())
        self._link(line, "next_hz", "line", "value_hz", after)
        self._every_tick(line, brian_text.LINE_TICK)
        add = "heard_post = nats_per_hz*value_hz_pre"
        self._connect("line", "shared_inputs", layout.line_to_shared(), add, "nats_per_hz")

    def _cells(self, name: str) -> None:
        layout, row = self.layout, self.layout.wiring.circuit.population(name)
        text, block = brian_text.cell_text(row), layout.wiring.blocks_of(name)[0]
        constants = layout.constants(block)
        names = {n: v for n, v in constants.items() if not np.ndim(v)}
        hears = row.cell.hears
        state = [brian_text.CELL_STATE, f"{hears} : 1", *(f"{n} : 1" for n in row.cell.state)]
        state += [f"{n} : 1 (constant)" for n in constants if n not in names]
        hear, own = brian_text.HEAR[hears], layout.own_to_cells(name)
        if own:
            hear = brian_text.OWN_HEAR[hears].format(law=brian_text.law([row.transfer]))
            state.append(brian_text.OWN_STATE)
            names["filter_decay"] = layout.scheme.block_decay[block]
            names |= {n: getattr(row, n) for n in ("baseline_hz", "gain_hz_per_nat")}
        heard = "hz" if "block_hz" in hear else "x"
        state.append(f"block_{heard} : 1 (linked)")
        cells = self._group(name, "\n".join(state), names, threshold=text.spike, reset=text.reset)
        self._link(cells, "key", "blocks", "key", "block")
        self._link(cells, f"block_{heard}", "blocks", heard, "block")
        self._every_tick(cells, "word = byte_counts(cell, key)", "word", clock=self.word_tick)
        # The gather is separate: within the tick it would prevent vectorisation.
        self._every_tick(cells, hear, "hear", order=1)
        self._every_tick(cells, text.tick, "tick", order=2)
        self._connect(
            name, "blocks", layout.cells_to_blocks(name), "rate_hz_post += a_spike", "a_spike"
        )
        if own:
            self._connect("own_inputs", name, own, "own_post = sent_pre")
        if layout.own_inputs:
            add = "arrived_post += a_spike"
            self._connect(name, "own_inputs", layout.cells_to_own(name), add, "a_spike")

    # ---- running

    def set(self, values: Values) -> None:
        """Set variables."""
        for (group, variable), value in values.items():
            setattr(self.groups[group], variable, value)

    def readings(self, drive: Array) -> Array:
        """Return the values of ``reading``, (steps, trials x blocks), for a drive."""
        x = self.layout.wiring.drive(drive)
        return np.moveaxis(x, 1, 0).reshape(self.clock.steps, -1)

    def run(self) -> None:
        """Run one tick more than the clock's, because blocks count their spikes a tick later."""
        self.network.run((self.clock.ticks + 1) * self.clock.dt_ms * self.ms, namespace={})

    def activity(self, seed: int, first_trial: int) -> Activity:
        """Return the recorded activity of the run with a seed."""
        w, clock = self.layout.wiring, self.clock
        last = clock.settle_ticks + clock.sample_ticks * (1 + np.arange(clock.samples))
        spikes = {name: self._spike_table(name) for name in self.spikes}
        return Activity.from_blocks(
            w,
            self._sampled("window_hz", last),
            clock.time_ms,
            engine="brian2",
            output_hz=self._sampled("out_hz", last)[..., w.blocks_of(w.circuit.readout)],
            spikes=spikes or None,
            about=clock.about(seed, first_trial),
        )

    def _sampled(self, variable: str, ticks: npt.NDArray[np.int64]) -> Array:
        rows = np.array(getattr(self.samples, variable))[:, ticks // self.sample_ticks]
        return rows.reshape(self.layout.trials, -1, len(ticks)).transpose(0, 2, 1)

    def _spike_table(self, name: str) -> pd.DataFrame:
        neurons = self.layout.wiring.circuit.population(name).neurons
        monitor = self.spikes[name]
        tick = np.round(np.array(monitor.t / (self.clock.dt_ms * self.ms))).astype(np.int64)
        kept = (tick >= self.clock.settle_ticks) & (tick < self.clock.ticks)
        trial, place = np.divmod(np.array(monitor.i[:])[kept], self.layout.size(name))
        late = tick[kept] - self.clock.settle_ticks
        return spike_table(trial, place // neurons, place % neurons, late, self.clock.dt_ms)
