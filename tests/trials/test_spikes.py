"""Spikes of recorded cells: tables, sessions, NWB files, and what is refused."""

import numpy as np
import pandas as pd
import pytest

from bgmodel.fitting.cells.model import cells_model
from bgmodel.fitting.cells.sessions import sessions_of
from bgmodel.trials.reader import Columns, read_trials
from bgmodel.trials.record import joined
from bgmodel.trials.spikes import joined_spikes, read_nwb, spikes_of, without_silent
from circuits.errors import DataWarning
from tests.helpers import refused, refusing
from tests.read import changed, without

NAMED = Columns(rt="stimulus_s", response="chose_right", upper="right")


def tables(trials=60, seed=1):
    """Return trials and spikes of two sessions with two cells and one."""
    rng = np.random.default_rng(seed)
    rows, spikes = [], []
    for k in range(trials):
        session, name = ("a", k) if k < trials // 2 else ("b", k - trials // 2)
        end = rng.uniform(0.3, 1.0)
        left, right = (np.sort(rng.uniform(0, end, rng.integers(3, 12))) for _ in range(2))
        row = {"session": session, "trial": name, "stimulus_s": end, "left_s": [0.0, *left]}
        chose = int(len(right) + rng.normal() > len(left))
        rows.append(row | {"right_s": [0.0, *right], "chose_right": chose})
        for cell in ("1", "2") if session == "a" else ("1",):
            times = np.sort(rng.uniform(-0.5, 1.5, 12))
            columns = {"session": session, "cell": cell, "trial": name, "time_s": times}
            spikes.append(pd.DataFrame(columns))
    return pd.DataFrame(rows), pd.concat(spikes, ignore_index=True)


@pytest.fixture
def read():
    table, spikes = tables()
    return read_trials(table, columns=NAMED, spikes=spikes)


def test_spikes_clicks_and_choices_are_read_together(read):
    table, spikes = tables()
    assert read.kind == "spikes and choices"
    assert read.spikes.names == ("a.1", "a.2", "b.1")
    assert len(read.spikes.time_s) == len(spikes)
    assert read.spikes.recorded.sum(axis=0).tolist() == [30, 30, 30]
    first = table.iloc[0]
    assert read.readings.lengths[0] == len({*first["left_s"], *first["right_s"]})
    assert read.readings.names == ("left", "right")
    assert (read.response == table["chose_right"]).all()


def test_a_subset_keeps_the_spikes_and_cells_of_its_trials(read):
    some = read.where(np.arange(60) >= 30)
    assert some.spikes.names == ("b.1",)
    assert len(some.spikes.time_s) == 30 * 12
    assert some.spikes.recorded.all()
    assert some.checksum != read.checksum
    both = joined([read.where(np.arange(60) < 30), some])
    assert both.spikes.names == read.spikes.names
    assert np.array_equal(both.spikes.recorded, read.spikes.recorded)
    assert np.array_equal(both.spikes.time_s, read.spikes.time_s)
    again = joined_spikes([read.spikes.where(np.arange(60) < 30), some.spikes])
    assert np.array_equal(again.trial, read.spikes.trial)


@pytest.mark.parametrize("factor", [1000.0, 30_000.0, -1000.0])
def test_times_in_ms_or_samples_are_refused(factor):
    """Also if no spike comes before the onset of its trial."""
    table, spikes = tables()
    for some in (spikes, spikes[spikes["time_s"] > 0]):
        with refused("time_s"):
            read_trials(table, columns=NAMED, spikes=some.assign(time_s=some["time_s"] * factor))


def choosing(change=lambda table: table, spikes=lambda table: table, trials=60):
    table, times = tables(trials)
    return lambda: read_trials(change(table), columns=NAMED, spikes=spikes(times))


test_spikes_need_clicks_choices_and_names_of_their_own_trials = refusing(
    (choosing(without("left_s")), "evidence"),
    (choosing(changed(left_s=lambda t: t["left_s"].map(str))), "evidence of a .parquet, since a"),
    (choosing(spikes=without("session")), "trial"),
    (choosing(spikes=without("cell")), "cell"),
    (choosing(lambda table: pd.concat([table, table[:1]])), "trial"),
    (choosing(changed(chose_right=lambda t: 1 - t["chose_right"]), trials=200), "response"),
)


def test_spikes_of_unknown_trials_and_silent_cells_are_left_out_with_a_warning():
    table, spikes = tables()
    with pytest.warns(DataWarning):
        read = read_trials(table.iloc[:40], columns=NAMED, spikes=spikes)
    assert read.spikes.trial.max() == 39
    with pytest.warns(DataWarning):
        left = without_silent(read.spikes, 200)
    assert left.names == ("a.1", "a.2")
    assert left.recorded.shape == (40, 2)
    with pytest.warns(DataWarning), refused("spikes"):
        without_silent(read.spikes, 10_000)


