"""Predictions: sizes that a measure can have, in its unit."""

import numpy as np
import pytest

from bgmodel.deciding.measures import MEASURES, OF_STOP, SHARES
from bgmodel.experiments.experiment import shipped
from bgmodel.experiments.predictions import LIKELY, Effect, Prediction
from circuits.errors import DataWarning
from tests.helpers import refused, unwarned


def test_every_measure_has_likely_sizes_and_those_that_ship_are():
    assert LIKELY.keys() == {*MEASURES, *OF_STOP}
    with unwarned():
        assert shipped()
        for size in (0.0, 1.0, 30.0, 5000.0):
            Prediction("mean_all_ms", "up", size)


@pytest.mark.parametrize("measure", SHARES)
@pytest.mark.parametrize("size", [1, 1.5, 3, 100])
def test_a_share_that_changes_by_one_or_more_is_refused(measure, size):
    with refused("at_least must be a share, below 1"):
        Prediction(measure, "up", size)
    Effect(measure, 1.0, "nobody")
    with refused("value must be a share, below 1"):
        Effect(measure, -max(size, 1.1), "nobody")
    Effect("accuracy", -3.4, "nobody", unit="percent")


@pytest.mark.parametrize(
    ("measure", "size"),
    [
        ("accuracy", 0.9),
        ("missed", 0.51),
        ("mean_ms", 0.03),
        ("mean_all_ms", 0.5),
        ("non_decision_ms", 0.2),
        ("decided", 0.05),
        ("drift", 1.2),
        ("boundary_separation", 2.0),
    ],
)
def test_a_size_that_seems_to_be_in_another_unit_is_warned_of(measure, size):
    for make in (lambda: Prediction(measure, "up", size), lambda: Effect(measure, -size, "nobody")):
        with pytest.warns(DataWarning):
            make()


@pytest.mark.parametrize("measure", [*MEASURES, *OF_STOP])
def test_likely_sizes_are_not_warned_of(measure):
    low, high = LIKELY[measure]
    with unwarned():
        for size in (0.0, low, min(high, 1e4), np.clip(0.1, low, high)):
            Prediction(measure, "up", size)
