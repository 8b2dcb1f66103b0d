"""Tasks: the interface of all, the settings of each, and the evidence that they draw."""

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

import bgmodel as bg
from bgmodel.conditions import Condition, circuit_seen_from, seen_from
from bgmodel.names import CircuitName
from bgmodel.simulated_evidence import separated_evidence
from bgmodel.tactile.source import load_taps
from bgmodel.tactile.task import EdgeTurn, Orientation, SameDifferent
from bgmodel.task import KINDS, Gaussian, Task, kind_of, settings_of_tasks
from bgmodel.trials.task_trials import EvidenceTable
from tests.helpers import refused, refusing

DRAWN = [Gaussian(channels=3), SameDifferent(1.5), Orientation(4)]


def test_a_competitor_rises_and_nothing_else():
    """Means of the readings: the true channel's, its fraction in the next one, 0 in the others."""
    options = {"rng": bg.stream(1, "r"), "hypotheses": 4}
    drawn = separated_evidence(4000, 5, 0.8, conflict=0.5, **options)
    means = drawn.log_likelihood.mean(axis=1)
    turned = [np.roll(x, -k) for x, k in zip(means, drawn.truth, strict=True)]
    np.testing.assert_allclose(np.mean(turned, axis=0) / 0.8, [0.8, 0.4, 0, 0], atol=0.03)
    plain = separated_evidence(10, 5, 0.8, rng=bg.stream(1, "r"))
    same = separated_evidence(10, 5, 0.8, rng=bg.stream(1, "r"), conflict=0.0)
    np.testing.assert_array_equal(plain.log_likelihood, same.log_likelihood)


@pytest.mark.parametrize("task", DRAWN, ids=lambda task: task.name)
def test_a_task_draws_the_trials_that_it_is_asked_for(task):
    drawn = task.evidence(12, seed=3)
    assert (drawn.trials, drawn.steps, drawn.hypotheses) == (12, task.t_max, task.channels)
    assert drawn.step_ms == task.step_ms
    assert task.evidence(seed=3).trials == task.trials
    same = replace(task, trials=12).evidence(seed=bg.stream(3))
    np.testing.assert_array_equal(drawn.log_likelihood, same.log_likelihood)
    other = task.evidence(12, seed=4)
    assert not np.array_equal(drawn.log_likelihood, other.log_likelihood)
    assert len(task.names) == task.channels


def test_taps_may_be_a_table_or_its_file(tmp_path):
    task, taps = SameDifferent(2.0, trials=20), load_taps()
    taps.to_parquet(tmp_path / "mine.parquet")
    drawn = task.evidence(seed=1)
    for source in (taps, tmp_path / "mine.parquet", str(tmp_path / "mine.parquet")):
        same = task.evidence(taps=source, seed=1)
        np.testing.assert_array_equal(drawn.log_likelihood, same.log_likelihood)
    named = replace(task, taps=tmp_path / "mine.parquet").evidence(seed=1)
    np.testing.assert_array_equal(drawn.log_likelihood, named.log_likelihood)
    other = task.evidence(taps=taps.sample(frac=1, random_state=1), seed=1)
    assert not np.array_equal(drawn.log_likelihood, other.log_likelihood)
    with refused("taps .*tactile"):
        Gaussian().evidence(taps=taps, seed=1)


@pytest.mark.parametrize("name", KINDS)
def test_a_task_comes_back_from_its_settings_as_a_file_has_them(name):
    task = kind_of(name)("mine.csv") if name == "table" else kind_of(name)()
    again = Task.from_settings(json.loads(json.dumps(task.settings())))
    assert again == task
    assert task.settings().keys() <= {"name"} | settings_of_tasks().keys()
    assert Task.from_settings({}) == Gaussian()


test_a_setting_of_another_task_is_refused = refusing(
    ({"name": "taste"}, "task must be one of gaussian"),
    ({"d_prime": 1.0, "name": "orientation"}, "task.d_prime"),
    ({"period_mm": 1.0}, "task.period_mm"),
    ({"d_prime": "big"}, "task.d_prime"),
    ({"name": "edge-turn", "step_deg": 181.0}, "step_deg"),
    ({"name": "same-different", "channels": 4}, "task.channels"),
    of=Task.from_settings,
)


def test_a_setting_that_a_task_does_not_have_cannot_be_changed():
    assert Gaussian().changed(d_prime=1.0) == Gaussian(d_prime=1.0)
    with refused("period_mm"):
        Gaussian().changed(period_mm=2.0)


def test_files_are_looked_for_in_the_folder_of_the_file_that_names_them():
    folder = Path("studies")
    plain = Condition(circuit=CircuitName("appendix_b"))
    assert seen_from(folder, plain) == plain
    assert circuit_seen_from(folder, "mine.toml") == str(folder / "mine.toml")
    condition = replace(plain, task=EvidenceTable("own.csv"), posterior=None, threshold=0.3)
    assert seen_from(folder, condition).task.evidence == folder / "own.csv"
    absolute = replace(condition, task=EvidenceTable("/data/own.csv"))
    assert seen_from(folder, absolute).task.evidence == Path("/data/own.csv")
    taps = replace(plain, task=EdgeTurn(taps="own.csv"))
    assert seen_from(folder, taps).task.taps == folder / "own.csv"


test_numbers_out_of_range_are_refused = refusing(
    ({"expectancy_nats": 3.0}, "foreperiod_ms whole steps"),
    ({"expectancy_nats": 3.0, "expectancy_ms": 70.0}, "foreperiod_ms whole steps"),
    ({"expectancy_nats": -1.0}, "expectancy_nats"),
    ({"expectancy_ms": 800.0}, "expectancy_ms expectancy_nats"),
    ({"conflict": 5.0}, "conflict within"),
    ({"trials": 0}, "trials"),
    ({"channels": 1}, "channels"),
    ({"d_prime": True}, "d_prime"),
    of=lambda arguments: Gaussian(**arguments),
)


def test_every_setting_of_a_task_is_described_once():
    names = [each.name for name in KINDS for each in fields(kind_of(name))]
    assert set(names) == set(settings_of_tasks())
