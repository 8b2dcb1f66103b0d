"""Settled states: who begins where, and that it makes no difference."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import ks_2samp

from circuits import anatomy, store
from circuits.declaration.courses import Course
from circuits.engines import run
from circuits.engines.population import settled

FULL = anatomy.load_circuit("macaque", 2)
REST = np.zeros((64, 1, 2))


@pytest.fixture(autouse=True)
def folder(monkeypatch, tmp_path):
    """Start without stored states, in memory or in files."""
    monkeypatch.setattr(settled, "_BANKS", type(settled._BANKS)())
    monkeypatch.setattr(store, "cache_folder", lambda _: tmp_path)
    return tmp_path


def populations(circuit=FULL, drive=REST, *, seed=1, **options):
    return run(circuit, drive, engine="population", step_ms=100, seed=seed, **options)


def test_a_state_serves_few_trials_and_every_trial_has_one():
    """Up to 16 at first, and 8 more in each of three doublings, until there are 8192 states."""
    trials = np.arange(2**17)
    numbers = settled.number_of(trials)
    assert numbers.min() == 0
    assert numbers.max() == settled.MOST_STATES - 1
    early = np.bincount(numbers[: 2**16])
    assert early.max() == 16 + 3 * 8
    np.testing.assert_array_equal(numbers[: settled.FEWEST], trials[: settled.FEWEST])


def test_trials_have_the_same_bytes_whether_their_states_are_new_or_kept():
    drive = np.random.default_rng(1).normal(0, 0.3, (40, 2, 2))
    first = populations(drive=drive).output_nats.tobytes()
    assert populations(drive=drive).output_nats.tobytes() == first
    settled._BANKS.clear()
    alone = populations(drive=drive[17:18], first_trial=17).output_nats
    settled._BANKS.clear()
    several = populations(drive=drive, workers=2).output_nats
    assert several.tobytes() == first
    assert alone.tobytes() == several[17:18].tobytes()


DRIVE = np.random.default_rng(1).normal(0, 0.3, (settled.FEWEST, 2, 2))


def test_a_later_run_takes_the_first_states_from_a_file(folder, monkeypatch):
    first = populations(drive=DRIVE).output_nats.tobytes()
    settled._BANKS.clear()
    with monkeypatch.context() as without:
        without.setattr(settled, "_settle", None)
        assert populations(drive=DRIVE).output_nats.tobytes() == first
    (file,) = folder.rglob(f"{settled.KIND}/*.npz")
    assert file.stat().st_size < 2e6
    settled._BANKS.clear()
    other = populations(drive=DRIVE, seed=2).output_nats.tobytes()
    assert other != first
    assert len([*folder.rglob(f"{settled.KIND}/*.npz")]) == 2


def test_edited_circuits_settle_under_the_same_noise():
    """What D1 does not reach is in the same state without it."""
    table = anatomy.spiking_msprt(2)
    intact, lesioned = (populations(each).rates_hz for each in (table, table.lesion("D1")))
    np.testing.assert_array_equal(intact["GPe"][:, 0], lesioned["GPe"][:, 0])
    assert (intact["SNr"][:, 0] != lesioned["SNr"][:, 0]).all()


def test_a_renamed_circuit_has_other_states_whatever_ran_before():
    """Noise is keyed by the names of populations, which leave the plan unchanged."""

    def renamed(row, *fields):
        return replace(row, **{f: getattr(row, f).replace("GPe", "pallidum") for f in fields})

    rows = tuple(renamed(row, "name") for row in FULL.populations)
    paths = tuple(renamed(path, "source", "target") for path in FULL.projections)
    other = replace(FULL, populations=rows, projections=paths)
    alone = populations(other).output_nats
    settled._BANKS.clear()
    assert (populations(FULL).output_nats != alone).any()
    np.testing.assert_array_equal(populations(other).output_nats, alone)


def test_states_are_those_of_a_circuit_that_has_run_for_longer():
    """OUT at the onset, from 300 ms of settling or from 1 s, has one distribution."""
    trials = np.zeros((512, 1, 2))
    short, long, none = (
        populations(drive=trials, settle_ms=ms, seed=seed).output_nats[:, 0, 0]
        for ms, seed in ((300.0, 1), (1000.0, 2), (0.0, 1))
    )
    assert ks_2samp(short, long).pvalue > 1e-3
    assert ks_2samp(short, none).pvalue < 1e-6  # rest has no noise yet


def test_without_noise_there_is_one_state_and_without_settling_none():
    populations(noise=False)
    (bank,) = settled._BANKS.values()
    assert bank.made.tolist() == [True]
    settled._BANKS.clear()
    populations(settle_ms=0.0)
    assert not settled._BANKS


def test_courses_act_from_the_onset_on_and_share_the_states():
    course = FULL.with_rows(Course("STN", 1.0, from_ms=50, to_ms=80))
    before, after = (populations(each).output_nats for each in (FULL, course))
    assert len(settled._BANKS) == 1
    np.testing.assert_array_equal(before[:, :40], after[:, :40])
    assert (before[:, 70] != after[:, 70]).all()
