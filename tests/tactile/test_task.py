"""The tactile tasks on the held-out taps that ship with the package."""

import json
import warnings
from dataclasses import asdict, replace
from functools import cache
from importlib import resources

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bgmodel import Msprt, Sprt, stream
from bgmodel.bootstrap import interval, resampled
from bgmodel.deciding.decision import first_crossing
from bgmodel.learning.gap import fold_sources
from bgmodel.support.files import read_provenance
from bgmodel.tactile.decoder import Training
from bgmodel.tactile.pressing import PERIODS_MM, Grating, LibraryPlan
from bgmodel.tactile.sensor import Nuisance
from bgmodel.tactile.skin import Skin, Tip
from bgmodel.tactile.source import Folds, Source, folds, held_out_taps, source
from bgmodel.tactile.task import Orientation, SameDifferent
from circuits.errors import CalibrationWarning
from tests.helpers import refused, refusing

TAPS = held_out_taps()


@cache
def shipped(task, fold=0):
    """Return readings of the shipped taps; fitted once for all tests."""
    return source(TAPS, task, fold=fold)


@cache
def pairs(period_mm):
    """Return readings of pairs of the shipped taps, fold by fold."""
    return fold_sources(TAPS, period_mm)


@pytest.mark.parametrize("kind", [Tip, Skin, Nuisance, Training])
def test_the_shipped_taps_are_those_of_the_default_sensor_and_decoder(kind):
    """With other defaults the package would simulate other taps than it ships."""
    with resources.as_file(resources.files("bgmodel") / "data" / "held_out_taps.parquet") as path:
        made = read_provenance(path)["parameters"][kind.__name__.lower()]
    # The taps were drawn when noise could also be drawn per frame.
    assert made.pop("noise_per", "tap") == "tap"
    made.pop("frames", None)
    assert made == {**json.loads(json.dumps(asdict(kind()))), "kind": kind.__name__}


def test_the_shipped_taps_are_of_every_grating_that_the_default_library_holds():
    """That library is of the default sensor, at its least, middle and largest force."""
    plan, force_n = LibraryPlan(), Nuisance().force_n
    assert tuple(np.unique(TAPS["period_mm"])) == PERIODS_MM == plan.periods_mm
    assert (plan.skin, plan.radius_mm) == (Skin(), Tip().radius_mm)
    assert plan.forces_n == pytest.approx((force_n[0], np.mean(force_n), force_n[1]))
    assert plan.depth_mm == Grating(2.0).depth_mm


def test_a_smooth_plate_tells_no_orientation():
    """Pooled over folds; a shrinkage that finds a little by chance costs a few per cent."""
    accuracy = []
    for fold in range(6):
        readings = shipped(Orientation(8, period_mm=0.0), fold)
        evidence = readings.draw(2000, 30, rng=stream(1, "smooth", fold))
        accuracy.append(first_crossing(Msprt().run(evidence), 0.01, checked=False).accuracy)
    assert abs(np.mean(accuracy) - 1 / 8) < 0.05
    # Nor does the linear head lean with the yaw.
    smooth = TAPS[np.isclose(TAPS["period_mm"], 0)]
    lean = smooth.groupby("yaw_deg")["psi_deg"].mean()
    assert lean.std() < 3


def test_scored_taps_fit_nothing():
    """Whatever the scored fold holds, the likelihood is the same; other taps do change it."""
    first = shipped(SameDifferent(period_mm=2.0), 2).likelihood
    here = np.flatnonzero(np.isclose(TAPS["period_mm"], 2.0) & np.isclose(TAPS["yaw_deg"], 45))
    for fold, same in ((2, True), (3, False)):
        changed = TAPS.copy()
        changed.loc[changed.index[here[np.arange(len(here)) % 6 == fold]], "psi_deg"] = 0.0
        again = source(changed, SameDifferent(period_mm=2.0), fold=2).likelihood
        assert np.array_equal(again.log_density, first.log_density) == same


def test_shuffled_truth_is_at_chance():
    readings = pairs(2.5)[0]
    evidence = readings.draw(20_000, 30, rng=stream(1, "shuffled"))
    trace = Sprt().run(evidence)
    decision = first_crossing(trace, Sprt.threshold(4.0))
    truth = stream(2, "shuffled").permutation(evidence.truth)
    assert decision.accuracy > 0.98
    assert abs((decision.choice == truth).mean() - 0.5) < 0.02


def drawn(readings, *trials):
    """Log-likelihoods of trials drawn in blocks from one generator."""
    rng = stream(4, "drawn")
    return np.concatenate([readings.draw(n, 3, rng=rng).log_likelihood for n in trials])


