"""Every unknown name gets one sentence that lists the known ones."""

from dataclasses import dataclass, replace

import pytest

from circuits.cells import Lif, Phase, Rate
from circuits.circuit import Circuit
from circuits.declaration.rows import PATTERNS, Population, Projection
from circuits.declaration.transfer import TRANSFERS
from tests.circuits.spiking import BASE, GIVEN, lacking, one_sentence, with_cell


def test_an_unknown_cell_is_refused_wherever_one_is_named():
    @dataclass(frozen=True)
    class Unregistered(Phase):
        pass

    for cell in (Unregistered(0.3), "lif", None, Lif, 3):
        one_sentence(lambda c=cell: Population("X", c), "X: cell must be one of", "Lif")
        one_sentence(lambda c=cell: with_cell(BASE, "GPe", c), "GPe: cell must be one of")


@pytest.mark.parametrize("name", ["tanh", "Linear", "average", ""])
def test_unknown_transfers_and_patterns_are_refused_wherever_they_are_named(name):
    for call in (
        lambda: Population("X", Rate(), transfer=name),
        lambda: Projection("ctx", "D1", 1, transfer=name),
    ):
        one_sentence(call, "transfer must be one of", *TRANSFERS)
    one_sentence(lambda: Projection("ctx", "D1", 1, pattern=name), "pattern must be", *PATTERNS)


def test_a_transfer_that_an_engine_does_not_know_is_refused_by_it(monkeypatch):
    monkeypatch.setitem(TRANSFERS, "square", TRANSFERS["rectified"])
    rows = (replace(p, transfer="square") if p.name == "ctx" else p for p in BASE.populations)
    circuit = replace(BASE, populations=tuple(rows))
    one_sentence(lambda: lacking("ensemble")(circuit), "transfers", "square", "brian2")
    assert isinstance(circuit, Circuit)
    assert lacking("plain")(circuit).output_nats.shape == (2, round(GIVEN["step_ms"]), 2)
