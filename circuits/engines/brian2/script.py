"""One trial as a script that needs Brian2 and NumPy only: the engine's functions and their data."""

from __future__ import annotations

import base64
import inspect
import textwrap
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from circuits.cells.single import choose, exponential, fused, single
from circuits.dynamics.noise import byte_counts, lowbias32, mix_all
from circuits.engines.brian2 import noise
from circuits.engines.brian2.network import Network, assembled, object_name
from circuits.errors import require
from circuits.show import text

SHORT = 60
"""Longest array that is written as numbers."""
FUNCTIONS: tuple[Callable[..., Any], ...] = (
    *(mix_all, lowbias32, byte_counts, single, fused, choose, exponential),
    *(noise.unsigned, noise.keys_at, noise.random_word, noise.noise_bytes, noise.ones_at),
    *(noise.functions, noise.as_brian, assembled),
)
"""Functions of which a script holds the source: those that ``assembled`` calls, and itself."""

SCRIPT = '''\
"""{name}: trial {trial} of seed {seed} in Brian2, spike for spike.

It needs brian2 and numpy only. `python THIS.py` prints mean rates and the last OUT, and `python
THIS.py spikes.csv` writes every spike, too. Inputs and OUT are in {unit}, rates in Hz. The first
reading of evidence comes after {settle:g} ms at rest.

`groups` lists the cells of each nucleus, channel by channel; "blocks", which sum the inputs of one
channel of a nucleus and count its spikes; the inputs of blocks ("shared_inputs") or of single cells
("own_inputs"), which filter what arrives by one pathway; and the delay line of the blocks' rates.
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

# ---- evidence, {unit}: a row per reading of {step:g} ms; columns: {columns}

drive = np.array([
    {drive},
])
BLOCKS = {blocks}
readings = np.zeros((len(drive), len(BLOCKS)))
readings[:, {driven}] = {gains} * drive[:, {places}]

# ---- numbers of single cells and connections, compressed


def unpacked(kind: str, text: str) -> Array:
    """Return numbers, or, of whole numbers, the sums of the steps between them."""
    values = np.frombuffer(zlib.decompress(base64.b85decode(text)), kind)
    return np.cumsum(values, dtype=np.int64) if kind[1] == "i" else values.astype(np.float64)


arrays = {arrays}

# ---- the circuit; a "stream" is the key of a block's noise, from seed, trial and name

groups = {groups}
connections = {connections}
names = {names}
timed = {timed}

# ---- functions: noise of each cell and tick, arithmetic in single precision, the network

{source}

# ---- run, results

network = assembled(
    brian2, groups, connections, names, timed, {monitored}, {dt_ms}, {sample_ticks}
)
network.run(({settle_ticks} + {late} + 1) * {dt_ms} * brian2.ms, namespace={{}})

rows = []
for name, neurons in {neurons}.items():
    monitor = network["spikes_" + name]
    ticks = np.round(monitor.t / monitor.clock.dt).astype(np.int64) - {settle_ticks}
    kept = (ticks >= 0) & (ticks < {late})
    times_ms = (ticks[kept] + 1) * {dt_ms}
    rows += [(name, *divmod(c, neurons), t) for c, t in zip(monitor.i[kept], times_ms)]
    print(name, round(kept.sum() / (monitor.source.N * {late} * {dt_ms} / 1000), 2), "Hz")
samples = network["samples"]
out = (samples.out_hz[{readout}] - {line.baseline_hz}) / {line.gain_hz_per_nat}  # (channels, times)
print("last OUT:", *out[:, -1].round(4))
if sys.argv[1:]:
    with open(sys.argv[1], "w") as file:
        file.write("population,channel,neuron,time_ms\\n")
        file.writelines(",".join(map(str, row)) + "\\n" for row in rows)
'''


