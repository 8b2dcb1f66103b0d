"""Memory that a run takes: the estimate is what the engines hold."""

import numpy as np
import pytest

from circuits import anatomy
from circuits.dynamics.ticks import Clock
from circuits.dynamics.wiring import wire
from circuits.engines import engine_of, run
from circuits.engines.memory import blocks, cells
from circuits.engines.spikes.plan import plan, workspace

TABLE = anatomy.spiking_msprt()


@pytest.mark.parametrize("name", ["algebra", "rate", "population"])
def test_memory_of_engines_without_cells_is_that_of_what_they_return(name):
    """The fixed point takes half as much again as its rates on the way."""
    engine = engine_of(name)
    activity = run(TABLE, np.zeros((3, 4, 2)), engine=engine, step_ms=5, seed=1)
    samples = activity.output_nats.shape[1]
    rates = sum(x.nbytes for x in activity.rates_hz.values())
    bytes_needed = activity.output_nats.nbytes + rates * (1 if engine.timed else 1.5)
    assert engine.memory_bytes(TABLE, 3, samples) == bytes_needed
    out = activity.output_nats.nbytes if engine.drops else bytes_needed
    assert engine.tuned(workers=2, rates=False).memory_bytes(TABLE, 3, samples) == out


def test_memory_of_cells_is_that_of_what_each_thread_or_trial_works_in():
    of = {
        (name, workers): engine_of(name).tuned(workers=workers).memory_bytes(TABLE, 10, 50)
        for name in ("spikes", "brian2", "plain")
        for workers in (1, 2)
    }
    kept = 10 * 50 * (8 * TABLE.channels + 4 * blocks(TABLE))
    each = (of["spikes", 1] - kept) / cells(TABLE)
    wiring = wire(TABLE)
    work = workspace(plan(wiring, Clock(1, 50), np.zeros(wiring.blocks, bool)))
    assert sum(part.nbytes for part in work) / cells(TABLE) == pytest.approx(each, rel=0.2)
    assert of["spikes", 2] - of["spikes", 1] == each * cells(TABLE)
    assert of["brian2", 2] - kept == pytest.approx(10 * 2.5 * each * cells(TABLE))
    assert of["plain", 1] - kept == pytest.approx(2.5 * each * cells(TABLE))
