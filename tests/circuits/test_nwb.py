"""Recordings as NWB."""

import json

import numpy as np
import pytest

from circuits import anatomy
from circuits.engines import run
from circuits.nwb import write_nwb
from tests.circuits.helpers import run_ensemble
from tests.helpers import refused


def test_a_file_of_recordings_reads_back_as_the_activity(tmp_path):
    pynwb = pytest.importorskip("pynwb")
    from circuits.nwb import write_nwb

    circuit = anatomy.spiking_msprt().with_neurons(20)
    activity = run_ensemble(
        circuit, np.zeros((2, 1, 2)), step_ms=50, seed=1, settle_ms=10, spikes=("STN", "GPe")
    )
    for _ in range(2):
        write_nwb(activity, tmp_path / "a.nwb", trial=1)
    assert [path.name for path in tmp_path.iterdir()] == ["a.nwb"]
    with pynwb.NWBHDF5IO(str(tmp_path / "a.nwb"), "r") as file:
        read = file.read()
        units = read.units.to_dataframe()
        table = activity.spikes["STN"]
        expected = np.sort(table[table["trial"] == 1]["time_ms"].to_numpy()) / 1000
        found = units[units["population"] == "STN"]["spike_times"]
        np.testing.assert_allclose(np.sort(np.concatenate(found.to_list())), expected)
        assert len(units) == 2 * 2 * 20  # silent cells too
        out = read.acquisition["OUT"]
        np.testing.assert_array_equal(out.data[:], activity.output_nats[1])
        assert json.loads(read.notes)["seed"] == 1
    with refused("trial"):
        write_nwb(activity, tmp_path / "b.nwb", trial=2)


def test_out_of_saliences_is_no_nats_in_a_file_of_recordings(tmp_path):
    pynwb = pytest.importorskip("pynwb")
    write_nwb(run(anatomy.gpr(), [[[0.5, 0.2]]], engine="rate", step_ms=5.0), tmp_path / "a.nwb")
    with pynwb.NWBHDF5IO(str(tmp_path / "a.nwb"), "r") as file:
        assert file.read().acquisition["OUT"].unit == "salience"
