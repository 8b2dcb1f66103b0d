"""A trial exported as a Brian2 network and as a script has the spikes of the engine."""

import ast
import re
import subprocess
import sys
from dataclasses import dataclass, replace
from typing import ClassVar

import brian2
import numpy as np
import numpy.testing as npt
import pandas as pd
import pytest

from circuits import anatomy
from circuits.cells import Cell, cell
from circuits.circuit import Circuit
from circuits.declaration.rows import Population, Projection
from circuits.dynamics.wiring import wire
from circuits.engines import Brian2, run
from tests.helpers import refused

STEP_MS, SETTLE_MS, SEED, TRIAL = 4.0, 2.0, 5, 3
DRIVE = np.array([[[0.4, -0.2], [0.9, -0.5], [1.5, -1.5]]])
COLUMNS = ["population", "channel", "neuron", "time_ms"]
WHOLE = anatomy.spiking_msprt().with_neurons(12)
CIRCUITS = {
    "whole": WHOLE,
    "cells that differ, sparse": WHOLE.with_connections(0.3).with_heterogeneity(0.1),
    "courses and a lesion": WHOLE.lesion("GPe", 0.5).edited(
        "add dopamine amount=0.2 from_ms=2 to_ms=7 decay_ms=4",
        "add STN amount=-1 from_ms=5 to_ms=10",
    ),
    "more inputs": WHOLE.with_inputs("STN", "GPe[0]"),
    "rates": anatomy.bogacz_gurney(),
    "two receptors": WHOLE.edited(
        "set STN->SNr.synapse AMPA", "add STN->SNr NMDA like=STN->SNr weight=0.2 tau_ms=20"
    ),
}


def engine_of(circuit):
    cells = circuit.spiking()
    return Brian2(spikes=cells, settle_ms=SETTLE_MS)


def drive_of(circuit):
    more = np.linspace(0.5, -0.5, 3)[None, :, None] * np.ones(len(circuit.more_inputs))
    return np.concatenate([DRIVE, more], axis=2)


def clocked(circuit):
    return {"step_ms": STEP_MS, "seed": SEED, "engine": engine_of(circuit)}


def ordered(spikes):
    return spikes[COLUMNS].sort_values(COLUMNS).reset_index(drop=True)


@pytest.mark.parametrize("name", CIRCUITS)
def test_a_script_and_a_network_have_the_spikes_and_the_out_of_the_engine(name, tmp_path):
    circuit = CIRCUITS[name]
    drive, options = drive_of(circuit), clocked(circuit)
    ran = run(circuit, drive, **options, first_trial=TRIAL)
    text = circuit.to_brian2_script(drive, **options, trial=TRIAL)
    (tmp_path / "trial.py").write_text(text)
    command = [sys.executable, "trial.py", "spikes.csv"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    out = [float(word) for word in done.stdout.splitlines()[-1].split()[2:]]
    npt.assert_allclose(out, ran.output_nats[0, -1], atol=6e-5)
    network = circuit.to_brian2(drive, **options, trial=TRIAL)
    network.run((SETTLE_MS + 3 * STEP_MS + 0.1) * brian2.ms, namespace={})
    hz = np.array(network["samples"].out_hz)[wire(circuit).blocks_of(circuit.readout), -1]
    row = circuit[circuit.readout]
    npt.assert_allclose((hz - row.baseline_hz) / row.gain_hz_per_nat, ran.output_nats[0, -1])
    if not ran.spikes:
        return
    expected = ordered(ran.spike_table())
    assert len(expected) > 40
    written = ordered(pd.read_csv(tmp_path / "spikes.csv"))
    npt.assert_array_equal(written.to_numpy(), expected.to_numpy())
    for nucleus in ran.spikes:
        monitor = network[f"spikes_{nucleus}"]
        tick = np.round(np.array(monitor.t / monitor.clock.dt)).astype(int) - 20
        kept = (tick >= 0) & (tick < 120)
        fired = {"cell": np.array(monitor.i)[kept], "time_ms": (tick[kept] + 1) * 0.1}
        spikes = pd.DataFrame(fired)
        ours = ran.spikes[nucleus]
        cells = circuit[nucleus].neurons * ours["channel"] + ours["neuron"]
        both = (spikes, ours.assign(cell=cells)[["cell", "time_ms"]])
        npt.assert_array_equal(*(each.sort_values(["cell", "time_ms"]) for each in both))


def imported(text):
    """Return the names of the modules that a script imports."""
    nodes = (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.stmt))
    modules = (node for node in nodes if isinstance(node, ast.Import | ast.ImportFrom))
    return {getattr(node, "module", None) or node.names[0].name for node in modules}


def test_a_script_imports_brian2_and_numpy_alone_and_names_every_source():
    circuit = anatomy.macaque().with_neurons(4)
    text = circuit.to_brian2_script(DRIVE, step_ms=STEP_MS, seed=SEED)
    found = imported(text)
    wanted = {"__future__", "base64", "brian2", "numpy", "sys", "typing", "zlib"}
    assert {name.partition(".")[0] for name in found} == wanted
    comments = re.sub(r"\n#? +", " ", text)  # with long lines whole again
    assert all(row.cite in comments for row in (*circuit.populations, *circuit.projections))


def test_words_of_a_users_table_stay_text_in_a_script():
    """Names and sources may hold what Python takes for code."""
    cite = 'says "so" \\ """ {nothing}\nimport os'
    circuit = replace(WHOLE.with_population("GPe", cite=cite), name='a"""b\\')
    script = circuit.to_brian2_script(DRIVE, step_ms=STEP_MS, seed=SEED)
    texts = [node.value for node in ast.walk(ast.parse(script)) if isinstance(node, ast.Constant)]
    assert any(cite in text for text in texts if isinstance(text, str))
    assert "os" not in imported(script)


@dataclass(frozen=True)
class Silent(Cell):
    """A cell type without Brian2 code."""

    state: ClassVar[tuple[str, ...]] = ("v",)


def test_what_brian2_cannot_run_is_refused_by_its_field(monkeypatch):
    monkeypatch.setitem(cell.CELLS, "Silent", Silent)
    lacking = WHOLE.with_population("GPe", cell=Silent())
    both = tuple(Population(name, WHOLE["ctx"].cell, 5) for name in ("ctx", "blocks"))
    clashing = Circuit("clash", both, (Projection("ctx", "blocks", 1.0),), readout="blocks")
    for export in ("to_brian2", "to_brian2_script"):
        with refused("cell"):
            getattr(lacking, export)(DRIVE, step_ms=STEP_MS, seed=SEED)
        with refused("name"):
            getattr(clashing, export)(DRIVE, step_ms=STEP_MS, seed=SEED)
        with refused("drive"):
            getattr(WHOLE, export)(DRIVE[0], step_ms=STEP_MS, seed=SEED)
        with refused("seed"):
            getattr(WHOLE, export)(DRIVE, step_ms=STEP_MS, seed=-1)
        with refused("trial"):
            getattr(WHOLE, export)(DRIVE, step_ms=STEP_MS, seed=1, trial=-1)
    with refused("drive"):
        WHOLE.to_brian2_script(np.repeat(DRIVE, 2, axis=0), step_ms=STEP_MS, seed=SEED)
