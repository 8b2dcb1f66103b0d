"""A user's choices and times: read unchanged, or rejected with an explanation."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bgmodel.stopping.people import read_people
from bgmodel.support.checks import Problems
from bgmodel.trials.reader import Columns, read_trials
from bgmodel.trials.record import statistics
from circuits.errors import DataWarning, InputError
from tests.helpers import refused, refusing, told, unwarned
from tests.read import ROWS, at, changed, read, renamed, silent, table_of, without, written

TRIALS = 60


def people(seed=5, trials=TRIALS):
    """Return a table of two participants whose ids are text that looks like numbers."""
    rng = np.random.default_rng(seed)
    coherence = rng.choice([-0.5, -0.1, 0.1, 0.5], trials)
    return pd.DataFrame(
        {
            "participant_id": np.repeat(["007", "8"], trials // 2),
            "trial": np.arange(trials),
            "rt": rng.gamma(4, 0.15, trials) + 0.2,
            "response": (rng.random(trials) < 0.5 + 0.9 * coherence).astype(int),
            "coherence": coherence,
            "cue": np.where(np.arange(trials) % 2, "speed", "accuracy"),
        }
    )


READ = {"strength": "coherence", "conditions": ("cue",)}
MISSING = ("NA", "n/a", "nan")


def test_a_table_comes_back_row_by_row():
    table = people()
    trials = read_trials(table, **READ)
    assert trials.participant.tolist() == table["participant_id"].tolist()
    assert trials.rt_s.tolist() == table["rt"].tolist()
    assert trials.response.dtype == np.int8
    assert trials.response.tolist() == table["response"].tolist()
    assert trials.strength.tolist() == table["coherence"].tolist()
    assert trials.conditions["cue"].tolist() == table["cue"].tolist()
    assert (trials.trials, trials.people(), trials.deadline_s) == (60, ["007", "8"], None)
    ones = int(table["response"].sum())
    low, high = table["rt"].min(), table["rt"].max()
    assert trials.summary() == (
        f"a table: 60 trials of 2 participants, response 1 in {ones}, 0 in {60 - ones}, none in 0, "
        f"times {low:.3g} to {high:.3g} s"
    )


def test_one_participant_is_read_with_the_trials_of_no_other():
    trials = read_trials(people(), **READ, participant="8")
    assert trials.people() == ["8"]
    assert trials.rt_s.tolist() == people()["rt"][30:].tolist()
    others = read_trials(people().replace("007", "9"), **READ, participant=["9", 8])
    assert others.people() == ["8", "9"]
    alone = read_trials(people().drop(columns="participant_id"))
    assert alone.people() == ["all"]
    assert alone.trials == 60
    assert alone.strength is None
    assert alone.conditions.shape == (60, 0)


def test_some_of_the_trials_keep_what_belongs_to_them():
    trials, mask = read_trials(people(), **READ), np.arange(TRIALS) % 3 == 1
    some = trials.where(mask)
    assert some.trials == 20
    assert some.rt_s.tolist() == trials.rt_s[mask].tolist()
    assert some.strength.tolist() == trials.strength[mask].tolist()
    assert some.conditions["cue"].tolist() == people()["cue"][mask].tolist()
    assert some.checksum != trials.checksum
    assert trials.where(np.ones(TRIALS, bool)).checksum == trials.checksum
    assert read_trials(people()).where(mask).conditions.shape == (20, 0)


@pytest.mark.parametrize("missing", [None, "n/a"])  # as in BIDS
def test_trials_without_a_response_are_values(missing):
    table = silent(people(), [3, 40]).astype(object).fillna({"rt": missing, "response": missing})
    trials = read_trials(table, columns=Columns(deadline_s=9.0))
    assert np.flatnonzero(np.isnan(trials.rt_s)).tolist() == [3, 40]
    assert np.flatnonzero(trials.response == -1).tolist() == [3, 40]
    assert np.isnan(trials.correct[[3, 40]]).all()
    assert "none by 9 s in 2" in trials.summary()


def test_times_are_taken_for_seconds_up_to_a_median_of_50():
    table = people().assign(rt=50.0 + np.arange(TRIALS) - (TRIALS - 1) / 2)
    assert read_trials(table).rt_s.tolist() == table["rt"].tolist()
    with refused("rt"):
        read_trials(table.assign(rt=table["rt"] + 0.5))


@pytest.mark.parametrize(
    ("names", "upper"), [(["left", "right"], "right"), ([-1, 1], "1"), ([2.0, 1.0], "1")]
)
def test_two_names_of_responses_are_as_good_as_0_and_1(names, upper):
    table = people()
    named = table.assign(response=np.array(names)[table["response"]])
    again = read_trials(named, **READ, columns=Columns(upper=upper))
    assert again.checksum == read_trials(table, **READ).checksum


def test_right_is_the_side_of_the_strength():
    table = people()
    table.loc[:3, "coherence"] = [0.5, -0.5, 0.0, -0.0]
    table.loc[:3, "response"] = [1, 1, 1, 0]
    correct = read_trials(table, strength="coherence").correct
    assert np.array_equal(correct[:4], [1, 0, np.nan, np.nan], equal_nan=True)
    assert np.array_equal(read_trials(table).correct, table["response"])


@pytest.mark.parametrize(
    "change",
    [
        {"rt": lambda t: t["rt"] + 1e-9},
        {"response": lambda t: 1 - t["response"]},
        {"coherence": lambda t: -t["coherence"]},
        {"cue": lambda t: t["cue"].str.upper()},
        {"participant_id": lambda t: t["participant_id"].str.strip("0")},
    ],
)
def test_the_checksum_tells_other_data_by_any_column(change):
    tables = people(), people(), people().assign(**change)
    first, again, other = (read_trials(table, **READ).checksum for table in tables)
    assert first == again != other


BAD = {
    "rt must be a finite number, got 'inf' in row 2$": at("rt", 2, np.inf),
    "rt must be a finite number, got '1_0' in row 2$": at("rt", 2, "1_0"),
    "rt must hold numbers, got bool": changed(rt=True),
    "rt must be given where there is a response, got nothing in row 4$": at("rt", 4, None),
    "response must be given where rt is, got nothing in row 4$": at("response", 4, None),
    r"rt must be given unless .* nothing in row 3 \(2 such rows\)": lambda t: silent(t, [3, 40]),
    "rt must be given unless trials have a deadline, got '-999.0' in row 3": at("rt", 3, -999.0),
    r"response got 'left' in row 0 \(60 such rows\): name .* \(upper,": changed(response="left"),
    "response must be 1 or 0, got '2' in row 5: name": at("response", 5, 2),
    "response must be 1 or 0, got '-1' in row 5: name": at("response", 5, -1),
    "response got 1 only in the 30 trials of participant '007'": changed(
        response=lambda good: good["response"].where(good.index >= 30, 1)
    ),
    "participant .* got 4 of participant '007', cue 'none'": changed(
        cue=lambda good: good["cue"].where(good.index >= 4, "none")
    ),
    "participant .* got 9 of participant '007'": changed(
        cue="speed", participant_id=lambda good: np.where(good.index < 9, "007", "8")
    ),
    "coherence there is no column coherence; there are": without("coherence"),
    "cue there is no column cue; there are": renamed(cue="Cue"),
    "coherence must be a finite number, got 'strong' in row 1$": at("coherence", 1, "strong"),
    "coherence must be given for every trial, got nothing in row 1$": at("coherence", 1, np.nan),
    "coherence must differ between trials, got 0 in all 60: leave": changed(coherence=0),
    "coherence must differ between trials, got 0.1 in all 60: leave": changed(coherence=0.1),
    "cue must be given for every trial, got nothing in row 9": at("cue", 9, None),
    **{f"cue given for every trial, got .{code}. in": at("cue", 0, code) for code in MISSING},
}


@pytest.mark.parametrize("says", BAD)
def test_bad_tables_get_one_sentence(says):
    read_trials(people(), **READ)
    with refused(says) as raised:
        read_trials(BAD[says](people()), **READ)
    assert str(raised.value).startswith("a table: ")


test_options_that_do_not_fit_the_table_are_refused = refusing(
    ({"participant": "9"}, "participant"),
    ({"participant": 8.5}, "participant"),
    ({"participant": ["8", "9"]}, "participant"),
    ({"participant": []}, "participant"),
    ({"deadline_s": 0.5}, "rt"),
    ({"deadline_s": 0.0}, "deadline_s"),
    ({"deadline_s": np.nan}, "deadline_s"),
    ({"upper": "right"}, "upper"),
    ({"conditions": ("rt",)}, "conditions"),
    ({"conditions": ("cue", "cue")}, "conditions"),
    ({"conditions": ("coherence",), "strength": "coherence"}, "conditions"),
    ({"conditions": "block"}, "block"),
    of=lambda options: read(people(), **options),
)


def named(third="right"):
    """Return trials whose responses have names, of which one row may have a third."""
    response = np.where(people()["response"], "left", "right").astype(object)
    return people().assign(response=np.where(people().index == 50, third, response))


def contradicting(**changed):
    trials = read_trials(people())
    return lambda: replace(
        trials, **{k: change(getattr(trials, k)) for k, change in changed.items()}
    )


test_names_of_responses_and_parts_of_trials_that_do_not_fit_are_refused = refusing(
    (lambda: read(named("Left"), upper="left"), "response must be one of two names, .* in row 50"),
    (lambda: read(named(), upper="L"), "upper"),
    (contradicting(rt_s=lambda rt: rt[1:]), "response one value per trial"),
    (contradicting(rt_s=lambda rt: np.append(np.nan, rt[1:])), "rt_s"),
    (contradicting(response=lambda response: response * 2), "response hold 1, 0 or -1"),
)


names = st.text("aäb 0.,;\"'", min_size=1, max_size=4).filter(
    lambda text: text == " ".join(text.split())
)


@st.composite
def tables(draw):
    """Return a valid table: two participants, two cells each, some trials without a response."""
    who, cues = (draw(st.lists(names, min_size=2, max_size=2, unique=True)) for _ in range(2))
    trials, rng = 48, np.random.default_rng(draw(st.integers(0, 2**31)))
    missing = (rng.random(trials) < draw(st.floats(0, 1))) & (np.arange(trials) % 24 >= 6)
    response = pd.Series(np.arange(trials) // 2 % 2, dtype="Int8").where(~missing)
    return pd.DataFrame(
        {
            "participant_id": np.repeat(who, 24),
            "rt": np.where(missing, np.nan, rng.uniform(0.5, 4.0, trials)),
            "response": response,
            # Multiples of an eighth: no two of them differ by rounding only.
            "coherence": np.append(1.0, rng.integers(-1000, 1001, trials - 1) / 8),
            "cue": np.array(cues)[np.arange(trials) % 2],
        }
    )


ALL = {**READ, "columns": Columns(deadline_s=4.5)}


@settings(max_examples=30)
@given(table=tables(), ending=st.sampled_from([".csv", ".tsv", ".parquet"]))
def test_a_file_gives_the_same_choices_as_the_table_that_it_was_made_of(
    tmp_path_factory, table, ending
):
    path = written(table, tmp_path_factory.mktemp("choices") / f"mine{ending}")
    trials, known = read_trials(path, **ALL), read_trials(table, **ALL)
    assert trials.source == f"mine{ending}"
    assert trials.checksum == known.checksum
    assert trials.strength.tolist() == table["coherence"].tolist()
    assert trials.participant.tolist() == table["participant_id"].tolist()


@settings(max_examples=12)
@given(table=tables(), seed=st.integers(0, 2**31))
def test_the_order_of_rows_changes_no_statistic(table, seed):
    one, other = (read_trials(t, **ALL) for t in (table.sample(frac=1, random_state=seed), table))
    pd.testing.assert_frame_equal(statistics(one), statistics(other), rtol=1e-12)
    assert one.summary() == other.summary()


def test_problems_of_several_columns_are_in_one_message():
    table = pd.DataFrame(
        {"rt": ["fast", *["0.5"] * 29], "response": ["left", *["1", "0"] * 14, "1"],
         "strength": ["", *["1"] * 29], "kind": ["a"] * 29 + [""]}
    )  # fmt: skip
    with refused("rt") as caught:
        read_trials(table, strength="strength", conditions=["kind"])
    for column in ("rt", "response", "strength", "kind"):
        assert f"{column} must" in str(caught.value)
    assert len(str(caught.value)) < 450
    with refused("rt .*response"):
        read_trials(table[["strength"]])


@pytest.mark.parametrize("count", [1, 2, 9])
def test_many_problems_are_counted_and_one_stays_as_it_was(count):
    problems = Problems()
    for number in range(count):
        with problems.caught():
            raise InputError(f"problem {number} " + "x" * 100, f"field {number}")
    with pytest.raises(InputError) as caught:
        problems.refuse()
    message = str(caught.value)
    assert caught.value.field == "field 0"
    assert len(message) < 450
    assert ("more" in message) == (count == 9)
    assert message.startswith("problem 0" if count == 1 else f"{count} problems: problem 0")


def stops(**changes):
    """Return stop-signal trials with sides and responses, some of them successful stops."""
    sides = np.resize(["l", "r"], ROWS)
    return silent(
        table_of("stop signals", stimulus=sides, response=sides), range(2, ROWS, 6), **changes
    )


STOPS = {
    "response": changed(rt=lambda t: t["rt"].fillna(0.7)),
    "rt ": at("rt", 5, np.nan),
    "rt seconds": changed(rt=lambda t: 1000 * t["rt"]),
    "ssd ": at("ssd", 2, 99.0),
    "ssd seconds": at("ssd", 2, 250.0),
    "ssd 0 s or more, got .-0.1. in row 2": at("ssd", 2, -0.1),
    "ssd must be empty in some trials of a": changed(ssd=0.2),
    "correct must be 0 or 1 in every trial, got 'true'": changed(correct="true"),
}


@pytest.mark.parametrize("reader", [read_trials, read_people])
@pytest.mark.parametrize("says", STOPS)
def test_a_stop_trial_that_cannot_be_is_refused(reader, says):
    reader(stops())
    with refused(says):
        reader(STOPS[says](stops()))


test_a_setting_without_effect_on_a_kind_of_trials_is_refused = refusing(
    (lambda: read(stops(), upper="l"), "upper"),
    (lambda: read(stops(), alternatives=4), "alternatives"),
    (lambda: read(stops(), stimulus="stimulus"), "stimulus"),
    (lambda: read(table_of("pairs"), upper="0"), "upper"),
    (lambda: read(table_of("pairs"), deadline_s=9.0), "deadline_s"),
    (lambda: read(table_of("pairs"), restore_delays=True), "restore_delays"),
    (lambda: read(people(), restore_delays=True), "restore_delays"),
    (lambda: read(people(), trial_type="kind"), "trial_type"),
)


def test_delays_in_another_unit_and_responses_after_the_deadline_are_refused():
    in_ms = stops().assign(rt=1000 * stops()["rt"])
    with refused("ssd must be in ms, as rt is, got at most"):
        read_trials(in_ms, columns=Columns(rt_unit="ms"))
    assert read_trials(in_ms.assign(ssd=1000 * in_ms["ssd"]), columns=Columns(rt_unit="ms")).trials
    with refused("rt no later than deadline_s, "):
        read_trials(stops(), columns=Columns(deadline_s=float(stops()["rt"].median())))


def test_codes_that_are_exchanged_are_doubted():
    right, pairs = stops()["stimulus"] == stops()["response"], table_of("pairs")
    for doubtful in (
        stops(correct=(~right).astype(int)),
        pairs.assign(response=1 - pairs["response"]),
    ):
        with pytest.warns(DataWarning):
            read_trials(doubtful)
    with unwarned():
        read_trials(stops(correct=right.astype(int)))
        read_trials(pairs)


def known():
    """Return trials of two people with known readings, and their table."""
    rng = np.random.default_rng(8)
    told = rng.normal(0.3, 1, (60, 2))
    table = people().drop(columns=["coherence", "cue"])
    table["response"] = told.argmax(axis=1).astype(str)
    rows = table[["participant_id", "trial"]].assign(time=0.1)
    return table, rows.assign(ll_0=told[:, 0], ll_1=told[:, 1])


OWN_NAMES = {"participant_id": "vp", "rt": "RT_ms", "response": "key", "ssd": "SSD"}
WRONG: dict[str, list[object]] = {
    "participant_id": ["", None],
    "rt": [-5, "x"],
    "response": [7, None],
    "ssd": [-3, "x"],
}
OF_KIND: dict[str, Callable[[], pd.DataFrame]] = {
    "choices": people,
    "stop-signal trials": stops,
    "rewarded choices": lambda: table_of("pairs", participant_id="a"),
    "known evidence": lambda: known()[0],
}


@pytest.mark.parametrize(
    ("kind", "column", "value"),
    [(k, c, v) for k, made in OF_KIND.items() for c in OWN_NAMES if c in made() for v in WRONG[c]
     if not (k == "stop-signal trials" and c == "response" and v == 7)],
)  # fmt: skip
def test_messages_have_the_names_and_the_unit_of_the_users_columns(kind, column, value):
    own = OF_KIND[kind]().assign(rt=lambda table: 1000 * table["rt"])
    own = own.assign(**{name: 1000 * own[name] for name in ["ssd"] if name in own})
    own = own.rename(columns=OWN_NAMES)
    columns = Columns(
        rt_unit="ms",
        **{name.removesuffix("_id"): mine for name, mine in OWN_NAMES.items() if mine in own},
    )
    options = {"evidence": known()[1]} if kind == "known evidence" else {}
    options |= {"strength": "coherence"} if kind == "choices" else {}
    with unwarned():
        assert read_trials(own, columns=columns, **options).kind == kind
    name = OWN_NAMES[column]
    wrong = at(name, 3, value)(own)
    with pytest.raises(InputError, match=rf"\b{name}\b") as caught:
        read_trials(wrong, columns=columns, **options)
    assert not re.search(r"(?<!')\b(rt|participant_id|ssd)\b(?!=)| s\b", str(caught.value))
    assert caught.value.field in OWN_NAMES


def test_names_and_values_that_contain_ours_are_told_as_they_are():
    table = people().rename(columns={"rt": "rt (ms)", "cue": "rt (start)"})
    columns = Columns(rt="rt (ms)", rt_unit="ms")
    with refused(r"contrast .*, rt \(ms\), .*rt \(start\)"):
        read_trials(table, strength="contrast", columns=columns)
    wrong = table.astype({"rt (ms)": object})
    wrong.loc[3, "rt (ms)"] = "5 s"
    with refused(r"rt rt \(ms\) must be a finite number, got '5 s' in row 3"):
        read_trials(wrong, strength="coherence", columns=columns)


def test_warnings_have_the_names_and_the_unit_of_the_users_columns():
    table = people().rename(columns=OWN_NAMES)
    table["RT_ms"] = np.where(np.arange(60) % 10, 1000 * table["RT_ms"].round(3), 50.4)
    columns = Columns(rt="RT_ms", response="key", participant="vp", rt_unit="ms")
    (text,) = told(read_trials, table, strength="coherence", columns=columns)
    assert text.startswith("6 of 60 times are below 100 ms, the shortest 50.4 ms")
    table["RT_ms"] = 12 * table["RT_ms"].round(-1)
    texts = told(read_trials, table, strength="coherence", columns=columns)
    assert re.match(r"the median of RT_ms is \d+ ms: check that RT_ms is in ms from", texts[0])
    assert "all 60 times are multiples of 40 ms" in texts[1]
    ours = people().assign(rt=lambda table: 12 * table["rt"])
    assert told(read_trials, ours, strength="coherence")[0].startswith("the median of rt is 9.")
