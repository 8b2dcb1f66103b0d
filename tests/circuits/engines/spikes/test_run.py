"""The compiled engine has the spikes of the plain engine, independent of other trials."""

from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest

from circuits.cells import Lif, Phase, Rate, register
from circuits.declaration.rows import Projection
from circuits.declaration.transfer import TRANSFERS
from circuits.engines.spikes import cells as compiled_cells
from circuits.engines.spikes import kernel
from circuits.engines.spikes import run as spikes
from circuits.errors import EditWarning
from tests.circuits.helpers import run_plain, run_spikes
from tests.circuits.spiking import (
    BASE,
    GIVEN,
    kind_of,
    lacking,
    spike_set,
    spikes_of,
)
from tests.helpers import refused

NAMES = ("ctx", "D1", "D2", "STN", "GPe", "SNr")


def ramp(trials, steps, channels=2, top=1.4):
    """Evidence that grows for a channel in turn, (trials, steps, channels)."""
    drive = np.zeros((trials, steps, channels))
    drive[np.arange(trials), :, np.arange(trials) % channels] = np.linspace(0, top, steps)
    return drive - drive.mean(axis=2, keepdims=True)


def both(circuit, drive, **options):
    settings = {"step_ms": 40, "seed": 7, "settle_ms": 60, "spikes": NAMES} | options
    return run_spikes(circuit, drive, **settings), run_plain(circuit, drive, **settings)


@pytest.mark.parametrize(
    "circuit",
    [
        pytest.param(BASE.with_connections(0.25), id="sparse", marks=pytest.mark.validate),
        pytest.param(
            BASE.with_connections(0.25).scale("ctx->D1", 0.9, 0).scale("STN->GPe", 0, 1),
            id="one channel",
            marks=pytest.mark.validate,
        ),
        pytest.param(
            BASE.with_connections(0.25).lesion("D1", 0.25, channel=0).lesion("D2", 1, channel=1),
            id="lost in one channel",
        ),
        pytest.param(BASE.with_heterogeneity(0.1).with_connections(0.25), id="both"),
    ],
)
def test_sparse_inputs_make_cells_spike_as_in_the_plain_scheme_up_to_single_precision(circuit):
    fast, plain = both(circuit, ramp(2, 2))
    for name in NAMES:
        a, b = spike_set(fast, name), spike_set(plain, name)
        # A potential within a rounding of the threshold fires a tick early or late, and takes
        # with it the later spikes of its cell.
        assert len(a ^ b) <= 0.03 * len(b)
    npt.assert_allclose(fast.output_nats, plain.output_nats, atol=0.03)


@pytest.mark.parametrize("circuit", [BASE, BASE.with_heterogeneity(0.1).with_connections(0.25)])
def test_the_same_bytes_for_any_batch_order_and_number_of_workers(circuit):
    drive = ramp(20, 3)
    settings = {"step_ms": 20, "seed": 3, "settle_ms": 20}
    one_batch = run_spikes(circuit, drive, **settings)
    threads = run_spikes(circuit, drive, workers=2, **settings)
    parts = [run_spikes(circuit, drive[i : i + 7], first_trial=i, **settings) for i in (14, 0, 7)]
    batches = np.concatenate([parts[1].output_nats, parts[2].output_nats, parts[0].output_nats])
    assert one_batch.output_nats.tobytes() == threads.output_nats.tobytes() == batches.tobytes()
    for name in NAMES:
        assert one_batch.rates_hz[name].tobytes() == threads.rates_hz[name].tobytes()


