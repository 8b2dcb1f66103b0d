"""Tables of choices that mislead: refused, or said with the number."""

import warnings

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bgmodel.support.seeds import stream
from bgmodel.trials.cautions import (
    STEPS_S,
    check_deadline,
    check_signs,
    check_times,
    without_rounding,
)
from bgmodel.trials.files import shipped, shipped_table
from bgmodel.trials.reader import read_trials
from circuits.errors import DataWarning
from tests.helpers import refused, told, unwarned
from tests.read import at, read, silent

TRIALS = 400


def table(**columns):
    """Return one participant's trials: right in four of five, at signed coherences."""
    rng = stream(81, "cautions")
    coherence = rng.choice([-0.4, -0.1, 0.1, 0.4], TRIALS)
    right = rng.random(TRIALS) < 0.8
    good = {
        "rt": rng.gamma(4, 0.1, TRIALS) + 0.3,
        "response": (right == (coherence > 0)).astype(int),
        "coherence": coherence,
    }
    return pd.DataFrame({**good, **columns})


GOOD = table()
NAMED = {"strength": "coherence"}


def texts(source, **options):
    return told(read, source, **options)


def test_good_tables_and_the_published_ones_are_read_without_a_word():
    assert texts(GOOD, **NAMED) == []
    for name, one in shipped().items():
        assert texts(name, strength=one.strength, conditions=one.conditions) == []


@pytest.mark.parametrize("deadline_s", [120.0, 1200.0])
def test_a_deadline_in_another_unit_is_refused(deadline_s):
    with refused(f"deadline_s got {deadline_s:g},"):
        read(silent(GOOD, [3, 40]), **NAMED, deadline_s=deadline_s)


@given(st.floats(0.1, 100), st.floats(0.1, 100))
def test_a_deadline_is_judged_by_its_ratio_to_the_slowest_response(slowest, deadline_s):
    rt_s = np.array([slowest / 2, slowest, np.nan])
    if deadline_s >= 10 * slowest:
        with refused("deadline_s"), unwarned():
            check_deadline(rt_s, deadline_s)
    else:
        assert len(told(check_deadline, rt_s, deadline_s)) == (deadline_s >= 3 * slowest)


def test_hundredths_of_a_second_are_no_seconds():
    """Their median, 45 to 70, is that of a slow task; whole numbers tell."""
    hundredths = 100 * (GOOD["rt"] - 0.25)
    assert 5 < hundredths.median() < 50
    with refused("rt"):
        read_trials(table(rt=np.ceil(hundredths)), **NAMED)
    (text,) = texts(table(rt=hundredths), **NAMED)
    assert f"{hundredths.median():.3g} s" in text


@pytest.mark.parametrize("step_s", STEPS_S)
def test_coarse_times_are_said_with_their_step_and_what_it_does(step_s):
    rt = np.maximum(step_s * np.round(GOOD["rt"] / step_s), step_s)
    (text,) = texts(table(rt=rt), **NAMED)
    assert f"multiples of {step_s:.3g} s" in text
    assert f" {1000 * step_s / np.sqrt(12):.0f} ms" in text


def test_many_times_that_are_exactly_the_longest_are_doubted():
    """Trials that were cut off after 1 s; coarse times share a longest one by chance."""
    assert (GOOD["rt"] > 1).sum() > 10
    (text,) = texts(table(rt=GOOD["rt"].clip(upper=1)), **NAMED)
    assert text.startswith(f"{(GOOD['rt'] > 1).sum()} of 400 times are exactly the longest one, 1 ")
    few = GOOD["rt"].where(GOOD["rt"].rank(ascending=False) > 4, GOOD["rt"].max())
    assert texts(table(rt=few), **NAMED) == []
    coarse = np.repeat(np.arange(4, 12) / 10, 50)
    assert not any("longest" in text for text in texts(table(rt=coarse), **NAMED))


