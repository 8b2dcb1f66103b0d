"""Custom cell types in the compiled engine."""

from dataclasses import dataclass, replace

import pytest

from circuits.cells import Lif, Phase, Rate, register
from circuits.declaration.transfer import TRANSFERS
from circuits.engines import run
from circuits.engines.ensemble import cells as compiled_cells
from tests.circuits.spiking import (
    BASE,
    DRIVE,
    GIVEN,
    NAMES,
    WITH_ADEX,
    lacking,
    one_sentence,
    spikes_of,
)


def registered(circuit):
    """Return a circuit whose cell types are registered anew, alike in all but their name."""

    @register
    @dataclass(frozen=True)
    class OwnLif(Lif):
        pass

    @register
    @dataclass(frozen=True)
    class OwnPhase(Phase):
        pass

    twin = {Lif: OwnLif, Phase: OwnPhase, Rate: Rate}
    rows = (replace(p, cell=twin[type(p.cell)](**vars(p.cell))) for p in circuit.populations)
    return replace(circuit, populations=tuple(rows))


@pytest.mark.parametrize("heterogeneity", [0.0, 0.1])
def test_loops_of_their_own_give_the_spikes_of_the_tick_as_it_stands(heterogeneity):
    """The compiled engine's fast loops against its general one: the same type by another name."""
    circuit = BASE.with_heterogeneity(heterogeneity)
    twin = registered(circuit)
    assert compiled_cells.entry(twin.population("GPe").cell) is compiled_cells.GENERAL
    assert compiled_cells.entry(circuit.population("GPe").cell) is not compiled_cells.GENERAL
    assert spikes_of(circuit, "ensemble") == spikes_of(twin, "ensemble")


def test_types_of_ones_own_with_sparse_connections_spike_as_in_the_plain_engine():
    twin = registered(BASE.with_connections(0.25).with_heterogeneity(0.1))
    fast, plain = spikes_of(twin, "ensemble"), spikes_of(twin, "plain")
    assert len(fast ^ plain) <= 0.03 * len(plain)


def test_another_window_or_recording_changes_no_spike_of_a_type_of_ones_own(monkeypatch):
    from circuits.engines.ensemble import kernel

    settings = GIVEN | {"step_ms": 20.1, "sample_ms": 0.3, "settle_ms": 20.3}
    recorded = run(WITH_ADEX, DRIVE, engine="ensemble", spikes=NAMES, **settings)
    unrecorded = run(WITH_ADEX, DRIVE, engine="ensemble", **settings)
    monkeypatch.setattr(kernel, "WINDOW", 1)
    one = run(WITH_ADEX, DRIVE, engine="ensemble", spikes=NAMES, **settings)
    for other in (unrecorded, one):
        assert other.output_nats.tobytes() == recorded.output_nats.tobytes()


def test_a_transfer_that_an_engine_does_not_know_is_refused_by_it(monkeypatch):
    monkeypatch.setitem(TRANSFERS, "square", TRANSFERS["rectified"])
    circuit = BASE.with_population("ctx", transfer="square")
    one_sentence(lambda: lacking("ensemble")(circuit), "transfers", "square", "brian2")
    assert lacking("plain")(circuit).output_nats.shape == (2, round(GIVEN["step_ms"]), 2)