@pytest.mark.parametrize(
    "circuit",
    [
        # Loops over cells that are alike are compiled once more for a window of a tick.
        pytest.param(BASE, marks=pytest.mark.validate),
        pytest.param(BASE.with_heterogeneity(0.1), marks=pytest.mark.validate),
        BASE.with_heterogeneity(0.1).with_connections(0.25),
    ],
)
def test_neither_windows_nor_recording_change_a_spike(circuit, monkeypatch):
    settings = {"step_ms": 20.1, "sample_ms": 0.3, "seed": 3, "settle_ms": 20.3}
    recorded = run_spikes(circuit, ramp(2, 3), spikes=NAMES, **settings)
    unrecorded = run_spikes(circuit, ramp(2, 3), **settings)
    monkeypatch.setattr(kernel, "WINDOW", 1)
    one = run_spikes(circuit, ramp(2, 3), spikes=NAMES, **settings)
    for other in (unrecorded, one):
        assert other.output_nats.tobytes() == recorded.output_nats.tobytes()
    for name in NAMES:
        assert one.spikes[name].equals(recorded.spikes[name])


def test_what_lies_downstream_never_changes_what_lies_upstream():
    drive = ramp(2, 2)
    settings = {"step_ms": 40, "seed": 3, "spikes": ("ctx", "D1", "STN", "GPe")}
    intact = spike_set(run_spikes(BASE, drive, **settings))
    fewer = BASE.with_population("SNr", neurons=10).with_cell("SNr", noise_mv=1.0)
    for edited in (fewer, BASE.lesion("D1", 0.5), BASE.scale("STN->SNr", 0.2)):
        assert spike_set(run_spikes(edited, drive, **settings)) == intact


def test_more_spikes_than_room_are_all_there(monkeypatch):
    settings = {"step_ms": 40, "seed": 7, "spikes": NAMES}
    plenty = run_spikes(BASE, ramp(1, 2), **settings)
    monkeypatch.setattr(spikes, "FIRST_CAPACITY", 5)
    assert spike_set(run_spikes(BASE, ramp(1, 2), **settings)) == spike_set(plenty)


def test_strong_inhibition_is_not_taken_for_a_refractory_period():
    fast, plain = both(BASE.scale("D1->SNr", 60), ramp(2, 3, top=3.0))
    assert spike_set(fast, "SNr") == spike_set(plain, "SNr")


def test_an_edit_without_a_state_of_rest_warns():
    runaway = BASE.with_rows(Projection("STN", "STN", 0.5, "diffuse", delay_ms=2)).lesion("common")
    with pytest.warns(EditWarning, match="has no resting state after these edits"):
        run_spikes(runaway, ramp(1, 1), step_ms=20, seed=1, settle_ms=10)


def registered(circuit):
    """Return a circuit whose cell types are registered anew, alike in all but their name."""
    twin = {kind: register(kind_of(kind, f"Own{kind.__name__}")) for kind in (Lif, Phase)}
    twin[Rate] = Rate
    rows = (replace(p, cell=twin[type(p.cell)](**vars(p.cell))) for p in circuit.populations)
    return replace(circuit, populations=tuple(rows))


@pytest.mark.parametrize("heterogeneity", [0.0, 0.1])
def test_loops_of_their_own_give_the_spikes_of_the_tick_as_it_stands(heterogeneity):
    """The compiled engine's fast loops against its general one: the same type by another name."""
    circuit = BASE.with_heterogeneity(heterogeneity)
    twin = registered(circuit)
    assert compiled_cells.entry(twin.population("GPe").cell) is compiled_cells.GENERAL
    assert compiled_cells.entry(circuit.population("GPe").cell) is not compiled_cells.GENERAL
    assert spikes_of(circuit, "spikes") == spikes_of(twin, "spikes")


def test_types_of_ones_own_with_sparse_connections_spike_as_in_the_plain_engine():
    twin = registered(BASE.with_connections(0.25).with_heterogeneity(0.1))
    fast, plain = spikes_of(twin, "spikes"), spikes_of(twin, "plain")
    assert len(fast ^ plain) <= 0.03 * len(plain)


def test_a_transfer_that_an_engine_does_not_know_is_refused_by_it(monkeypatch):
    monkeypatch.setitem(TRANSFERS, "square", TRANSFERS["rectified"])
    circuit = BASE.with_population("ctx", transfer="square")
    with refused("transfer square"):
        lacking("spikes")(circuit)
    assert lacking("plain")(circuit).output_nats.shape == (2, round(GIVEN["step_ms"]), 2)
