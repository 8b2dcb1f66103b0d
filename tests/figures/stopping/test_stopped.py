"""Simulated participants have the go times and the slowing of those that they are like."""

from dataclasses import replace

import numpy as np
import pytest

from bgmodel.fitting.stop_process import laid
from bgmodel.stopping.people import slowing_of
from figures.stopping.stopped import StopValues, like
from tests.stop_trials import walked

VALUES = StopValues(220.0, 0.0, 20.0, 0.0, 0.0)


def test_people_like_others_have_their_go_times_and_slowing():
    people = {f"{who}": walked(who) for who in range(40)}
    slow = {
        who: replace(each, rt_ms=each.rt_ms + 40 * np.append(False, each.stop[:-1]))
        for who, each in people.items()
    }
    data = {who: laid(each.to_trials(), (40.0, 40.0)) for who, each in slow.items()}
    again = like(slow, data, VALUES, 5)
    assert list(again) == list(slow)
    for who in slow:
        assert (again[who].stop == slow[who].stop).all()
    table = slowing_of(again).set_index("measure")
    for name in ("after_failed_stop_ms", "after_successful_stop_ms"):
        assert abs(table.loc[name, "value"] - 40) < 4 * table.loc[name, "se"]
    means = [np.nanmean(some["0"].rt_ms[~some["0"].stop]) for some in (slow, again)]
    assert means[0] == pytest.approx(means[1], abs=25)
