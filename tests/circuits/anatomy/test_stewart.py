"""Stewart, Choo & Eliasmith 2010: the closed form of GPR, and what nengo's tests print.

nengo's test of its basal ganglia (networks/tests/test_actionselection.py, version 4.1): of inputs
0.8, 0.4, 0.4, 0.4, 0.4 the output times -3, its mean from 100 to 200 ms, is above -0.1 for the
first and below -0.8 for the others.
"""

import numpy as np
import pytest

from circuits import anatomy
from circuits.engines import run

OF_NENGO = [0.8, 0.4, 0.4, 0.4, 0.4]


def settled(engine, saliences, **options):
    """Return the output of each channel and trial, its mean from 100 to 200 ms."""
    trials = 1 if engine == "rate" else 20
    drive = np.tile(saliences, (trials, 2, 1))
    seed = {} if engine == "rate" else {"seed": 3}
    circuit = anatomy.stewart(len(saliences), **options)
    activity = run(circuit, drive, engine=engine, step_ms=100, **seed)
    return activity.output_nats[:, 100:].mean(axis=1)


@pytest.mark.parametrize("engine", ["rate", "spikes"])
def test_outputs_lie_within_the_bounds_of_nengos_own_test(engine):
    out = -3 * settled(engine, OF_NENGO)
    assert (out[:, 0] > -0.1).all()
    assert (out[:, 1:] < -0.8).all()


@pytest.mark.parametrize("saliences", [(0.0, 0.0), (0.8, 0.3), (0.5, 0.45), (0.6, 0.2, 0.2, 0.1)])
@pytest.mark.parametrize("level", [0.0, 0.2, 0.4])
def test_outputs_settle_where_those_of_gpr_do(saliences, level):
    """As far as no ramp of gpr is at its top: these functions have none."""
    gpr = anatomy.gpr(len(saliences), dopamine=level)
    expected = run(gpr, [[saliences]], engine="algebra", step_ms=1.0).output_nats[0, 0]
    np.testing.assert_allclose(settled("rate", saliences, dopamine=level)[0], expected, atol=1e-4)


def test_spikes_scatter_about_the_closed_form():
    expected = settled("rate", OF_NENGO)[0]
    spiking = settled("spikes", OF_NENGO)
    np.testing.assert_allclose(spiking.mean(axis=0), expected, atol=0.01)
    assert (spiking.std(axis=0) < 0.02).all()
