"""What a run takes: estimates grow as the work does, and are said in round numbers."""

import numpy as np
import pytest

from circuits import anatomy
from circuits.cost import CELL_BYTES, CELL_S, about, cells, memory_bytes, run_s
from circuits.engines import ENGINES, run
from circuits.engines.ensemble.plan import plan, workspace
from circuits.ticks import Clock
from circuits.wiring import wire

TABLE = anatomy.spiking_msprt()


@pytest.mark.parametrize("engine", ENGINES)
def test_time_grows_with_the_circuit_and_what_is_simulated(engine):
    one = run_s(TABLE, engine, 10.0)
    assert one > 0
    assert run_s(TABLE, engine, 20.0) == pytest.approx(2 * one)
    assert run_s(TABLE, engine, 10.0, workers=2) == pytest.approx(one / 2)
    assert run_s(TABLE.with_channels(4), engine, 10.0) > 1.8 * one


def test_speeds_are_those_that_were_measured():
    """Simulated seconds per second of CPU, within a factor of two."""
    assert 70 < 1 / run_s(TABLE, "ensemble", 1.0) < 280
    assert 3500 < 1 / run_s(TABLE, "population", 1.0) < 14_000
    halved = TABLE.with_neurons(150)
    assert cells(halved) == cells(TABLE) / 2
    assert run_s(halved, "ensemble", 1.0) == run_s(TABLE, "ensemble", 1.0) / 2
    coarse = run_s(TABLE, "ensemble", 1.0, dt_ms=0.2)
    assert coarse == run_s(TABLE, "ensemble", 1.0) / 2


def test_ratios_of_speeds_are_those_that_were_measured():
    """Cells in NumPy and in Brian2 beside compiled ones; the fixed point beside populations."""
    of = {engine: run_s(TABLE, engine, 1.0, dt_ms=0.1) for engine in ENGINES}
    assert of["ensemble"] == pytest.approx(CELL_S["ensemble"] * cells(TABLE))
    assert of["brian2"] / of["ensemble"] == pytest.approx(400)
    assert of["plain"] / of["ensemble"] == pytest.approx(300)
    assert of["algebra"] / of["population"] == pytest.approx(3)


@pytest.mark.parametrize("engine", ["algebra", "rate", "population"])
def test_memory_of_engines_without_cells_is_that_of_what_they_return(engine):
    """The fixed point takes half as much again as its rates on the way."""
    drive = np.zeros((3, 4, 2))
    found = run(TABLE, drive, engine=engine, step_ms=5, seed=1)
    samples, rates = found.output_nats.shape[1], sum(x.nbytes for x in found.rates_hz.values())
    given = (TABLE, engine, 3, samples)
    whole = found.output_nats.nbytes + rates * (1.5 if engine == "algebra" else 1)
    assert memory_bytes(*given, rates=True, workers=1) == whole
    out = whole if engine == "algebra" else found.output_nats.nbytes
    assert memory_bytes(*given, rates=False, workers=2) == out


def test_memory_of_cells_is_that_of_what_each_thread_or_trial_works_in():
    given = {"trials": 10, "samples": 50, "rates": True}
    of = {
        (engine, workers): memory_bytes(TABLE, engine, workers=workers, **given)
        for engine in ("ensemble", "brian2", "plain")
        for workers in (1, 2)
    }
    kept = memory_bytes(TABLE, "population", workers=1, **given)
    each = (of["ensemble", 1] - kept) / cells(TABLE)
    wiring = wire(TABLE)
    work = workspace(plan(wiring, Clock(1, 50), np.zeros(wiring.blocks, bool)))
    assert sum(part.nbytes for part in work) / cells(TABLE) == pytest.approx(each, rel=0.2)
    assert of["ensemble", 2] - of["ensemble", 1] == each * cells(TABLE)
    assert of["brian2", 2] - kept == pytest.approx(10 * 2.5 * each * cells(TABLE))
    assert of["plain", 1] - kept == pytest.approx(2.5 * each * cells(TABLE))


def test_a_sparse_pathway_takes_eight_bytes_per_connection_and_one_per_pair():
    """600 cells reach 600; no pathway that is not sparse, or not from cells to cells, takes any."""
    sparse = TABLE.with_projection("STN", "GPe", probability=0.25)
    given = {"trials": 1, "samples": 1, "rates": False, "workers": 1}
    more, less = (memory_bytes(of, "ensemble", **given) for of in (sparse, TABLE))
    assert more - less == 600 * 600 * 3
    out = 2 * 8  # one sample of two channels
    assert less - out == CELL_BYTES["ensemble"] * cells(TABLE)


def test_an_unknown_engine_is_refused():
    with pytest.raises(ValueError, match=r"engine must be one of algebra, .*, got 'spikes'"):
        run_s(TABLE, "spikes", 1.0)


@pytest.mark.parametrize(
    ("seconds", "said"),
    [
        (0.1, "about 1 second"),
        (3.4, "about 3 seconds"),
        (47, "about 50 seconds"),
        (89, "about 90 seconds"),
        (91, "about 2 minutes"),
        (640, "about 10 minutes"),
        (5600, "about 2 hours"),
        (2e6, "about 600 hours"),
    ],
)
def test_a_duration_is_said_with_one_significant_figure(seconds, said):
    assert about(seconds) == said
