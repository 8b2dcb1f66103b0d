"""Memory that a run takes: the estimate is what the engines hold."""

import numpy as np
import pytest

from circuits import anatomy
from circuits.cost import CELL_BYTES, cells, memory_bytes
from circuits.dynamics.ticks import Clock
from circuits.dynamics.wiring import wire
from circuits.engines import run
from circuits.engines.ensemble.plan import plan, workspace

TABLE = anatomy.spiking_msprt()


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
        memory_bytes(TABLE, "spikes", 1, 1, rates=True, workers=1)
