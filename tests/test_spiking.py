"""The Brian2 engine: the spikes of the plain reference, whatever it is compiled to."""

import shutil
import subprocess
import sys
import warnings
from dataclasses import dataclass, replace

import numpy as np
import numpy.testing as npt
import pytest
import reference
from scipy.special import log_softmax

from circuits import anatomy, noise
from circuits.cells import Escape, Integrator, Lif, Phase
from circuits.engines.brian2 import noise as brian_noise
from circuits.engines.brian2 import run as spiking
from circuits.engines.brian2 import text as brian_text
from circuits.spec import GABA, Circuit, Population, Projection

# Brian2 2.9 calls pyparsing by its old names.

STEPS = {"step_ms": 10, "settle_ms": 30}
DRIVE = np.array([[[0.4, -0.2], [0.9, -0.5], [1.5, -1.5]], [[0.0, 0.3], [-0.5, 0.6], [-1.0, 1.0]]])
WHOLE = anatomy.spiking_msprt().with_neurons(12)


def small():
    """Return three kinds of cells, a unit of rate and a unit without leak: quick to compile."""
    cell = Lif(10, 4, 15, 3, 2, rest_mv=11, mv_per_nat=6)
    neurons = {"neurons": 10}
    return Circuit(
        name="small",
        populations=(
            Population("ctx", Phase(0.5), 20, 20, transfer="rectified", tau_ms=5, **neurons),
            Population("slow", Integrator(), 0, 1, GABA, pooled=True, bias_nats=-4, tau_ms=50),
            Population("STN", Escape(1.0), 5, 20, tau_ms=3, spread=0.2, **neurons),
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


def cells_of(circuit):
    return tuple(row.name for row in circuit.populations if row.spiking)


def assert_same(a, b):
    assert set(a.spikes) == set(b.spikes)
    order = ["trial", "channel", "time_ms", "neuron"]
    for name, table in b.spikes.items():
        assert len(table), f"{name} is silent: nothing is tested"
        rows = [t.spikes[name].sort_values(order)[order].to_numpy().round(6) for t in (a, b)]
        npt.assert_array_equal(*rows, err_msg=name)
    for name, rates in b.rates_hz.items():
        npt.assert_allclose(a.rates_hz[name], rates, atol=1e-9, err_msg=name)
    npt.assert_allclose(a.output_nats, b.output_nats, atol=1e-11)
    npt.assert_allclose(a.time_ms, b.time_ms)


def both(circuit, drive=DRIVE, target="numpy", **options):
    given = STEPS | {"seed": 5, "spikes": cells_of(circuit)} | options
    fast = spiking.run(circuit, drive, target=target, **given)
    given.pop("explicit", None)
    return fast, reference.run(circuit, drive, **given)


@pytest.mark.parametrize(
    "circuit",
    [
        WHOLE,
        WHOLE.with_spread(0.15),
        WHOLE.with_connections(0.3).with_spread(0.1),
        WHOLE.without("D2", 0.5, replaced=True).without("GPe"),
        small(),
        replace(small(), wiring_seed=3).scaled("ctx", "SNr", 0),
        small().scaled("ctx", "STN", 0.5, 0).scaled("SNr", "SNr", 2, 1),
    ],
    ids=["whole", "spread", "sparse", "lesioned", "small", "other wires", "one channel"],
)
def test_spikes_are_those_of_the_reference(circuit):
    assert_same(*both(circuit))


def test_relays_are_n_squared_synapses():
    assert_same(*both(WHOLE, DRIVE[:, :2], explicit=True))
    everywhere = replace(small(), projections=small().projections[:3])
    everywhere = replace(
        everywhere, populations=tuple(p for p in everywhere.populations if p.spiking)
    )
    assert_same(*both(everywhere, explicit=True))


def test_any_grid_of_time():
    """Settling that is no multiple of a sample, another tick, three channels."""
    drive = np.array([[[0.5, 0.0, -0.5], [1.0, 0.2, -1.2]]])
    options = {"dt_ms": 0.25, "step_ms": 37.5, "settle_ms": 10.75, "sample_ms": 1.5}
    assert_same(*both(WHOLE.with_channels(3), drive, **options))
    assert_same(*both(small().with_channels(3), drive, **options | {"settle_ms": 0}))


def test_a_trial_has_its_noise_whatever_runs_beside_it():
    given = STEPS | {"seed": 5, "spikes": ("SNr",), "target": "numpy"}
    two = spiking.run(small(), DRIVE, **given)
    one = spiking.run(small(), DRIVE[1:], first_trial=1, **given)
    npt.assert_array_equal(one.output_nats[0], two.output_nats[1])
    rows = two.spikes["SNr"].query("trial == 1").drop(columns="trial")
    npt.assert_array_equal(one.spikes["SNr"].drop(columns="trial"), rows)
    assert one.about == {"seed": 5, "first_trial": 1, "dt_ms": 0.1, "settle_ms": 30}


def test_a_table_of_rates_settles_at_the_log_posterior():
    y = np.array([0.6, -0.4, 0.1])
    drive = np.tile(y, (1, 25, 1))
    out = spiking.run(anatomy.bogacz_gurney(3), drive, step_ms=10, seed=1, target="numpy")
    npt.assert_allclose(out.output_nats[0, -1], -log_softmax(y), atol=1e-6)
    assert out.spikes is None


def test_one_program_runs_many_times():
    given = {"spikes": cells_of(small()), "steps": 3} | STEPS
    with spiking.Standalone(small(), 2, **given) as program:
        for seed in (1, 2):
            expected = reference.run(small(), DRIVE, seed=seed, spikes=given["spikes"], **STEPS)
            assert_same(program.run(DRIVE, seed=seed), expected)
        # Brian2 is where it was between two runs of a program.
        npt.assert_allclose(
            spiking.run(small(), DRIVE, seed=2, target="numpy", **STEPS).output_nats,
            expected.output_nats,
        )
        weights = {"ctx->SNr": 0.6, "SNr->SNr": -0.3}
        heavier = (
            small()
            .with_projection("ctx", "SNr", weight=0.6)
            .with_projection("SNr", "SNr", weight=-0.3)
        )
        ran = program.run(-DRIVE, seed=2, first_trial=7, weights=weights)
        assert ran.circuit == heavier
        options = STEPS | {"spikes": given["spikes"], "first_trial": 7}
        assert_same(ran, reference.run(heavier, -DRIVE, seed=2, **options))
        with pytest.raises(ValueError, match="2 trials of 3 steps, got"):
            program.run(DRIVE[:1], seed=1)
        with pytest.raises(ValueError, match="GABA"):
            program.run(DRIVE, seed=1, weights={"SNr->SNr": 0.3})
        assert program.directory.exists()
    assert not program.directory.exists()


@pytest.mark.validate
@pytest.mark.parametrize(
    ("target", "circuit"),
    [("cython", small()), ("standalone", WHOLE.with_connections(0.3).with_spread(0.1))],
    ids=["cython", "standalone"],
)
def test_compiled_spikes_are_those_of_the_reference(target, circuit):
    assert_same(*both(circuit, target=target))


def test_noise_is_that_of_every_engine():
    streams = noise.stream_keys(7, np.arange(3, 6), ["GPe", "GPe/0"])
    assert streams[0, 0] == 0x8E49DEDA421CF417
    for stream in streams.ravel():
        for tick in (0, 1, 6, 12345):
            key = brian_noise.tick_key(np.array([stream]).astype(np.int64), np.array([tick // 4]))
            cells = np.arange(50)
            words = brian_noise.random_word(cells, key)
            npt.assert_array_equal(words.view(np.uint32), noise.words(int(stream), tick // 4, 50))
            npt.assert_array_equal(brian_noise.chance(words), words.view(np.uint32) / 2.0**32)
            gauss = brian_noise.gauss(brian_noise.byte_counts(cells, key), np.array([tick]))
            npt.assert_array_equal(gauss, noise.bits8(int(stream), tick, 50))


def test_a_cell_type_of_your_own(monkeypatch):
    """A cell that fires by the clock: its rate is exact, its phase the seed's."""

    @dataclass(frozen=True)
    class Clockwork(Phase):
        cv: float = 0.0

    row = Population("ctx", Clockwork(), 40, 20, tau_ms=5, neurons=10)
    circuit = replace(small(), populations=(row, *small().populations[1:]))
    given = STEPS | {"seed": 1, "target": "numpy"}
    with pytest.raises(
        ValueError, match="ctx: CELL_TEXT has no Clockwork, only Lif, Phase, Escape"
    ):
        spiking.run(circuit, DRIVE, **given)
    tick = "phi = phi + hz*dt_s"
    text = replace(brian_text.CELL_TEXT[Phase], tick=tick)
    monkeypatch.setitem(brian_text.CELL_TEXT, Clockwork, text)
    ran = spiking.run(circuit, DRIVE, **given)
    phase = replace(small(), populations=(replace(row, cell=Phase(0)), *small().populations[1:]))
    npt.assert_array_equal(ran.output_nats, spiking.run(phase, DRIVE, **given).output_nats)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"target": "gpu"}, "target must be one of auto, standalone, cython, numpy, got 'gpu'"),
        ({"spikes": ("slow",)}, "slow has no cells that spike"),
        ({"spikes": ("STNN",)}, "no nucleus 'STNN'"),
        ({"settle_ms": 0.05}, "settle_ms of 0.05 ms is no multiple of dt_ms"),
        ({"seed": -1}, "seed must be"),
    ],
)
def test_what_does_not_fit_is_said_at_once(options, message):
    with pytest.raises(ValueError, match=message):
        spiking.run(small(), DRIVE, **STEPS | {"seed": 1, "target": "numpy"} | options)


def test_without_a_compiler(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    for target in ("standalone", "cython"):
        with pytest.raises(OSError, match=f"target '{target}' needs a C\\+\\+ compiler") as e:
            spiking.run(small(), DRIVE, seed=1, target=target, **STEPS)
        assert "\n" not in str(e.value)
    given = STEPS | {"seed": 1}
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=".*compiler")
        quick = spiking.run(small(), DRIVE, **given)
    monkeypatch.setattr(spiking, "COMPILE_S", 0)
    with pytest.warns(UserWarning, match="needs a C\\+\\+ compiler.*NumPy it is"):
        slow = spiking.run(small(), DRIVE, **given)
    npt.assert_array_equal(quick.output_nats, slow.output_nats)


def test_auto_takes_what_is_done_first(monkeypatch):
    took = []
    monkeypatch.setattr(spiking.Standalone, "__init__", lambda *_, **given: took.append(given))
    monkeypatch.setattr(spiking.Standalone, "run", lambda *_, **given: took.append(given))
    monkeypatch.setattr(spiking.Standalone, "close", lambda _: None)
    monkeypatch.setattr(spiking, "need_compiler", lambda _: None)
    long = np.zeros((50, 100, 2))
    spiking.run(anatomy.spiking_msprt(), long, seed=1, step_ms=10)
    assert [took[0]["steps"], took[1]["seed"]] == [100, 1]


def test_import_is_light_and_errors_stay_ours():
    code = (
        "import sys, circuits.engines.brian2.run; print('brian2' in sys.modules);"
        "from circuits.engines.brian2.noise import load_brian; hook = sys.excepthook; load_brian();"
        "print(sys.excepthook is hook)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"]
