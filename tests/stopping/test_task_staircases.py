"""Staircases: moves by one, interleaved, settled at one half, and what is refused."""

import warnings

import numpy as np
import pytest

from bgmodel.stopping.task import walk
from circuits.errors import DataWarning
from tests.helpers import refused

DELAYS = np.arange(0.0, 1001.0, 50.0)


def test_a_staircase_moves_up_after_a_stop_and_down_after_a_response():
    delays = [100.0, 200.0, 300.0]
    stops = np.zeros((3, 6), bool)
    stops[:, [2, 3, 4, 5]] = True
    # Two successes reach the end and stay; then four failures reach the other one and stay.
    assert walk(stops, delays, 200.0).tolist() == [1, 2, 2, 1, 0, 0]


def test_interleaved_staircases_each_see_only_their_own_trials():
    table = np.random.default_rng(1).random((len(DELAYS), 200)) < 0.5
    both = walk(table, DELAYS, [200.0, 400.0])
    for which, start in enumerate((200.0, 400.0)):
        assert (both[which::2] == walk(table[:, which::2], DELAYS, start)).all()


@pytest.mark.parametrize(("outcome", "kind"), [(True, "failed"), (False, "successful")])
def test_a_staircase_that_never_reverses_is_warned_of(outcome, kind):
    table = np.full((len(DELAYS), 30), outcome)
    with pytest.warns(DataWarning, match=f"never reverses: all of its 30 stop trials are {kind}"):
        walk(table, DELAYS, 250.0)
    table[:, 7] = not outcome
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        walk(table, DELAYS, 250.0)


@pytest.mark.parametrize(
    ("table", "delays", "starts", "says"),
    [
        (np.ones((2, 5)), [100, 200], 100, "responded True or False"),
        (np.ones((3, 5), bool), [100, 200], 100, "responded each of 2 delays"),
        (np.ones((2, 5), bool), [200, 100], 100, "delays_ms increasing"),
        (np.ones((2, 5), bool), [-100, 100], 100, "delays_ms >= 0"),
        (np.ones((2, 5), bool), [100, 200], [100, 150], "starts_ms among"),
        (np.ones((2, 1), bool), [100, 200], [100, 200], "starts_ms at most one per"),
    ],
)
def test_tables_and_starts_that_do_not_fit_are_refused(table, delays, starts, says):
    with refused(says):
        walk(table, delays, starts)
