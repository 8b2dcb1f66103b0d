"""BIDS events of stop-signal sets: their names, bad files, and delays that were not recorded."""

from dataclasses import replace

import numpy as np
import pytest

from bgmodel.stopping.people import read_people
from bgmodel.stopping.trials import StopTrials
from bgmodel.trials.events import restored_delays
from bgmodel.trials.reader import Columns
from circuits.errors import DataWarning
from tests.helpers import refused, unwarned
from tests.stop_trials import walked

GENERIC = """onset\tduration\ttrial_type\tresponse_time\tstop_signal_delay
0.5\t1\tgo\t0.412\tn/a
2.5\t1\tsuccessful stop\tn/a\t0.25
4.5\t1\tgo\tn/a\tn/a
6.5\t1\tfailed stop\t0.388\t0.3
"""
CNP = """onset\tduration\ttrial_type\tTrialOutcome\tReactionTime\tStopSignalDelay
0.5\t1\tGO\tSuccessfulGo\t0.4163\t0
2.5\t1\tSTOP\tSuccessfulStop\t0\t0.2503
4.5\t1\tGO\tUnsuccessfulGo\t0\t0
6.5\t1\tSTOP\tUnsuccessfulStop\t0.3880\t0.3001
"""


NAME = "sub-01_task-stopsignal_events.tsv"


def written(folder, text, name=NAME):
    path = folder / "sub-01" / "func" / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


@pytest.mark.parametrize(("text", "go_ms"), [(GENERIC, 412.0), (CNP, 416.3)])
def test_names_of_published_sets_are_known(tmp_path, text, go_ms):
    path = written(tmp_path, text)
    with unwarned():
        people = read_people(path)
    trials = people["sub-01"]
    np.testing.assert_allclose(trials.rt_ms, [go_ms, np.nan, np.nan, 388.0])
    np.testing.assert_allclose(trials.ssd_ms, [np.nan, 250.0, np.nan, 300.0], atol=0.5)
    names = ["response", "successful stop", "omission", "failed stop"]
    assert trials.outcome.tolist() == names


def test_a_folder_is_read_with_all_runs_and_only_the_stop_task(tmp_path):
    for run in (1, 2):
        written(tmp_path, GENERIC, f"sub-01_task-stopsignal_run-{run}_events.tsv")
    written(tmp_path, CNP, "sub-02_task-stopsignal_events.tsv")
    written(tmp_path, "onset\tduration\n1\t1\n", "sub-01_task-rest_events.tsv")
    people = read_people(tmp_path)
    assert {who: len(each.rt_ms) for who, each in people.items()} == {"sub-01": 8, "sub-02": 4}


def test_other_names_can_be_given(tmp_path):
    text = GENERIC.replace("response_time", "Key.RT").replace("stop_signal_delay", "lag")
    path = written(tmp_path, text)
    with refused("rt must be a column, called response_time or ReactionTime"):
        read_people(path)
    person = read_people(path, columns=Columns(rt="Key.RT", ssd="lag"))["sub-01"]
    known = read_people(written(tmp_path, GENERIC))["sub-01"]
    np.testing.assert_array_equal(person.rt_ms, known.rt_ms)
    table = tmp_path / "mine.csv"
    table.write_text("participant_id,RT,delay\na,0.4,\na,,0.2\n")
    assert read_people(table, columns=Columns(rt="RT", ssd="delay"))["a"].p_respond == 0


def test_events_of_other_types_are_left_out_with_a_warning(tmp_path):
    text = GENERIC + "8.5\t1\tjunk\t0.4\tn/a\n9.5\t1\tnogo\t0.4\tn/a\n"
    with pytest.warns(DataWarning, match="2 events are neither go nor stop"):
        people = read_people(written(tmp_path, text))
    assert len(people["sub-01"].rt_ms) == 4


BAD = {
    "ssd each stop trial, got 1": GENERIC.replace("stop\tn/a\t0.25", "stop\tn/a\tn/a"),
    "response_time must hold numbers": GENERIC.replace("0.412", "fast"),
    "response_time sub-01_.* 0 s or more.*got .-0.08. in row 3": GENERIC.replace("0.388", "-0.08"),
    "ssd files with another ending": GENERIC.replace("stop_signal_delay", "x"),
    "trial_type must include stop trials": GENERIC.replace(" stop", ""),
    "ssd must be in seconds": GENERIC.replace("0.25", "250").replace("0.3\n", "300\n"),
}


