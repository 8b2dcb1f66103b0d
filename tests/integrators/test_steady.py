"""Shifts of OUT by edits, at the fixed point and in spikes, and the decoder of its input."""

import numpy as np
import pandas as pd
import pytest

from bgmodel import Evidence, Msprt
from bgmodel.integrators.at_thresholds import decoded_input
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.steady import leader_drive, leader_out, out_shift, steady_out
from circuits.anatomy import load_circuit
from circuits.dynamics.fixed_point import rest_rates, wired
from circuits.engines import Spikes
from circuits.laws.fluctuation import out_variance

SEED, GAIN = 51, 0.5
TABLE = load_circuit("spiking_msprt", 4)
LAWS = {"exact": "table", "own_laws": "cells", "finite": "finite"}


def shifts(circuit, edited, log_odds, *, seed, trials):
    """Return the shift of OUT by each edit, nats, one row per edit and log odds.

    Measured in spikes (``value``, with the standard error ``se`` of trials paired by their noise),
    and that of the fixed point: algebraic (``exact``), with the cells' f-I laws (``own_laws``), and
    also with the noise of their finite number (``finite``).
    """
    out = np.log1p((circuit.channels - 1) * np.exp(-np.asarray(log_odds)))
    before = steady_out(circuit, log_odds, seed=seed, trials=trials)
    parts = []
    for name, table in edited.items():
        shift = steady_out(table, log_odds, seed=seed, trials=trials) - before
        theory = {law: out_shift(circuit, table, out, laws=laws) for law, laws in LAWS.items()}
        measured = {"value": shift.mean(axis=1), "se": shift.std(axis=1, ddof=1) / trials**0.5}
        parts.append(pd.DataFrame({"variant": name, **measured, **theory}))
    return pd.concat(parts, ignore_index=True)


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


def test_the_decoder_of_a_steady_input_is_the_test():
    """Its OUT is -ln softmax of the decoded cortical activity, within the counting error."""
    steady = Evidence(np.zeros((40, 20, 4)), step_ms=50.0)
    steady.log_likelihood[:, 0, 0] = 3.0
    model = BasalGanglia(load_circuit("spiking_msprt", 4), Spikes(workers=2), GAIN, 51)
    activity = model.activity(steady)
    out = decoded_input(activity, model.trace(activity, steady), tau_ms=100.0).out_nats[:, -200:, 0]
    wanted = Msprt(GAIN).run(steady).out_nats[0, -1, 0]
    assert out.mean() == pytest.approx(wanted, abs=0.03)


@pytest.mark.parametrize("channels", [2, 3, 4])
def test_the_cells_of_the_default_circuit_are_many_where_they_are_cheap(channels):
    """At a cost sum(c_i n_i), variances a_i / n_i are least if n_i goes with the root of a_i / c_i.

    That is Cauchy & Schwarz; a cell costs its spikes per second, and about as much as one more.
    ``macaque_small`` shows what another split costs.
    """
    excess = {}
    for name in ("macaque", "macaque_small"):
        circuit = load_circuit(name, channels)
        odds = np.log(0.9 * (channels - 1) / 0.1)
        whose = out_variance(circuit, leader_drive(odds, channels)[0, 0])
        variance = np.array([value[0] for value in whose.values()])
        wiring = wired(circuit)
        at_rest = rest_rates(wiring).ravel()
        spent = np.array([
            circuit.population(row).neurons * (1 + at_rest[wiring.blocks_of(row)].mean())
            for row in whose
        ])  # fmt: skip
        least = np.sqrt(variance * spent).sum() ** 2 / spent.sum()
        excess[name] = variance.sum() / least
    assert 1.0 <= excess["macaque"] < 1 / 0.9
    assert excess["macaque_small"] > 1.18
