"""The circuit in a Simon task, and outcomes of predictions."""

from dataclasses import replace

import numpy as np
import pytest

from bgmodel.experiments.expected import AGREES, DISAGREES
from figures.dopamine.simon import of_people
from figures.dopamine.simon_model import (
    DEADLINE_MS,
    Simon,
    colour,
    items,
    simulated,
)
from figures.dopamine.simon_predictions import (
    CONTRASTS,
    KINDS,
    MEASURES,
    OPEN,
    Prediction,
    Told,
    lines,
    told,
    written,
)

SIMON = Simon(0.47, 0.37, 0.775, 0.7, 335.0, "pulse")


def prediction(low, high):
    return Prediction("pulse", "on - off", "q50_ms", (low + high) / 2, low, high, False)


@pytest.mark.parametrize(
    ("predicted", "data", "outcome"),
    [
        ((10, 30), (5, 25), AGREES),
        ((10, 30), (-5, 25), OPEN),
        ((10, 30), (-25, 5), DISAGREES),
        ((10, 30), (31, 50), DISAGREES),
        ((-30, -10), (-25, -5), AGREES),
        ((-10, 10), (-5, 5), AGREES),
        ((-10, 10), (5, 15), OPEN),
        ((-10, 10), (11, 15), DISAGREES),
        ((10, 30), (np.nan, np.nan), OPEN),
    ],
)
def test_an_outcome_says_whether_people_tell_a_prediction_from_none(predicted, data, outcome):
    assert prediction(*predicted).outcome(*data) == outcome


def test_predictions_are_read_as_they_were_written(tmp_path):
    made = Told(5, 10, [SIMON], [prediction(-1.5, 2.5)])
    (tmp_path / "told.toml").write_text(written(made))
    assert told(tmp_path / "told.toml") == made


def test_the_committed_predictions_are_complete():
    committed = told()
    assert [each.kind for each in committed.models] == list(KINDS)
    for kind in KINDS:
        mine = [(p.contrast, p.measure) for p in committed.predictions if p.kind == kind]
        assert mine == lines(kind)
    assert set(MEASURES) == set(CONTRASTS)


def test_the_location_excites_its_channel_and_is_no_evidence():
    plain, congruent = colour(replace(SIMON, location_nats=0.0), 8, 1)
    shown, _ = colour(SIMON, 8, 1)
    added = (shown.log_likelihood - plain.log_likelihood).cumsum(axis=1)
    assert congruent.sum() == 4
    for k in range(8):
        side = shown.truth[k] if congruent[k] else 1 - shown.truth[k]
        assert added[k, -1, side] == pytest.approx(SIMON.location_nats)
        assert added[k, :, 1 - side] == pytest.approx(0.0)


def test_the_mean_reading_of_the_test_is_proportional_to_the_difference_of_value():
    shown, pairs = items(SIMON, 2400, 3)
    lead = (shown.log_likelihood[..., 0] - shown.log_likelihood[..., 1]).mean(axis=1)
    sizes = {"far": ("AD", "DA"), "near": ("AB", "CA", "DB", "CD"), "none": ("BC", "CB")}
    mean = {name: lead[np.isin(pairs, some)].mean() for name, some in sizes.items()}
    error = SIMON.d_prime / np.sqrt(300 * 400)
    unit = SIMON.value * SIMON.d_prime**2 / 2
    for name, apart in (("far", 1.0), ("near", 0.5), ("none", 0.0)):
        assert mean[name] == pytest.approx(unit * apart, abs=5 * error)


def test_less_dopamine_is_slower_and_misses_more_and_no_response_comes_after_the_deadline():
    each = {}
    for dopamine in (1.0, 0.85):
        trials = simulated(SIMON, dopamine, 8, 4)
        training = trials[trials["phase"] == "training"]
        assert training["rt"].max() <= DEADLINE_MS / 1000
        assert (trials["rt"].isna() == trials["response"].isna()).all()
        each[dopamine] = of_people(trials.assign(session=1, medication=str(dopamine)))
    normal, less = (each[level].mean(numeric_only=True) for level in (1.0, 0.85))
    assert less["q50_ms"] > normal["q50_ms"] + 5
    assert less["missed"] > normal["missed"] + 0.02
    assert normal["cost_ms"] > 15
    assert normal["better_far"] > normal["better_near"] > 0.5
