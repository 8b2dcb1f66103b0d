"""Measures of a Simon task: known effects of simulated people are found, and no others."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import t as student

from figures.dopamine import measure_medication as medication
from figures.dopamine.simon import (
    QUANTILES,
    expanded,
    means,
    measures,
    of_people,
)

COST_S, FASTER_S, LATER_S, LESS = 0.03, 0.02, 0.01, 0.1
"""Of the people below: cost of incongruence, on minus off, session 2 minus 1, and what off
medication loses in choices of the better item."""


def session(rng, who, medication, number):
    """Return one session: times are normal around a person's own mean, a tenth are errors."""
    fast = (medication != "off") * FASTER_S + (number == 2) * -LATER_S
    congruent = np.arange(300) % 2 == 0
    rt = rng.normal(0.55, 0.06, 300) + COST_S * ~congruent - fast + 0.02 * (int(who[1:]) % 5)
    training = pd.DataFrame(
        {"phase": "training", "congruency": np.where(congruent, "congruent", "incongruent"),
         "pair": "none", "rt": rt, "response": (rng.random(300) < 0.9).astype(float)}
    )  # fmt: skip
    training.loc[::20, ["rt", "response"]] = np.nan
    better = 0.8 - LESS * (medication == "off")
    test = pd.DataFrame(
        {"phase": "test", "congruency": "none", "pair": np.tile(["AD", "BA", "CA", "DB"], 60),
         "rt": 1.0 - fast, "response": (rng.random(240) < better).astype(float)}
    )  # fmt: skip
    rows = pd.concat([training, test], ignore_index=True)
    return rows.assign(participant_id=who, medication=medication, session=number)


@pytest.fixture(scope="module")
def trials():
    rng = np.random.default_rng(7)
    parts = [session(rng, f"c{k}", "none", 1) for k in range(20)]
    for k in range(20):
        order = ("on", "off") if k % 2 else ("off", "on")
        parts += [session(rng, f"p{k}", one, 1 + i) for i, one in enumerate(order)]
    return pd.concat(parts, ignore_index=True)


@pytest.fixture(scope="module")
def each(trials):
    return of_people(trials)


def row(table, measure):
    return table.set_index("measure").loc[measure]


def test_a_session_is_measured_as_it_was_made():
    rows = session(np.random.default_rng(1), "x1", "none", 1)
    measured = measures(rows)
    assert measured["missed"] == pytest.approx(15 / 300)
    right = rows[(rows["phase"] == "training") & (rows["response"] == 1)]
    by = 1000 * right.groupby("congruency")["rt"].mean()
    assert measured["cost_ms"] == pytest.approx(by["incongruent"] - by["congruent"])
    medians = 1000 * right.groupby("congruency")["rt"].median()
    assert measured["q50_ms"] == pytest.approx(medians.mean())
    assert measured["delta_ms"] == pytest.approx(measured["cost_q90_ms"] - measured["cost_q10_ms"])
    test = rows[rows["phase"] == "test"]
    far = test["pair"] == "AD"
    assert measured["better_far"] == pytest.approx(test.loc[far, "response"].mean())
    assert measured["better_near"] == pytest.approx(test.loc[~far, "response"].mean())


def test_the_effects_of_medication_and_of_practice_are_found_and_only_these(each):
    effects = medication.found(each, np.random.default_rng(3))
    change = effects[effects["contrast"] == "on - off"]
    for name in ("congruent_ms", "incongruent_ms", *(f"q{100 * q:.0f}_ms" for q in QUANTILES)):
        assert row(change, name)["high"] < 0
        assert row(change, name)["value"] == pytest.approx(-1000 * FASTER_S, abs=6)
    assert row(change, "better_near")["value"] == pytest.approx(LESS, abs=0.03)
    assert row(change, "better_far")["low"] > 0
    for name in ("cost_ms", "delta_ms", "missed", "congruent_right"):
        assert row(change, name)["low"] <= 0 <= row(change, name)["high"]
    later = row(effects[effects["contrast"] == "session 2 - 1"], "q50_ms")
    assert later["value"] == pytest.approx(1000 * LATER_S, abs=6)
    assert later["low"] > 0
    assert row(effects[effects["contrast"] == "controls"], "cost_ms")["low"] > 0


def test_shuffled_labels_of_medication_have_no_effect(each, monkeypatch):
    monkeypatch.setattr(medication, "measured", lambda who: each)
    effect = row(medication.shuffled(60), "q50_ms")
    assert effect["excluded"] < 0.2  # 0.05 is expected; with 60 shuffles 0.2 is beyond 5 s.e.
    assert abs(effect["value"]) < 5


@pytest.mark.parametrize("people", [8, 22, 1000])
def test_intervals_of_few_people_are_as_wide_as_those_of_student(people):
    rng = np.random.default_rng(4)
    widths = []
    for _ in range(60):
        rows = pd.DataFrame({"x": rng.normal(0, 1, people)})
        mean = means(rows, rng).iloc[0]
        half = student.ppf(0.975, people - 1) * rows["x"].sem()
        widths.append((mean["high"] - mean["low"]) / (2 * half))
    # An end of an interval from 1000 resamples has an error of some 4 %.
    assert np.mean(widths) == pytest.approx(1, abs=0.03)
    assert expanded(10**6) == pytest.approx(0.025, abs=1e-6)
