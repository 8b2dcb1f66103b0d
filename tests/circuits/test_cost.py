"""What a run takes: estimates grow as the work does, and are said in round numbers."""

import pytest

from circuits import anatomy
from circuits.cost import about, cells, run_s
from circuits.engines import ENGINES

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
