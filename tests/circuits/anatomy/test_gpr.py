"""Gurney, Prescott & Redgrave 2001: saliences against the fixed point solved by hand."""

import numpy as np
import pytest

from circuits import anatomy
from circuits.engines import run

SALIENCES = [(0.0, 0.0), (0.5, 0.2), (0.8, 0.3), (0.9, 0.0), (0.3, 0.3), (1.0, 1.0)]


def ramp(x):
    return np.clip(x, 0, 1)


def two_channels(first, second, d1_gain, d2_gain):
    """Return the output of two channels in steady state, first >= second.

    With ``c`` the salience and ``S`` the sum of STN, each linear where it is not silent::

        STN_i = c_i - GPe_i + 0.25,  GPe_i = 0.9 S - D2_i + 0.2,
        SNr_i = 0.9 S - 0.3 GPe_i - D1_i + 0.2

    Both STN speak: ``S = sum c + 0.5 - 1.8 S + sum D2 - 0.4``. The first alone:
    ``S = c_1 + 0.25 - 0.9 S + D2_1 - 0.2``.
    """
    c = np.array([first, second])
    d1, d2 = ramp(d1_gain * c - 0.2), ramp(d2_gain * c - 0.2)
    both = (c.sum() + 0.1 + d2.sum()) / 2.8
    alone = (first + 0.05 + d2[0]) / 1.9
    silent = second - ramp(0.9 * both - d2[1] + 0.2) + 0.25 < 0
    gpe = ramp(0.9 * (alone if silent else both) - d2 + 0.2)
    stn = c - gpe + 0.25
    assert stn[0] <= 1  # no ramp but those above is at its top
    assert (stn[1] < 0) == silent
    total = ramp(stn).sum()
    return ramp(0.9 * total - 0.3 * gpe - d1 + 0.2)


@pytest.mark.parametrize(("first", "second"), SALIENCES)
@pytest.mark.parametrize("level", [0.0, 0.2, 0.4])
def test_outputs_are_those_of_the_piecewise_linear_fixed_point(first, second, level):
    circuit = anatomy.gpr(2, dopamine=level)
    expected = two_channels(first, second, 1 + level, 1 - level)
    drive = np.array([[[first, second]]])
    for engine, step_ms, atol in (("algebra", 1.0, 1e-9), ("rate", 3000.0, 1e-5)):
        out_nats = run(circuit, drive, engine=engine, step_ms=step_ms).output_nats[0, -1]
        np.testing.assert_allclose(out_nats, expected, rtol=0, atol=atol)


def test_the_level_of_dopamine_multiplies_the_two_gains():
    drive = np.array([[[0.6, 0.2]]])
    for level in (0.5, 1.0, 1.25):
        activity = run(anatomy.gpr().dopamine(level), drive, engine="algebra", step_ms=1.0)
        expected = two_channels(0.6, 0.2, 1.2 * level, 0.8 * (2 - level))
        np.testing.assert_allclose(activity.output_nats[0, 0], expected, rtol=0, atol=1e-9)
