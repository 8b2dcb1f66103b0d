"""Shifts of OUT by lesions, at the fixed point and in spikes."""

import numpy as np
import pytest

from bgmodel.integrators.steady import leader_drive, leader_out, out_shift
from circuits.anatomy import load_circuit
from tests.integrators.helpers import shifts

SEED, GAIN = 51, 0.5
TABLE = load_circuit("spiking_msprt", 4)


@pytest.mark.parametrize("name", ["bogacz_gurney", "appendix_b", "spiking_msprt"])
@pytest.mark.parametrize("lost", [0.1, 0.2])
def test_losing_stn_shifts_out_by_ln_of_what_is_left(name, lost):
    """The posterior criterion becomes (1 - f) P: exact, and nearly so where S - ln S is a line."""
    table = load_circuit(name, 3)
    shift = out_shift(table, table.lesion("STN", lost), 0.3)
    close = 0.01 if name == "spiking_msprt" else 1e-9
    assert shift == pytest.approx(np.log(1 - lost), abs=close)


def test_lesions_of_the_spiking_circuit_follow_its_fixed_point():
    edited = {"STN": TABLE.lesion("STN", 0.1), "D1": TABLE.lesion("D1", 0.1)}
    shifted = shifts(TABLE, edited, [2.0, 2.5], seed=SEED, trials=10)
    assert (np.abs(shifted["value"] - shifted["exact"]) < 0.02).all()
    stn, d1 = (shifted[shifted["variant"] == name] for name in edited)
    assert (stn["value"] + 2.3 * stn["se"] < -0.05).all()
    assert (d1["value"] - 2.3 * d1["se"] > 0.02).all()


def test_a_shift_that_is_not_known_is_nan():
    """Neither that of sparse connections, by the laws of a finite number, nor 0 in its place."""
    differ = TABLE.with_connections(0.5)
    assert np.isnan(out_shift(differ, differ.lesion("STN", 0.1), 0.3, laws="finite"))
    assert np.isfinite(out_shift(differ, differ.lesion("STN", 0.1), 0.3, laws="cells"))


@pytest.mark.parametrize("channels", [2, 3, 5])
def test_a_leader_is_ahead_of_each_other_channel_by_its_log_odds(channels):
    """At the fixed point of the exact circuit its OUT is then -ln P."""
    odds = np.array([[0.5, 1.0], [1.5, 2.0]])
    drive = leader_drive(odds, channels)[:, 0]
    np.testing.assert_allclose(
        drive[:, :1] - drive[:, 1:], np.repeat(odds.reshape(-1, 1), channels - 1, 1)
    )
    assert np.abs(drive.sum(axis=1)).max() < 1e-12
    out_nats = leader_out(load_circuit("bogacz_gurney", channels), odds)
    np.testing.assert_allclose(out_nats, np.log1p((channels - 1) * np.exp(-odds)), atol=1e-9)