@pytest.mark.parametrize("says", BAD)
def test_bad_events_are_refused(tmp_path, says):
    with refused(says):
        read_people(written(tmp_path, BAD[says]))


def test_files_of_events_are_known_by_their_names(tmp_path):
    with refused("path must hold files that end in _events.tsv"):
        read_people(tmp_path)
    with refused("path must have a name with .sub-"):
        read_people(written(tmp_path, GENERIC, "task-stop_events.tsv"))


@pytest.mark.parametrize(
    "place", ["derivatives/x", "sourcedata", ".git", "sub-01/func/.hidden", "sub-01/func/empty"]
)
def test_copies_and_hidden_and_empty_files_are_no_data(tmp_path, place):
    path = written(tmp_path, GENERIC)
    other = tmp_path / place / path.name
    other.parent.mkdir(parents=True, exist_ok=True)
    other.write_text("" if place.endswith("empty") else GENERIC)
    path.with_name("._" + path.name).write_bytes(b"\x00\x05\x16\x07\xb0" * 100)
    path.with_name(path.name.replace("_events", "_desc-clean_events")).write_text(GENERIC)
    assert len(read_people(tmp_path)["sub-01"].rt_ms) == 4


@pytest.mark.parametrize("name", ["sub-01_task-stopreward_events.tsv", f"sub-01_ses-2{NAME[6:]}"])
def test_several_tasks_or_sessions_are_not_pooled(tmp_path, name):
    written(tmp_path, GENERIC, "sub-01_ses-1_task-stopsignal_events.tsv")
    written(tmp_path, GENERIC, name)
    with refused("path holds .*: give a folder with the files of one"):
        read_people(tmp_path)


def raced(seed):
    """Return trials of a race of widely spread times, whose delays are late as a screen's are."""
    return walked(seed, 180, 60, ssrt_ms=150, sd_ms=0, scale_ms=120, jitter_ms=6)


def unrecorded(trials):
    """Return the trials as a program records them that gives no signal after a response."""
    return replace(trials, ssd_ms=np.where(trials.rt_ms < trials.ssd_ms, 0.0, trials.ssd_ms))


def restored(trials):
    return StopTrials.of(restored_delays(trials.to_trials()))


def test_delays_that_are_known_are_found_again():
    errors, missing = [], 0
    for seed in range(20):
        full = raced(seed)
        zeroed = unrecorded(full)
        rebuilt, known = restored_delays(zeroed.to_trials()), zeroed.ssd_ms != 0
        np.testing.assert_array_equal(rebuilt.ssd_s[known], full.to_trials().ssd_s[known])
        errors += list(np.abs(1000 * rebuilt.ssd_s - full.ssd_ms)[~known & full.stop] > 10)
        missing += int((~known).sum())
    assert missing > 60
    # Where both staircases explain what follows, either may be chosen.
    assert np.mean(errors) < 0.15


def test_the_shipped_delays_of_zero_contradict_no_staircase():
    with pytest.warns(DataWarning, match="268 of 274 stop trials with a delay of 0"):
        people = read_people()
    for trials in people.values():
        with unwarned():
            rebuilt = restored(trials)
        new = rebuilt.ssd_ms[rebuilt.ssd_ms != trials.ssd_ms]
        new = new[~np.isnan(new)]
        # The search allows for contradictions; there are none.
        times = trials.rt_ms[(trials.ssd_ms == 0) & trials.responded]
        assert (new + 10 >= times).all()


def test_trials_without_missing_delays_are_returned_as_they_are():
    trials = StopTrials([400.0, np.nan, 300.0], [np.nan, 0.0, 3.0]).to_trials()
    with unwarned():
        assert restored_delays(trials).checksum == trials.checksum
    with refused("ssd must have stop-signal delays"):
        restored_delays(replace(trials, ssd_s=None))


def test_delays_that_are_no_staircase_are_warned_of():
    rng, trials = np.random.default_rng(1), raced(1)
    ssd = np.where(trials.stop, rng.choice(np.arange(0, 901, 50), len(trials.rt_ms)), np.nan)
    ssd[np.flatnonzero(trials.stop & trials.responded)[:5]] = 0.0
    with pytest.warns(DataWarning, match="contradict two staircases"):
        restored(replace(trials, ssd_ms=ssd))
