"""Every unknown name gets one sentence that lists the known ones."""

from dataclasses import replace

from circuits.circuit import Circuit
from circuits.declaration.transfer import TRANSFERS
from tests.circuits.spiking import BASE, GIVEN, lacking, one_sentence


def test_a_transfer_that_an_engine_does_not_know_is_refused_by_it(monkeypatch):
    monkeypatch.setitem(TRANSFERS, "square", TRANSFERS["rectified"])
    rows = (replace(p, transfer="square") if p.name == "ctx" else p for p in BASE.populations)
    circuit = replace(BASE, populations=tuple(rows))
    one_sentence(lambda: lacking("ensemble")(circuit), "transfers", "square", "brian2")
    assert isinstance(circuit, Circuit)
    assert lacking("plain")(circuit).output_nats.shape == (2, round(GIVEN["step_ms"]), 2)