def nwb(path, *, overlap=False, late=False, trials=True):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        if trials:
            rows = file.create_group("intervals/trials")
            rows["id"] = [0, 1]
            rows["start_time"], rows["stop_time"] = [10.0, 12.0], [12.5 if overlap else 10.6, 12.9]
            rows["chose_right"] = [0.0, 1.0]
            rows["left_s"], rows["left_s_index"] = [0.0, 0.1, 0.2, 0.0], [3, 4]
            rows["right_s"], rows["right_s_index"] = [0.0, 0.0, 0.3, 0.5], [1, 4]
        units = file.create_group("units")
        units["id"] = [7]
        units["spike_times"] = [9.7, 10.2, 11.2, 12.4, 40.0 if late else 20.0]
        units["spike_times_index"] = [5]
        units["obs_intervals"], units["obs_intervals_index"] = [[0.0, 30.0]], [1]
    return path


def test_a_file_of_nwb_holds_trials_and_spikes(tmp_path):
    read = read_trials(nwb(tmp_path / "one.nwb"), columns=NAMED)
    assert read.spikes.names == ("7",)
    assert np.allclose(read.spikes.time_s, [-0.3, 0.2, 0.4])
    assert read.spikes.trial.tolist() == [0, 0, 1]
    assert np.allclose(read.rt_s, [0.6, 0.9])
    assert read.readings.lengths.tolist() == [3, 3]


def test_a_unit_is_not_recorded_in_trials_outside_its_observation(tmp_path):
    h5py = pytest.importorskip("h5py")
    path, table = tmp_path / "half.nwb", tables(trials=30)[0]
    start, spikes = 3.0 * np.arange(1, 31), np.arange(1, 950) / 10
    with h5py.File(path, "w") as file:
        rows, units = file.create_group("intervals/trials"), file.create_group("units")
        rows["id"], rows["start_time"] = np.arange(30), start
        rows["stop_time"], rows["chose_right"] = start + table["stimulus_s"], table["chose_right"]
        for side in ("left_s", "right_s"):
            rows[side] = np.concatenate(table[side])
            rows[f"{side}_index"] = table[side].map(len).cumsum()
        units["id"] = [1, 2, 3]
        units["spike_times"] = np.concatenate([spikes[spikes < 46.2], spikes[spikes < 70], spikes])
        units["spike_times_index"] = np.cumsum([(spikes < 46.2).sum(), (spikes < 70).sum(), 949])
        units["obs_intervals"] = [[2.0, 20.0], [20.0, 46.2], [2.5, 70.0], [2.5, 60.2], [76.0, 95.0]]
        units["obs_intervals_index"] = [2, 3, 5]
    with pytest.warns(DataWarning, match="in 3 trials"):
        read = read_trials(path, columns=NAMED)
    last = start + table["stimulus_s"] + 0.5
    expected = np.stack([last < 46.2, last < 70, (last < 60.2) | (start > 76.4)], axis=1)
    assert np.array_equal(read.spikes.recorded, expected[expected.any(axis=1)])
    assert read.spikes.recorded[read.spikes.trial, read.spikes.cell].all()
    sessions = sessions_of(read)
    assert sum(len(each.trials) for each in sessions) == 27
    for each in sessions:  # about 0.5 spikes per bin in every trial in which a cell is recorded
        assert (each.counts.sum(axis=2) / each.bins).mean() == pytest.approx(0.5, abs=0.1)
    names = [each.name for each in cells_model("exponential", read).parameters]
    assert len(set(names)) == len(names)
    with h5py.File(path, "a") as file:
        del file["units/obs_intervals"], file["units/obs_intervals_index"]
    assert read_trials(path, columns=NAMED).spikes.recorded.all()


def test_a_wrong_file_of_nwb_is_refused(tmp_path):
    for change, field in (("overlap", "start_time"), ("late", "spike_times")):
        with refused(field):
            read_nwb(nwb(tmp_path / "one.nwb", **{change: True}))
    with refused("source"):
        read_nwb(nwb(tmp_path / "one.nwb", trials=False))


def test_spikes_are_matched_by_the_names_of_trials():
    spikes = pd.DataFrame({"cell": [1, 1], "trial": [1.0, 0.0], "time_s": [0.1, 0.2]})
    matched = spikes_of(spikes, ["0", "1"], np.array([0.5, 0.5]))
    assert matched.trial.tolist() == [1, 0]
    assert matched.names == ("1",)
