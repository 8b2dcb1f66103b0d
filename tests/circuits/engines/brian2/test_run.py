"""The Brian2 engine: the spikes of the plain one."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest

from circuits import anatomy
from circuits.cells import Lif, Phase, Rate
from circuits.circuit import Circuit
from circuits.declaration.rows import GABA, Population, Projection
from tests.circuits.helpers import run_brian2, run_plain
from tests.circuits.spiking import spike_set

STEPS = {"step_ms": 10, "settle_ms": 30}
DRIVE = np.array([[[0.4, -0.2], [0.9, -0.5], [1.5, -1.5]], [[0.0, 0.3], [-0.5, 0.6], [-1.0, 1.0]]])
WHOLE = anatomy.spiking_msprt().with_neurons(12)


def small():
    """Return two kinds of cells and a unit of rate, with every kind of pathway."""
    cell = Lif(10, 4, 15, 3, 2, rest_mv=11, mv_per_nat=6)
    neurons = {"neurons": 10}
    return Circuit(
        name="small",
        populations=(
            Population("ctx", Phase(0.5), 20, 20, transfer="rectified", tau_ms=5, **neurons),
            Population("slow", Rate(signed=True), 0, 1, GABA, pooled=True, bias_nats=-4, tau_ms=50),
            Population("STN", Phase(0.8), 5, 20, tau_ms=3, heterogeneity=0.2, **neurons),
            Population("SNr", cell, 30, 60, GABA, **neurons),
        ),
        projections=(
            Projection("ctx", "STN", 0.2, delay_ms=2, tau_ms=4, probability=0.5),
            Projection("ctx", "SNr", 0.3, delay_ms=1.5, tau_ms=6),
            Projection("STN", "SNr", 0.3, "diffuse", tau_ms=5, transfer="rectified"),
            Projection("STN", "slow", 1, "diffuse", delay_ms=2),
            Projection("slow", "ctx", -0.5, "diffuse", delay_ms=3),
            Projection("SNr", "SNr", -0.1, "neighbour", delay_ms=1),
        ),
        readout_tau_ms=10,
    )


def assert_same(a, b):
    assert spike_set(a) == spike_set(b)
    for name, table in b.spikes.items():
        lost = a.circuit.population(name).intact == 0
        assert bool(len(table)) != lost, f"{name} is silent, so the test is empty"
    for name, rates in b.rates_hz.items():
        npt.assert_allclose(a.rates_hz[name], rates, atol=1e-9, err_msg=name)
    npt.assert_allclose(a.output_nats, b.output_nats, atol=1e-11)
    npt.assert_allclose(a.time_ms, b.time_ms)


def both(circuit, drive=DRIVE, **options):
    arguments = STEPS | {"seed": 5, "spikes": circuit.spiking()} | options
    fast = run_brian2(circuit, drive, **arguments)
    arguments.pop("explicit", None)
    return fast, run_plain(circuit, drive, **arguments)


@pytest.mark.parametrize(
    "circuit",
    [
        WHOLE,
        # Cells that differ are in the next too, which is sparse.
        pytest.param(WHOLE.with_heterogeneity(0.15), marks=pytest.mark.validate),
        WHOLE.with_connections(0.3).with_heterogeneity(0.1),
        WHOLE.clamp("D2", 0.5).lesion("GPe"),
        small(),
        pytest.param(
            replace(small(), wiring_seed=3).scale("ctx->SNr", 0), marks=pytest.mark.validate
        ),
        small().scale("ctx->STN", 0.5, 0).scale("SNr->SNr", 2, 1),
    ],
    ids=["whole", "heterogeneity", "sparse", "lesioned", "small", "other wires", "one channel"],
)
def test_spikes_are_those_of_the_plain_engine(circuit):
    assert_same(*both(circuit))


def test_shared_inputs_give_the_spikes_of_a_synapse_per_pair_of_cells():
    assert_same(*both(WHOLE, DRIVE[:, :2], explicit=True))
    cells = tuple(p for p in small().populations if p.spiking)
    everywhere = replace(small(), populations=cells, projections=small().projections[:3])
    assert_same(*both(everywhere, explicit=True))


def test_spikes_are_those_of_the_plain_engine_on_any_grid_of_time():
    drive = np.array([[[0.5, 0.0, -0.5], [1.0, 0.2, -1.2]]])
    options = {"dt_ms": 0.25, "step_ms": 37.5, "settle_ms": 10.75, "sample_ms": 1.5}
    assert_same(*both(WHOLE.with_channels(3), drive, **options))
    assert_same(*both(small().with_channels(3), drive, **options | {"settle_ms": 0}))


def test_brian2_loads_when_it_runs_and_leaves_the_hook_for_errors():
    code = (
        "import sys, circuits.engines.brian2.run; print('brian2' in sys.modules);"
        "from circuits.engines.brian2.noise import load_brian; hook = sys.excepthook; load_brian();"
        "print(sys.excepthook is hook)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"]