def script(network: Network, seed: int, trial: int) -> str:
    """Return the script of a network of one trial.

    Raises
    ------
    InputError
        If it is of several trials.
    """
    layout, clock = network.layout, network.clock
    require(layout.trials == 1, "drive", "must be of one trial in a script", layout.trials)
    w, circuit = layout.wiring, layout.wiring.circuit
    driven = np.flatnonzero(w.columns >= 0)
    arrays: dict[str, str] = {}
    timed = {n: (v, ms) for n, (v, ms) in network.timed.items() if n != "reading"}
    neurons = {object_name(name): circuit.population(name).neurons for name in network.spikes}
    facts = {
        "name": circuit.name,
        "seed": seed,
        "trial": trial,
        "unit": circuit.unit,
        "page": textwrap.indent(text(circuit), "# ", lambda line: True),
        "settle": clock.settle_ms,
        "step": clock.step_ms,
        "columns": ", ".join([*map(str, range(circuit.channels)), *circuit.more_inputs]),
        "drive": ",\n    ".join(str(row) for row in network.drive[0].tolist()),
        "blocks": w.names,
        "driven": driven.tolist(),
        "places": w.columns[driven].tolist(),
        "gains": w.drive_gains[driven].tolist(),
        "groups": written(network.groups, arrays),
        "connections": written(network.connections, arrays),
        "names": written(network.names, arrays),
        "timed": '{"reading": (readings, ' + f"{clock.step_ms})}} | {written(timed, arrays)}",
        "source": source(),
        "monitored": [*neurons],
        "neurons": neurons,
        "dt_ms": clock.dt_ms,
        "sample_ticks": network.sample_ticks,
        "settle_ticks": clock.settle_ticks,
        "late": clock.ticks - clock.settle_ticks,
        "readout": w.blocks_of(circuit.readout).tolist(),
        "line": circuit.population(circuit.readout),
    }
    return SCRIPT.format(**facts, arrays=written(arrays, {}))


def source() -> str:
    """Return the source of ``FUNCTIONS``, after the constants that they use."""
    used = {n: f.__globals__.get(n) for f in FUNCTIONS for n in f.__code__.co_names}
    constants = {n: v for n, v in used.items() if isinstance(v, (int, tuple, np.generic))}
    lines = [f"{name} = {value!r}" for name, value in constants.items()]
    table = f"FUNCTIONS = {written(noise.FUNCTIONS, {})}"
    return "\n\n\n".join(["\n".join(lines), *map(inspect.getsource, FUNCTIONS), table])


def written(value: Any, arrays: dict[str, str], indent: str = "") -> str:
    """Return a value as Python text; long arrays are packed into ``arrays``."""
    inner = indent + "    "
    if isinstance(value, dict) and value:
        items = [f'"{k}": {written(v, arrays, inner)}' for k, v in value.items()]
        return "{" + "".join(f"\n{inner}{item}," for item in items) + f"\n{indent}}}"
    if isinstance(value, (tuple, list)) and value:
        items = [written(v, arrays, inner) for v in value]
        left, right = "()" if isinstance(value, tuple) else "[]"
        line = f"{left}{', '.join(items)}{right if len(items) != 1 else ',' + right}"
        whole = left + "".join(f"\n{inner}{item}," for item in items) + f"\n{indent}{right}"
        return whole if "\n" in line or len(line) > SHORT else line
    if isinstance(value, np.ndarray):
        return array_text(value, arrays)
    if isinstance(value, str) and value.startswith("unpacked("):
        return value
    if isinstance(value, str):
        quote = '"""' if "\n" in value else '"'
        return f"{quote}{textwrap.dedent(value)}{quote}"
    if callable(value):
        return str(value.__name__)
    return repr(value.item() if isinstance(value, np.generic) else value)


def array_text(values: npt.NDArray[Any], arrays: dict[str, str]) -> str:
    """Return an array as one number, as numbers, or as the name of what it is packed into."""
    if values.ndim == 2:
        columns = ", ".join(array_text(column, arrays) for column in values.T.copy())
        return f"np.stack([{columns}], axis=1)"
    if (values == values[0]).all():
        return f"np.full({len(values)}, {values[0].item()!r})"
    if len(values) <= SHORT:
        return f"np.array({values.tolist()})"
    whole = bool((values == np.round(values)).all())
    steps = np.diff(values.astype(np.int64), prepend=0) if whole else values
    kinds = ("<i2", "<i4", "<i8") if whole else ("<f4", "<f8")
    kind = next(kind for kind in kinds if (steps.astype(kind) == steps).all())
    data = base64.b85encode(zlib.compress(steps.astype(kind).tobytes(), 9)).decode()
    name = f"{len(arrays)}"
    arrays[name] = f'unpacked("{kind}", "{data}")'
    return f'arrays["{name}"]'