@settings(max_examples=30)
@given(trials=st.integers(1, 41), tables=st.lists(st.integers(1, 60), min_size=2, max_size=4))
def test_a_trial_does_not_depend_on_those_after_it(trials, tables):
    count = len(tables)
    names = tuple("abcd"[:count])
    values = [1000.0 * i + np.arange(float(n)) for i, n in enumerate(tables)]
    # A reading tells its hypothesis and its place in the table.
    readings = Source([np.stack([v] * count, axis=1) for v in values], names, None)
    longer = drawn(readings, 2 * trials)
    assert np.array_equal(drawn(readings, trials), longer[:trials])
    assert (longer[..., 0] // 1000 == (np.arange(2 * trials) % count)[:, None]).all()
    # Blocks that end with a whole round of hypotheses continue one another.
    blocks = drawn(readings, count * trials, count * trials)
    assert np.array_equal(blocks, drawn(readings, 2 * count * trials))


def test_every_reading_is_as_likely_to_be_drawn():
    table = np.arange(10.0)
    readings = Source([np.stack([table, table], axis=1)] * 2, ("a", "b"), None)
    values = readings.draw(10_000, 10, rng=stream(5, "even")).log_likelihood[..., 0]
    for truth in (0, 1):
        counts = np.bincount(values[truth::2].ravel().astype(int), minlength=10)
        assert np.abs(counts - 5000).max() < 5 * np.sqrt(4500)


def test_a_difference_of_two_orientations_spans_a_whole_turn_and_no_more():
    """Two angles within -90..90 differ by -180..180; an orientation itself repeats after 180."""
    likelihood = source(TAPS, SameDifferent(3.0), fold=0).likelihood
    assert np.isfinite(likelihood([-180.0, 180.0])).all()
    for beyond in (-180.1, 180.1):
        with refused(r"reading_deg covers -180..180 degrees"):
            likelihood(beyond)


test_bad_input_gets_one_clear_sentence = refusing(
    (lambda: source(TAPS, SameDifferent(period_mm=2.0), fold=6), "fold"),
    (lambda: shipped(SameDifferent(period_mm=2.2), 0), "period_mm must be one of"),
    (lambda: shipped(SameDifferent(b_deg=9, period_mm=2.0), 0), "taps --yaw-deg -45 9"),
    (lambda: pairs(2.0)[0].draw(0, 5, rng=stream(1)), "trials must be"),
    (lambda: source(TAPS.head(0), SameDifferent(period_mm=2.0), fold=0), "period_mm must be one"),
)


def test_folds_are_drawn_in_turn_and_their_interval_is_wider_than_that_of_trials():
    drawn = folds(TAPS, SameDifferent(period_mm=1.5))
    evidence = drawn.draw(3000, 20, rng=stream(1, "folds"), step_ms=50.0)
    groups = drawn.groups(3000)
    assert np.bincount(groups).tolist() == [500] * 6
    for fold in range(6):
        assert np.bincount(evidence.truth[groups == fold]).tolist() == [250, 250]
    nats = drawn.sources[2].log_likelihood[1]
    second = evidence.log_likelihood[(groups == 2) & (evidence.truth == 1)]
    assert np.isin(second[:, :, 0], nats[:, 0]).all()
    # Correct after 20 readings: 0.77 to 0.88 of a fold, where 500 trials know it to +-0.03.
    right = (evidence.totals[:, -1].argmax(axis=1) == evidence.truth) / 3000
    widths = []
    for given_groups in (None, groups):
        _, low, high = interval(resampled(3000, 500, stream(2, "b"), given_groups) @ right)
        widths.append(high - low)
    assert widths[1] > 1.5 * widths[0]
    with refused("trials must be 6 or more, one per fold"):
        Folds(drawn.sources).draw(5, 2, rng=stream(1, "few"))


def test_evidence_of_folds_has_one_baseline_known_before_the_trials():
    drawn = folds(TAPS, SameDifferent(period_mm=2.0))
    want = np.mean([one.baseline for one in drawn.sources])
    for trials in (6, 30):
        baseline = drawn.draw(trials, 4, rng=np.random.default_rng(trials)).baseline
        assert baseline == pytest.approx(want, abs=1e-12)
    assert want < 0


@pytest.mark.parametrize("count", [2, 8])
def test_orientations_that_the_decoder_does_not_resolve_are_warned_of(count):
    fine, coarse = (shipped(Orientation(count, period_mm=period), 0) for period in (1.0, 2.0))
    with pytest.warns(CalibrationWarning, match=f"the {count} hypotheses at a period of 1 mm"):
        fine.warn_if_silent()
    assert np.ptp(np.concatenate(fine.log_likelihood)) == 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        coarse.warn_if_silent()


def test_the_group_of_a_trial_is_the_fold_that_its_readings_are_from():
    """Each fold has readings of one value, its number."""
    one = shipped(SameDifferent())
    of = lambda fold: [np.full_like(part, fold) for part in one.log_likelihood]  # noqa: E731
    sources = [replace(one, log_likelihood=of(fold)) for fold in range(4)]
    drawn = Folds(sources).draw(30, 3, rng=stream(1, "folds"))
    groups = Folds(sources).groups(30)
    assert (drawn.log_likelihood == groups[:, None, None]).all()
    assert np.bincount(groups).max() - np.bincount(groups).min() <= 1