def test_a_strength_far_beyond_all_others_is_doubted_in_few_trials():
    """A slip of the pen, or 999 for none, would set the sensitivity of all trials."""
    for wrong in (40.0, -999.0):
        (text,) = texts(at("coherence", 0, wrong)(GOOD), **NAMED)
        assert text.startswith(f"1 of 400 trials have a strength of {abs(wrong):g} or more, and ")
    assert texts(at("coherence", 0, 3.9)(GOOD), **NAMED) == []
    weak = np.where(np.abs(GOOD["coherence"]) < 0.2, GOOD["coherence"] / 100, GOOD["coherence"])
    assert texts(table(coherence=weak), **NAMED) == []


def test_trials_that_are_all_there_twice_are_doubted():
    """Neither new numbers nor columns that a merge has added make them other trials."""
    both = pd.concat([GOOD, GOOD])
    merged = GOOD.merge(pd.DataFrame({"block": [1, 2]}), how="cross")
    for twice in (both, both.assign(trial=np.arange(800)), merged):
        (text,) = texts(twice, **NAMED)
        assert text.startswith("400 of 800 rows are duplicates of earlier ones")


@pytest.mark.parametrize("step_s", [None, 0.001, 0.005])
@pytest.mark.parametrize("rows", [TRIALS, 4000])
def test_trials_some_of_which_are_there_twice_are_doubted_where_chance_is_no_reason(step_s, rows):
    """In milliseconds, or at a camera's frames, times coincide by chance too."""
    if step_s == 0.005 and rows == 4000:
        pytest.skip("chance repeats times too often for copies to show")
    for seed in range(5):
        many = shuffled(rows, seed)
        if step_s is not None:
            many["rt"] = (many["rt"] / step_s).round() * step_s
        assert not any("duplicates" in text for text in texts(many, **NAMED))
        numbered = many.assign(trial=np.arange(rows))
        for some in (many, numbered):
            copied = pd.concat([some, some.sample(frac=0.3, random_state=seed)])
            (text,) = (text for text in texts(copied, **NAMED) if "duplicates" in text)
            assert f"of {len(copied)} rows" in text


@pytest.mark.parametrize("step_s", [0.01, 1 / 60, 0.1, 0.5])
def test_times_in_coarse_steps_are_no_copies(step_s):
    for many in (shuffled(2000, seed) for seed in range(5)):
        rounded = ((many["rt"] / step_s).round() * step_s).clip(lower=step_s).round(3)
        assert not any("duplicates" in text for text in texts(many.assign(rt=rounded), **NAMED))


def shuffled(rows, seed):
    """Return trials as of ``table``, with times that depend on the strength."""
    rng = stream(seed, "copies")
    coherence = rng.choice([-0.4, -0.1, 0.1, 0.4], rows)
    right = rng.random(rows) < 0.8
    rt = rng.gamma(4, 0.1 / (0.5 + abs(coherence))) + 0.3
    response = (right == (coherence > 0)).astype(int)
    return pd.DataFrame({"rt": rt, "response": response, "coherence": coherence})


def test_strengths_in_per_cent_in_some_trials_are_doubted():
    part = GOOD.index % 2 == 0
    mixed = GOOD["coherence"].where(part, 100 * GOOD["coherence"])
    (text,) = texts(table(coherence=mixed), **NAMED)
    assert text.startswith("2 of 4 strengths also occur a hundred times as large, such as 0.1 ")
    assert f"in {int((~part).sum())} of 400 trials" in text
    # Contrasts, per cent: one pair alone is no other unit.
    signs = np.sign(GOOD["coherence"])
    assert texts(table(coherence=signs * np.array([1.0, 10, 30, 100] * 100)), **NAMED) == []


@pytest.mark.parametrize("name", ["id", "monkey", "Monkey_ID", "rat", "animal name", "observer"])
def test_columns_that_may_hold_participants_are_not_pooled(name):
    who = np.where(np.arange(TRIALS) < 150, "b", "n")
    with refused("participant"):
        read(table(**{name: who}), **NAMED)
    read(table(**{name: who, "participant_id": who}), **NAMED)
    read(table(**{name: who}), **NAMED, conditions=[name])
    read(table(**{name: "b"}), **NAMED)


