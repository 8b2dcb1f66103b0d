"""Shards: what they hold, and when they are computed."""

import numpy as np
import pytest

from bgmodel.deciding.decision import first_crossing
from bgmodel.integrators.sprt import Msprt
from bgmodel.support.processes import NoMemoryError
from bgmodel.sweeps import shards as stored
from bgmodel.sweeps.plan import Plan
from bgmodel.task import Gaussian
from bgmodel.trials.task_trials import EvidenceTable
from tests.helpers import long_table, some_evidence

TASK = Gaussian(trials=60, t_max=30)


def one_setting(**changed):
    same = {"task": TASK, "engine": "algebra", "gain": 0.7, "grid": {"lesion STN": (0.0,)}}
    (point,) = Plan(**(same | changed)).all_points()
    return point


def test_the_algebra_decides_a_shard_as_the_test_does(tmp_path):
    # The fixed point is the MSPRT's OUT at the circuit's gain (Bogacz & Gurney 2007).
    setting = one_setting()
    (shard,) = setting.shards()
    stored.compute(shard, tmp_path)
    behaviour, remark = stored.read(setting, tmp_path)
    evidence = setting.block(0, 60).evidence
    test = first_crossing(Msprt(0.7).run(evidence), setting.threshold_nats)
    assert remark == ""
    assert np.array_equal(behaviour.decision.choice, test.choice)
    assert np.array_equal(behaviour.decision.truth, evidence.truth)


def test_the_same_shard_is_the_same_bytes_and_is_done(tmp_path):
    (shard,) = one_setting(engine="population").shards()
    for folder in (tmp_path / "a", tmp_path / "b"):
        assert stored.state(shard, folder) == "missing"
        stored.compute(shard, folder)
        assert stored.state(shard, folder) == "done"
    one, other = (stored.entry(shard, tmp_path / name).path for name in "ab")
    assert one.read_bytes() == other.read_bytes()
    one.write_bytes(one.read_bytes()[:-1])
    assert stored.state(shard, tmp_path / "a") == "damaged"


@pytest.mark.parametrize("error", [KeyError("ours"), NoMemoryError("1 TB of memory", "trials")])
def test_a_fault_of_ours_and_a_machine_short_of_memory_are_no_outcome(tmp_path, monkeypatch, error):
    (shard,) = one_setting().shards()

    def failing(_):
        raise error

    monkeypatch.setattr(stored, "_decided", failing)
    with pytest.raises(type(error)):
        stored.compute(shard, tmp_path)
    assert stored.state(shard, tmp_path) == "missing"


def test_a_sweep_larger_than_the_disk_is_refused_before_it_is_listed(tmp_path):
    setting = one_setting(task=Gaussian(trials=10**13))
    with pytest.raises(
        ValueError, match=r"10000000000000 trials at all points take up to 5e\+05 GB"
    ):
        stored.check_room([setting], tmp_path / "not" / "there")


@pytest.mark.parametrize(("held", "asked"), [(True, True), (True, False), (False, True)])
def test_one_sweep_at_a_time_is_at_work_in_a_folder(tmp_path, held, asked):
    with (
        stored.at_work(tmp_path, alone=held),
        pytest.raises(ValueError, match="another sweep is running in"),
        stored.at_work(tmp_path, alone=asked),
    ):
        pass


def test_what_a_killed_run_left_half_written_goes_when_a_folder_is_held_alone(tmp_path):
    left = tmp_path / "shards" / ".123.partial.x.parquet"
    left.parent.mkdir()
    left.write_text("half")
    with stored.at_work(tmp_path, alone=False):
        assert left.exists()
    with stored.at_work(tmp_path, alone=True):
        assert not left.exists()


def test_evidence_that_changes_under_way_is_no_outcome(tmp_path):
    table = long_table(some_evidence(trials=30, hypotheses=2))
    table.to_csv(tmp_path / "own.csv", index=False)
    (shard,) = one_setting(task=EvidenceTable(tmp_path / "own.csv")).shards()
    assert shard.key["task"]["evidence"]
    table.iloc[::-1].to_csv(tmp_path / "own.csv", index=False)
    with pytest.raises(ValueError, match="was changed while the sweep ran"):
        stored.compute(shard, tmp_path)
