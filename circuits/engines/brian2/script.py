"""One trial as a script that needs Brian2 and NumPy only: the engine's functions and their data."""

from __future__ import annotations

import base64
import inspect
import json
import re
import textwrap
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from circuits.cells.renewal import wait
from circuits.cells.single import choose, exponential, fused, single
from circuits.dynamics.noise import byte_counts, lowbias32, mix_all
from circuits.engines.brian2 import noise
from circuits.engines.brian2.network import BrianNetwork, assembled, object_name
from circuits.errors import require
from circuits.show import text

SHORT = 60
"""Longest array that is written as numbers."""
FUNCTIONS: tuple[Callable[..., Any], ...] = (
    *(mix_all, lowbias32, byte_counts, single, fused, choose, exponential, wait),
    *(noise.unsigned, noise.keys_at, noise.random_word, noise.noise_bytes, noise.ones_at),
    *(noise.interval_after, noise.functions, assembled),
)
"""Functions of which a script holds the source: those that ``assembled`` calls, and itself."""

SCRIPT = '''\
"""Trial {trial} of seed {seed} in Brian2, with the spikes of bgmodel.

It needs brian2 and numpy only. `python THIS.py` prints mean rates and the last OUT, and `python
THIS.py spikes.csv` writes every spike, too. Inputs and OUT are in {circuit.unit}, rates in Hz. The
first reading of evidence comes after {clock.settle_ms:g} ms at rest.

`parts` lists the groups: the cells of each nucleus, channel by channel; "blocks", which sum the
inputs of one channel of a nucleus and count its spikes; the inputs of blocks ("shared_inputs") or
of single cells ("own_inputs"), which filter what arrives by a pathway; and "line", the delay line
of the blocks' rates.
"""

{page}

from __future__ import annotations

import base64
import sys
import zlib
from typing import Any

import brian2
import numpy as np
import numpy.typing as npt

brian2.prefs.codegen.target = "numpy"  # the noise has no other code
Array = Integers = npt.NDArray[Any]
Group = dict[str, Any]

# ---- evidence, {circuit.unit}: a row per reading of {clock.step_ms:g} ms, a column per {columns}

drive = np.array({drive})
blocks = {blocks}
readings = np.zeros((len(drive), len(blocks)))
readings[:, {driven}] = {gains} * drive[:, {places}]

# ---- the circuit; a "stream" is the key of a block's noise, from seed, trial and name


def unpacked(kind: str, text: str) -> Array:
    """Return an array from compressed text; of whole numbers, it holds the steps between them."""
    values = np.frombuffer(zlib.decompress(base64.b85decode(text)), kind)
    return np.cumsum(values, dtype=np.int64) if kind[1] == "i" else values.astype(np.float64)


parts = {parts}
parts["timed"]["reading"] = readings, {clock.step_ms}

# ---- functions: noise of each cell and tick, arithmetic in single precision, the network

{source}

# ---- run, results

network = assembled(brian2, parts)
first, last = {clock.settle_ticks}, {clock.ticks}  # ticks with evidence
network.run((last + 1) * {clock.dt_ms} * brian2.ms, namespace={{}})

rows = []
for name in parts["monitored"]:
    neurons = {neurons}[name]  # per channel
    monitor = network["spikes_" + name]
    ticks = np.round(monitor.t / monitor.clock.dt).astype(np.int64)
    kept = (ticks >= first) & (ticks < last)
    times_ms = (ticks[kept] - first + 1) * {clock.dt_ms}
    rows += [(name, *divmod(cell, neurons), ms) for cell, ms in zip(monitor.i[kept], times_ms)]
    print(name, len(times_ms) / monitor.source.N / ((last - first) * {clock.dt_ms} / 1000), "Hz")
out = (network["samples"].out_hz[{readout}] - {line.baseline_hz}) / {line.gain_hz_per_nat}
print("last OUT:", *out[:, -1])
if sys.argv[1:]:
    with open(sys.argv[1], "w") as file:
        file.write("population,channel,neuron,time_ms\\n")
        file.writelines(",".join(map(str, row)) + "\\n" for row in rows)
'''


def script(network: BrianNetwork, seed: int, trial: int) -> str:
    """Return the script of a network of one trial."""
    layout, w = network.layout, network.layout.wiring
    require(layout.trials == 1, "drive", "must be of one trial in a script", layout.trials)
    timed = {n: table for n, table in network.parts["timed"].items() if n != "reading"}
    circuit, driven = w.circuit, np.flatnonzero(w.columns >= 0)
    return SCRIPT.format(
        circuit=circuit,
        seed=seed,
        trial=trial,
        clock=network.clock,
        page=textwrap.indent(text(circuit), "# ", lambda line: True),
        columns=" and ".join(["channel", *circuit.more_inputs]),
        drive="[\n    " + ",\n    ".join(map(str, network.drive[0].tolist())) + ",\n]",
        blocks=w.names,
        driven=driven.tolist(),
        places=w.columns[driven].tolist(),
        gains=w.drive_gains[driven].tolist(),
        parts=written(network.parts | {"timed": timed}),
        source=source(),
        neurons={object_name(name): circuit.population(name).neurons for name in network.spikes},
        readout=w.blocks_of(circuit.readout).tolist(),
        line=circuit.population(circuit.readout),
    )


def source() -> str:
    """Return the source of ``FUNCTIONS``, after the constants that they use."""
    used = {n: f.__globals__.get(n) for f in FUNCTIONS for n in f.__code__.co_names}
    constants = {n: v for n, v in used.items() if isinstance(v, (int, tuple, np.generic))}
    lines = [f"{name} = {value!r}" for name, value in constants.items()]
    return "\n\n\n".join(["\n".join(lines), *map(inspect.getsource, FUNCTIONS)])


def written(value: Any, indent: str = "") -> str:
    """Return a value as Python text."""
    inner = indent + "    "
    if isinstance(value, dict):
        items = "".join(f'\n{inner}"{k}": {written(v, inner)},' for k, v in value.items())
        return f"{{{items}\n{indent}}}" if items else "{}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(written(v, inner) for v in value) + "]"
    if isinstance(value, str):
        code = "\n" in value and not re.search(r'\\|"""', value)
        return f'"""{textwrap.dedent(value)}"""' if code else json.dumps(value)
    if isinstance(value, np.ndarray):
        return array_text(value)
    return repr(value.item() if isinstance(value, np.generic) else value)


def array_text(values: npt.NDArray[Any]) -> str:
    """Return an array as text: one number, a few numbers, or compressed."""
    if (values == values.flat[0]).all():
        return f"np.full({values.shape}, {values.flat[0].item()!r})"
    if values.size <= SHORT:
        return f"np.array({values.tolist()})"
    integral = bool((values == np.round(values)).all())
    steps = np.diff(values.astype(np.int64).ravel(), prepend=0) if integral else values
    kinds = ("<i2", "<i4", "<i8") if integral else ("<f4", "<f8")
    kind = next(kind for kind in kinds if (steps.astype(kind) == steps).all())
    data = base64.b85encode(zlib.compress(steps.astype(kind).tobytes(), 9)).decode()
    return f'unpacked("{kind}", "{data}")' + f".reshape({values.shape})" * (values.ndim > 1)
