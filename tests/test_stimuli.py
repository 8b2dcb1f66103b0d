"""Stimuli drawn for a circuit or a test."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from bgmodel import stream
from bgmodel.simulated_evidence import separated_evidence
from bgmodel.stimuli import Stimuli, circuit_seen_from, seen_from
from tests.helpers import refused


def test_a_competitor_rises_and_nothing_else():
    """Means of the readings: the true channel's, its fraction in the next one, 0 in the others."""
    given = {"rng": stream(1, "r"), "hypotheses": 4}
    drawn = separated_evidence(4000, 5, 0.8, conflict=0.5, **given)
    turned = [
        np.roll(x.mean(axis=0), -k) for x, k in zip(drawn.log_likelihood, drawn.truth, strict=True)
    ]
    np.testing.assert_allclose(np.mean(turned, axis=0) / 0.8, [0.8, 0.4, 0, 0], atol=0.03)
    plain = separated_evidence(10, 5, 0.8, rng=stream(1, "r"))
    same = separated_evidence(10, 5, 0.8, rng=stream(1, "r"), conflict=0.0)
    np.testing.assert_array_equal(plain.log_likelihood, same.log_likelihood)
    with refused("conflict"):
        Stimuli(task="orientation", conflict=0.5).check_idle()


@dataclass(frozen=True)
class Asked:
    circuit: str
    task: Stimuli


def test_files_are_looked_for_beside_the_file_that_names_them():
    folder = Path("studies")
    named = seen_from(folder, Asked("appendix_b", Stimuli()))
    assert named == Asked("appendix_b", Stimuli())
    found = seen_from(folder, Asked("mine.toml", Stimuli(evidence=Path("own.csv"))))
    assert found.circuit == circuit_seen_from(folder, "mine.toml") == str(folder / "mine.toml")
    assert found.task.evidence == folder / "own.csv"
    absolute = Path("/data/own.csv")
    assert seen_from(folder, Asked("x", Stimuli(evidence=absolute))).task.evidence == absolute


RAMP = {"expectancy_nats": 3.0, "expectancy_ms": 800.0}


def test_what_is_expected_comes_before_the_same_evidence():
    plain = Stimuli(trials=8).draw(5, "t").evidence
    asked = Stimuli(trials=8, **RAMP)
    asked.check()
    ahead = asked.draw(5, "t").evidence
    np.testing.assert_array_equal(ahead.log_likelihood, plain.log_likelihood)
    assert ahead.foreperiod_steps == 16
    assert asked.used()["expectancy_ms"] == 800
    assert "expectancy_ms" not in Stimuli(trials=8).used()


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"expectancy_nats": 3.0}, "foreperiod_ms must be .* whole steps of 50"),
        (
            {"expectancy_nats": 3.0, "expectancy_ms": 70.0},
            "foreperiod_ms must be one or more whole steps",
        ),
        ({"expectancy_nats": -1.0}, "expectancy_nats must be >= 0 and finite, got -1"),
        ({"expectancy_ms": 800.0}, "expectancy_ms is for a task with expectancy_nats > 0"),
        ({"evidence": Path("a.csv"), **RAMP}, "expectancy_nats is for evidence that is drawn"),
    ],
)
def test_a_ramp_without_a_foreperiod_is_one_sentence(given, sentence):
    def checked():
        Stimuli(**given).check()
        Stimuli(**given).check_idle()

    with pytest.raises(ValueError, match=f"^{sentence}"):
        checked()