def test_columns_that_hold_no_strength_are_not_taken_for_one():
    rng = stream(82, "cautions")
    more = {
        "trial": np.arange(TRIALS),
        "theta": rng.normal(size=TRIALS),
        "correct": GOOD["response"],
        "cue": np.where(np.arange(TRIALS) % 2, "speed", "accuracy"),
        "empty": np.nan,
    }
    without = table(**more).drop(columns="coherence")
    later = without.assign(response=(without["trial"] > 100).astype(int))
    for some in (without, later):
        assert not any("may hold it" in text for text in texts(some))
    assert any("level" in text for text in texts(later.rename(columns={"trial": "level"})))


def test_strengths_that_differ_by_rounding_only_are_one():
    at = GOOD.index % 7 == 0
    rounded = GOOD["coherence"] * np.where(at, 1 + 1e-7, 1.0)
    with pytest.warns(DataWarning, match="4 strengths are merged to 2"):
        trials = read(table(coherence=rounded), **NAMED)
    assert trials.strength.tolist() == GOOD["coherence"].tolist()


@given(st.lists(st.floats(1e-3, 10), min_size=1, max_size=8), st.integers(0, 2**32))
def test_taking_strengths_for_one_changes_none_by_more_than_a_millionth(sizes, seed):
    rng = stream(seed, "strengths")
    given_ = rng.choice([-1, 1], 60) * rng.choice(sizes, 60) * (1 + 1e-8 * rng.normal(size=60))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        merged = without_rounding(given_)
        assert np.array_equal(without_rounding(merged), merged)
    assert merged == pytest.approx(given_, rel=1e-5)
    assert len(np.unique(np.abs(merged))) <= len(sizes)


def answered(right, wrong, missed=0):
    """Return as many responses of each kind."""
    return np.repeat([1, 0, -1], [right, wrong, missed]).astype(np.int8)


def test_strengths_without_a_sign_are_refused_by_20_or_more_responses_to_the_largest():
    """Where more than two fifths are against it; misses and weaker strengths do not count."""
    check_signs(np.full(29, 0.4), answered(12, 8, missed=9))
    check_signs(np.full(20, 0.4), answered(0, 19, missed=1))
    check_signs(None, answered(0, 29))
    check_signs(np.zeros(29), answered(0, 29))
    with refused("strength"):
        check_signs(np.full(20, 0.4), answered(11, 9))
    for other in (-0.4, 0.1):
        check_signs(np.array([0.4] * 19 + [other]), answered(11, 9))
    with refused("strength must be signed"):
        read(table(coherence=GOOD["coherence"].abs()), **NAMED)


@pytest.mark.parametrize("step_s", [0.01, 0.005, 0.002, 0.001])
def test_finer_steps_and_few_times_are_not_worth_a_word(step_s):
    assert texts(table(rt=step_s * np.round(GOOD["rt"] / step_s)), **NAMED) == []
    assert told(check_times, np.full(9, 8.0)) == []


@pytest.mark.parametrize("right", [240, 239])
def test_response_1_is_doubted_where_it_is_less_than_three_fifths_of_responses(right):
    without = table(response=np.repeat([1, 0], [right, TRIALS - right])).drop(columns="coherence")
    assert ["it is 60% of responses" in text for text in texts(without)] == [True] * (right == 239)


def test_trials_without_a_response_are_no_copies():
    late = silent(shuffled(TRIALS, 1), range(0, TRIALS, 4))
    assert texts(late, **NAMED, deadline_s=3.0) == []


@pytest.mark.parametrize("name", ["pedersen_frank_2020", "stop_signal_cnp"])
def test_fast_trials_that_were_left_out_of_many_people_are_asked_about(name):
    table, _ = shipped_table(name)
    tenth_s = table.groupby("participant_id")["rt"].transform("quantile", 0.1)
    cut = table[~(table["rt"] < tenth_s)].reset_index(drop=True)

    def asked(some):
        return [text for text in told(lambda: read_trials(some)) if "abruptly" in text]

    assert asked(table) == []
    assert len(asked(cut)) == 1
    assert asked(cut.assign(rt=np.ceil(5 * cut["rt"]) / 5)) == []
    assert asked(cut[cut.groupby("participant_id").cumcount() < 79]) == []
