"""Questions about an edge: pairs of taps, directions, and who is fitted on whom."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm

from bgmodel import stream
from bgmodel.tactile.decoder import EDGE
from bgmodel.tactile.skin import Tip
from bgmodel.tactile.source import decoded_edges, folds, source
from bgmodel.tactile.taps import Taps
from bgmodel.tactile.task import EdgeDirection, EdgeTurn, Orientation, SameDifferent

SD_DEG = 2.0
"""Error of the decoder."""


def taps_of(count=1800, seed=61, noise_deg=SD_DEG):
    """Return decoded taps with yaws all around, sorted as recordings are."""
    rng = np.random.default_rng(seed)
    true = np.linspace(-180, 180, count, endpoint=False)
    read = (true + noise_deg * rng.normal(size=count) + 180) % 360 - 180
    return pd.DataFrame({"yaw_deg": true, "edge_deg": read})


def test_pairs_are_of_two_taps_that_lie_as_far_apart_as_asked_also_across_the_seam():
    """From -178 to 179 degrees it is 3 back; -1, 3.4 and 4.6 are 4.4, 5.6 and 1.2 apart."""
    taps = np.array([[-178.0, -177.0], [179.0, 178.0], [3.4, 10.0], [-1.0, 0.0], [4.6, 5.0]])
    same, forth = EdgeTurn(2, 3.0).readings([taps])
    assert same.tolist() == []
    assert forth.tolist() == [5.0]
    # Within half a degree of what was asked.
    for step, read in ((5.05, []), (5.15, [5.0]), (6.05, [5.0]), (4.85, [10.0]), (1.2, [-5.0])):
        assert EdgeTurn(2, step).readings([taps])[1].tolist() == read


def test_a_direction_is_read_as_seen_from_the_first_one():
    """A tap at 179 read as -178 is 3 degrees off, whichever direction is asked."""
    taps = np.array([[179.0, -178.0], [10.0, 8.0]])
    first, second, third = EdgeDirection(3, 120.0).readings([taps])
    np.testing.assert_allclose(first, [3, -2])
    np.testing.assert_allclose(second, [123, 118])
    np.testing.assert_allclose(third, [-117, -122])


@pytest.mark.parametrize(
    ("task", "sd_deg"), [(EdgeTurn(2, 5.0), SD_DEG * np.sqrt(2)), (EdgeDirection(2, 5.0), SD_DEG)]
)
def test_one_reading_is_right_as_often_as_gaussian_errors_let_it(task, sd_deg):
    """Phi(D / 2 sd), where a pair of taps errs by sqrt(2) as much as one."""
    drawn = folds(taps_of(), task).draw(12_000, 1, rng=np.random.default_rng(62))
    right = (drawn.totals[:, -1].argmax(axis=1) == drawn.truth).mean()
    assert right == pytest.approx(norm.cdf(5.0 / 2 / sd_deg), abs=0.02)
    # What a reading says of two hypotheses a distance D apart: D^2 / 2 sd^2 nats on average, in
    # which the kernel of the density, 1 degree at least, widens the errors.
    for k in (0, 1):
        nats = drawn.log_likelihood[drawn.truth == k, 0]
        told = nats[:, k] - nats[:, 1 - k]
        assert told.mean() == pytest.approx(25 / 2 / (sd_deg**2 + 1), rel=0.12)


def test_each_fold_is_scored_by_what_the_others_tell():
    """Other readings of one fold change the likelihoods of all folds but its own."""
    taps = taps_of()
    changed = taps.copy()
    taken = stream(0, "order of taps").permutation(len(taps))[3::6]
    changed.loc[taken, "edge_deg"] = np.random.default_rng(63).permutation(taps["edge_deg"][taken])
    for task in (EdgeTurn(2, 5.0), EdgeDirection(4, 10.0)):
        for fold in range(6):
            a, b = (source(each, task, fold=fold) for each in (taps, changed))
            same = np.array_equal(a.likelihood.log_density, b.likelihood.log_density)
            assert same == (fold == 3)


def test_one_part_of_a_recording_trains_the_decoder_and_another_is_read(monkeypatch, tmp_path):
    """Pins stand where the first part shows them; a tip of 40 mm spans about 122 px."""
    pins = Tip("circular").rest_mm()

    def read_taps(folder, *, mm_per_px, rest=None):
        assert 122 * mm_per_px == pytest.approx(40, rel=0.02)
        yaw = {"csv_train": [1.0, 2.0], "csv_val": [30.0, -40.0, 50.0]}[folder.name]
        pins_of_folder = pins + (folder.name == "csv_val")
        still = np.zeros((len(yaw), len(pins), 2), np.float32)
        return Taps(still, pins_of_folder if rest is None else rest, pd.DataFrame({"yaw_deg": yaw}))

    def train(taps, *, seed, training):
        assert (seed, training) == (5, EDGE)
        assert taps.labels["yaw_deg"].tolist() == [1, 2]
        np.testing.assert_array_equal(taps.rest_mm, pins)
        return Decoder

    class Decoder:
        @staticmethod
        def decode(taps):
            np.testing.assert_array_equal(taps.rest_mm, pins)
            return taps.labels.assign(edge_deg=taps.labels["yaw_deg"] + 3)

    monkeypatch.setattr("bgmodel.tactile.recordings.read_taps", read_taps)
    monkeypatch.setattr("bgmodel.tactile.decoder.train", train)
    assert decoded_edges(5, tmp_path).to_numpy().tolist() == [[30, 33], [-40, -37], [50, 53]]


def test_a_reading_of_single_taps_is_that_of_a_table_of_them():
    """Two taps of an edge 5 degrees apart, decoded at 178 and -177; gratings at 3 and 10."""
    edge = np.array([[0.0, 178.0], [5.0, -177.0]])
    assert EdgeTurn(2, 5.0).readings([edge])[1].tolist() == [5.0]
    assert EdgeTurn(2, 5.0).reading([178.0, -177.0]) == 5.0
    gratings = [np.array([3.0, 4.0]), np.array([10.0])]
    assert SameDifferent().reading([3.0, 10.0]) == SameDifferent().readings(gratings)[1][0]
    assert Orientation(2).reading([3.0]) == Orientation(2).readings(gratings)[0][0]
    as_it_is = EdgeDirection(2, 5.0).readings([np.array([[0.0, 7.0]])])[0]
    assert EdgeDirection(2, 5.0).reading([7.0]) == as_it_is[0]
    assert SameDifferent.taps_per_reading == EdgeTurn.taps_per_reading == 2
    assert Orientation.taps_per_reading == EdgeDirection.taps_per_reading == 1
