"""Sessions of recorded cells: sums of clicks, counts in bins, recent rates."""

from dataclasses import replace

import numpy as np
import pytest

from bgmodel.fitting.cells.sessions import BIN_S, LAG_S, PAST_S, courses, recent, sessions_of
from bgmodel.trials.reader import read_trials
from circuits.errors import DataWarning
from tests.helpers import refused
from tests.trials.test_spikes import NAMED, tables


@pytest.fixture
def trials():
    table, spikes = tables(trials=80)
    return read_trials(table, columns=NAMED, spikes=spikes)


def test_every_spike_in_a_bin_of_its_trial_is_counted_once(trials):
    spikes = trials.spikes
    end_s = trials.rt_s[spikes.trial]
    bins = np.maximum((end_s / BIN_S).astype(int), 1)
    inside = (spikes.time_s >= LAG_S) & (spikes.time_s < LAG_S + bins * BIN_S)
    made = sessions_of(trials)
    assert [each.names for each in made] == [("b.1",), ("a.1", "a.2")]
    assert sum(each.counts.sum() for each in made) == inside.sum()
    assert all((each.counts * ~each.on == 0).all() for each in made)


def test_a_sum_of_clicks_leaks_and_adapts(trials):
    session = sessions_of(trials)[0]
    plain = session.sums(0.0, 1.0, 0.1)
    assert np.allclose(plain[:, -1], session.click.sum(axis=1))
    k, first = 4, session.click_s[4]
    seen = first < session.middles_s[3]
    left = session.click[k][seen] * np.exp(-2.0 * (session.middles_s[3] - first[seen]))
    assert session.sums(2.0, 1.0, 0.1)[k, 3] == pytest.approx(left.sum())
    two = 1 - 0.9 * np.exp(-(first[1] - first[0]) / 0.1)
    early = np.searchsorted(session.middles_s, first[1])
    if session.middles_s[early] < first[2]:
        expected = session.click[k, 0] + two * session.click[k, 1]
        assert session.sums(0.0, 0.1, 0.1)[k, early] == pytest.approx(expected)


def test_the_recent_rate_of_a_cell_is_that_of_its_spikes_before_a_bin(trials):
    session, spikes = sessions_of(trials)[0], trials.spikes
    cell = spikes.names.index("b.1")
    some = (spikes.cell == cell) & (spikes.trial == session.trials[2])
    edge = LAG_S + 3 * BIN_S
    before = spikes.time_s[some & (spikes.time_s < edge)]
    rate = np.exp(-(edge - before) / PAST_S).sum() / PAST_S / (1 - np.exp(-(edge + 0.5) / PAST_S))
    assert session.past[0, 2, 3] == pytest.approx(recent(rate))


def test_courses_are_a_partition_of_unity():
    for bins in (1, 3, 20):
        assert np.allclose(courses(bins).sum(axis=1), 1)


def test_trials_without_spikes_and_cells_with_few_are_refused(trials):
    table, spikes = tables(trials=20)
    some = read_trials(table, columns=NAMED, spikes=spikes.iloc[::6])
    with pytest.warns(DataWarning), refused("spikes"):
        sessions_of(some)
    with refused("spikes"):
        sessions_of(replace(trials, spikes=None))
