"""Pairs of taps on an edge: their halves, their differences, and who is fitted on whom."""

import numpy as np
import pandas as pd
import pytest

from bgmodel.tactile.decoder import EDGE
from bgmodel.tactile.edges import decoded_yaw, halves, pairs, sources
from bgmodel.tactile.taps import Taps
from bgmodel.tactile.tips import Tip
from tests.helpers import refused

DIFFERENCES = (0.0, 5.0)


def taps_of(count, seed, noise_deg=1.0):
    """Return true and decoded yaw of taps at three yaws, 5 degrees apart."""
    rng = np.random.default_rng(seed)
    true = 5.0 * rng.integers(-1, 2, count)
    return np.stack([true, true + noise_deg * rng.normal(size=count)], axis=1)


@pytest.mark.parametrize("count", [10, 11])
def test_halves_hold_every_tap_once_and_no_order_of_the_table(count):
    taps = np.arange(2.0 * count).reshape(count, 2)
    first, second = halves(1, taps)
    assert abs(len(first) - len(second)) <= 1
    together = np.concatenate([first, second])
    assert not np.array_equal(together, taps)
    assert np.array_equal(together[np.argsort(together[:, 0])], taps)
    assert np.array_equal(halves(1, taps)[0], first)
    assert not np.array_equal(halves(2, taps)[0], first)


def test_pairs_are_of_two_taps_that_lie_as_far_apart_as_asked_also_across_the_seam():
    """From -178 to 179 degrees it is 3 back; -1, 3.4 and 4.6 are 4.4, 5.6 and 1.2 apart."""
    taps = np.array([[-178.0, -177.0], [179.0, 178.0], [3.4, 10.0], [-1.0, 0.0], [4.6, 5.0]])
    back, forth, same = pairs([-3.0, 3.0, 0.0], taps)
    assert back.tolist() == [-5.0]
    assert forth.tolist() == [5.0]
    assert same.tolist() == []
    # Within half a degree of what was asked.
    far, near, above, below = pairs([5.05, 5.15, 6.05, 4.85], taps)
    assert far.tolist() == []
    assert near.tolist() == above.tolist() == [5.0]
    assert below.tolist() == [10.0]
    assert pairs([1.2], taps)[0].tolist() == [-5.0]


def test_each_half_is_scored_by_what_the_other_half_tells():
    """Where one half is decoded at random, the other is told nothing and the first is."""
    good, bad = halves(3, taps_of(120, seed=62))
    bad = np.stack([bad[:, 0], np.random.default_rng(63).permutation(bad[:, 1])], axis=1)
    scored_bad, scored_good = sources([bad, good], DIFFERENCES)
    assert scored_bad.names == scored_good.names == ("0", "5")
    for found, half in ((scored_bad, bad), (scored_good, good)):
        read = pairs(DIFFERENCES, half)
        assert [len(x) for x in found.log_likelihood] == [len(x) for x in read]
        for logs, x in zip(found.log_likelihood, read, strict=True):
            np.testing.assert_array_equal(logs, found.likelihood(x))
    # Fitted on the good half, a difference of 5 degrees read as such speaks for 5.
    zero, five = scored_bad.likelihood(np.array([0.0, 5.0]))
    assert zero[0] > zero[1] + 1
    assert five[1] > five[0] + 1
    # Fitted on the random half, no reading says anything worth a tenth of that.
    told = np.ptp(scored_good.likelihood(np.array([0.0, 5.0])), axis=1)
    assert told.max() < 0.1


def test_a_difference_of_two_directions_spans_a_whole_turn_and_no_more():
    for found in sources(halves(3, taps_of(120, seed=62)), DIFFERENCES):
        assert np.isfinite(found.likelihood([-180.0, 180.0])).all()
        for beyond in (-180.1, 180.1):
            with refused(r"reading_deg covers -180\.\.180 degrees"):
                found.likelihood(beyond)


def test_one_part_of_a_recording_trains_the_decoder_and_another_is_read(monkeypatch, tmp_path):
    """Pins stand where the first part shows them; a tip of 40 mm spans about 122 px."""
    pins = Tip("circular").rest_mm()

    def read_taps(folder, *, mm_per_px, rest=None):
        assert 122 * mm_per_px == pytest.approx(40, rel=0.02)
        yaw = {"csv_train": [1.0, 2.0], "csv_val": [30.0, -40.0, 50.0]}[folder.name]
        own = pins + (folder.name == "csv_val")
        still = np.zeros((len(yaw), len(pins), 2), np.float32)
        return Taps(still, own if rest is None else rest, pd.DataFrame({"yaw_deg": yaw}))

    def train(taps, *, seed, training):
        assert (seed, training) == (5, EDGE)
        assert taps.labels["yaw_deg"].tolist() == [1, 2]
        np.testing.assert_array_equal(taps.rest_mm, pins)
        return Decoder

    class Decoder:
        @staticmethod
        def decode(taps):
            np.testing.assert_array_equal(taps.rest_mm, pins)
            return {"edge_deg": taps.labels["yaw_deg"].to_numpy() + 3}

    monkeypatch.setattr("bgmodel.tactile.edges.read_taps", read_taps)
    monkeypatch.setattr("bgmodel.tactile.edges.train", train)
    assert decoded_yaw(5, tmp_path).tolist() == [[30, 33], [-40, -37], [50, 53]]
