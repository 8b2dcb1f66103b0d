"""Trials as NWB."""

import json

import numpy as np
import pandas as pd
import pytest

from circuits import anatomy
from circuits.engines import run
from circuits.nwb import write_nwb
from tests.circuits.helpers import run_plain

pynwb = pytest.importorskip("pynwb")
CIRCUIT = anatomy.spiking_msprt().with_neurons(6)
NAMES = ("STN", "GPe")


def ran(trials, first_trial=0):
    silence = np.zeros((trials, 2, 2))
    times = {"step_ms": 10, "settle_ms": 5, "sample_ms": 2}
    return run_plain(CIRCUIT, silence, seed=1, spikes=NAMES, first_trial=first_trial, **times)


@pytest.fixture(scope="module")
def parts():
    return [ran(2), ran(1, 5)]


def test_chosen_trials_read_back_as_the_activity(parts, tmp_path):
    """Trials 5 and 0, in this order, each from its onset: 10 samples of 2 ms."""
    table = pd.DataFrame({"rt": [0.1, np.nan], "response": ["left", None], "forced": [True, False]})
    table["correct"] = pd.array([1, None], dtype="Int8")
    table = table.assign(id=["x", "y"], **{"d/d'": [0.5, 1.0]})  # of the user's own
    for _ in range(2):
        write_nwb(parts, tmp_path / "a.nwb", trials=[2, 0], table=table)
    assert [path.name for path in tmp_path.iterdir()] == ["a.nwb"]
    picked = [(parts[1], 0), (parts[0], 0)]
    with pynwb.NWBHDF5IO(str(tmp_path / "a.nwb"), "r") as file:
        read = file.read()
        units, trials = read.units.to_dataframe(), read.trials.to_dataframe()
        assert read.units.resolution == pytest.approx(1e-4)
        assert len(units) == 2 * 2 * 6, "silent cells are units too"
        assert trials["trial"].to_list() == [5, 0]
        np.testing.assert_allclose(trials["start_time"], [0, 0.02])
        np.testing.assert_allclose(trials["stop_time"], [0.02, 0.04])
        np.testing.assert_array_equal(trials["rt"], [0.1, np.nan])
        np.testing.assert_array_equal(trials["correct"], [1, np.nan])
        assert trials["response"].to_list() == ["left", ""]
        assert trials["forced"].to_list() == [True, False]
        assert trials["given_id"].to_list() == ["x", "y"]
        assert trials["d_d'"].to_list() == [0.5, 1.0]
        for n, (part, k) in enumerate(picked):
            for name in NAMES:
                spikes = part.spikes[name][part.spikes[name]["trial"] == k]
                for unit in units[units["population"] == name].itertuples():
                    cell = (spikes["channel"] == unit.channel) & (spikes["neuron"] == unit.neuron)
                    times = unit.spike_times - 0.02 * n
                    here = times[(times > 1e-9) & (times < 0.02 + 1e-9)]
                    np.testing.assert_allclose(here, np.sort(spikes["time_ms"][cell]) / 1000)
        of = ("STN", "SNr")
        expected = {f"{name} rate": [p.rates_hz[name][k] for p, k in picked] for name in of}
        expected["OUT"] = [p.output_nats[k] for p, k in picked]
        for name, data in expected.items():
            series = read.acquisition[name]
            np.testing.assert_array_equal(series.data[:], np.concatenate(data))
            assert (series.starting_time, series.rate) == (pytest.approx(0.002), pytest.approx(500))
        assert json.loads(read.notes)["seed"] == 1
        assert (read.subject.sex, read.subject.age) == ("U", "P0D/")


def test_out_of_saliences_is_no_nats_in_a_file_of_trials(tmp_path):
    write_nwb(run(anatomy.gpr(), [[[0.5, 0.2]]], engine="rate", step_ms=5.0), tmp_path / "a.nwb")
    with pynwb.NWBHDF5IO(str(tmp_path / "a.nwb"), "r") as file:
        assert file.read().acquisition["OUT"].unit == "salience"
