"""Custom cell types in the compiled engine."""

from dataclasses import dataclass, replace

import pytest

from circuits.cells import Lif, Phase, Rate, register
from circuits.declaration.transfer import TRANSFERS
from circuits.engines.spikes import cells as compiled_cells
from tests.circuits.spiking import (
    BASE,
    GIVEN,
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
    assert spikes_of(circuit, "spikes") == spikes_of(twin, "spikes")


def test_types_of_ones_own_with_sparse_connections_spike_as_in_the_plain_engine():
    twin = registered(BASE.with_connections(0.25).with_heterogeneity(0.1))
    fast, plain = spikes_of(twin, "spikes"), spikes_of(twin, "plain")
    assert len(fast ^ plain) <= 0.03 * len(plain)


def test_a_transfer_that_an_engine_does_not_know_is_refused_by_it(monkeypatch):
    monkeypatch.setitem(TRANSFERS, "square", TRANSFERS["rectified"])
    circuit = BASE.with_population("ctx", transfer="square")
    one_sentence(lambda: lacking("spikes")(circuit), "transfers", "square", "brian2")
    assert lacking("plain")(circuit).output_nats.shape == (2, round(GIVEN["step_ms"]), 2)
