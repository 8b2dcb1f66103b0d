"""Users' tables: their files, columns of other names or units, and those of PyDDM and HSSM."""

import numpy as np
import pytest

from bgmodel.support.files import read_provenance
from bgmodel.trials.files import CELLS_SET, SIMON_SET, shipped
from bgmodel.trials.reader import Columns, read_trials
from bgmodel.trials.record import Trials, statistics
from tests.helpers import ROOT, refusing, unwarned
from tests.read import at, changed, read, silent
from tests.trials.test_reader import READ, people

OTHER = {"rt": "latency", "response": "key", "participant_id": "who"}
NAMED = {"rt": "latency", "response": "key", "participant": "who"}


def test_columns_of_other_names_are_the_same_trials():
    table = people()
    with unwarned():
        trials = read(table.rename(columns=OTHER), **READ, **NAMED)
    assert trials.checksum == read_trials(table, **READ).checksum
    ms = table.assign(rt=1000 * table["rt"])
    assert read(ms, **READ, rt_unit="ms").rt_s == pytest.approx(trials.rt_s, rel=1e-12)


@pytest.mark.parametrize("to", [Trials.to_pyddm, Trials.to_hssm])
@pytest.mark.parametrize("missing", [[], [4, 9]])
def test_frames_of_other_tools_come_back_as_they_were(to, missing):
    options = {**READ, "columns": Columns(deadline_s=4.0)} if missing else READ
    expected = read_trials(silent(people(), missing), **options)
    frame = to(expected).rename(columns={"strength": "coherence"})
    assert read_trials(frame, **options).checksum == expected.checksum


def test_a_sample_of_pyddm_has_its_own_names():
    pyddm = pytest.importorskip("pyddm")
    table = people()
    sample = pyddm.Sample.from_pandas_dataframe(
        table[["rt", "response", "coherence"]], "rt", "response"
    )
    frame = sample.to_pandas_dataframe(drop_undecided=True)
    assert {"RT", "choice"} <= set(frame)
    trials = read_trials(frame, strength="coherence")
    order = np.lexsort((trials.response, trials.rt_s))
    mine = np.lexsort((table["response"], table["rt"]))
    assert trials.rt_s[order] == pytest.approx(table["rt"].to_numpy()[mine])
    assert trials.response[order].tolist() == table["response"].to_numpy()[mine].tolist()


def other(change=lambda table: table, **options):
    """Return what reads a changed table of columns that have other names."""
    return lambda: read(change(people().rename(columns=OTHER)), **{**READ, **NAMED, **options})


def plain(change=lambda table: table, **options):
    """Return what reads a changed table with the names of this package."""
    return lambda: read(change(people()), **READ, **options)


IN_MS = changed(rt=lambda table: 1000 * table["rt"])
CODED = changed(response=lambda table: np.where(table["response"] == 1, 1, -1))

test_names_units_and_codes_that_do_not_fit_are_refused = refusing(
    (other(rt="lag"), "rt must be one of the columns who, trial, latency, key"),
    (other(rt="latency", response="latency"), "columns must be named once each"),
    (other(strength="key"), "columns must be named once each"),
    (other(conditions="who"), "columns must be named once each"),
    (other(response=3), "response must be the name of a column"),
    (other(participant="name"), "participant must be one of the columns"),
    (plain(changed(latency=1.0), rt="latency"), "rt is 'latency', but there is also a column rt"),
    (plain(rt_unit="ms"), "rt must be in ms, got a median of"),
    (plain(rt_unit="min"), "rt_unit must be one of s, ms, got 'min'"),
    (
        plain(lambda t: at("rt", 3, -5.0)(IN_MS(t)), rt_unit="ms"),
        "rt must be above 0 ms, got '-5.0' in row 3",
    ),
    # Of HSSM only where all responses have a time.
    (lambda: read(at("rt", 3, np.nan)(CODED(people())), **READ), "response must be 1 or 0"),
    (lambda: read_trials("roitman"), "source"),
)


SHIPPED = shipped()
MOTION = ("roitman_shadlen_2002", "palmer_huk_shadlen_2005")


@pytest.mark.parametrize(
    ("name", "trials", "people"),
    [
        ("roitman_shadlen_2002", 6149, 2),
        ("palmer_huk_shadlen_2005", 3373, 6),
        ("cavanagh_2011", 3988, 14),
        ("pedersen_frank_2020", 5280, 28),
    ],
)
def test_a_set_has_the_trials_and_participants_that_were_published(name, trials, people):
    one = SHIPPED[name]
    assert (one.trials, one.people) == (trials, people)
    assert list(one.columns) == list(one.table.columns)
    assert one.table.columns[:4].tolist() == ["participant_id", "trial", "rt", "response"]
    choices = read_trials(name)
    assert (choices.trials, len(choices.people()), choices.source) == (trials, people, name)
    for _, rows in one.table.groupby("participant_id"):
        assert rows["trial"].tolist() == list(range(len(rows)))


@pytest.mark.parametrize("name", SHIPPED)
def test_a_set_says_where_it_comes_from_and_its_licence_lies_beside_it(name):
    folder = ROOT / "bgmodel" / "data"
    about = read_provenance(folder / f"{name}.parquet")["parameters"]
    assert about["note"] == "No repository states a licence for the data apart from its code."
    assert about["source"].startswith("https://github.com/")
    assert about["licence"] in ("BSD-3-Clause", "BSD-2-Clause")
    assert "Redistribution" in (folder / about["licence_file"]).read_text()
    assert len(about["made_from"]["sha256"]) == 64


def test_striatal_cells_are_read_with_their_clicks_and_choices():
    about = shipped([CELLS_SET])[CELLS_SET]
    assert about.licence == "Apache-2.0"
    assert "Apache License" in (ROOT / "bgmodel" / "data" / about.licence_file).read_text()
    read = read_trials(CELLS_SET)
    assert (read.kind, read.trials, len(read.spikes.names)) == ("spikes and choices", 8601, 48)
    favoured = np.sign(read.readings.log_likelihood.sum(axis=1) @ [-1, 1])
    assert ((favoured > 0) == (read.response == 1))[favoured != 0].mean() > 0.74
    assert read.spikes.time_s.min() >= -0.5
    assert read.spikes.time_s.max() <= np.float32(1.1)


@pytest.mark.parametrize("name", MOTION)
def test_accuracy_rises_with_the_strength_of_motion_and_times_fall(name):
    table = SHIPPED[name].table
    assert not np.signbit(table["coherence"][table["coherence"] == 0]).any()
    share = table.groupby("coherence")["response"].mean()
    assert (share.diff().dropna() >= 0).all()
    assert [*share.iloc[[0, -1]]] == [0, 1]
    known = table[table["correct"].notna()]
    assert ((known["response"] == 1) == (known["coherence"] > 0)).eq(known["correct"] == 1).all()
    assert (table["correct"].isna() == (table["coherence"] == 0)).all()
    choices = read_trials(name, strength="coherence")
    means = statistics(choices).groupby("strength")[["accuracy", "mean_s"]].mean()
    assert means.index.tolist() == [0, 0.032, 0.064, 0.128, 0.256, 0.512]
    assert (means["accuracy"].dropna().diff().dropna() > 0).all()
    assert (means["mean_s"].diff().dropna() < 0).all()
    assert np.array_equal(np.isnan(choices.correct), table["correct"].isna())


PUBLISHED = {
    ("off", "high"): (1.518, 0.592),
    ("on", "high"): (1.391, 0.580),
    ("off", "low"): (1.393, 0.788),
    ("on", "low"): (1.318, 0.754),
}
"""Stimulation and conflict: mean over 14 participants of mean time, s, and accuracy."""


def test_patients_are_as_fast_and_as_right_as_published_in_each_condition():
    choices = read_trials("cavanagh_2011", conditions=("stimulation", "conflict"))
    means = statistics(choices).groupby(["stimulation", "conflict"])[["mean_s", "accuracy"]].mean()
    for cell, (seconds, share) in PUBLISHED.items():
        assert means.loc[cell, "mean_s"] == pytest.approx(seconds, abs=6e-4)
        assert means.loc[cell, "accuracy"] == pytest.approx(share, abs=6e-4)
    assert len(statistics(choices)) == 14 * 4


SIMON = shipped([SIMON_SET])[SIMON_SET].table
TRAINED = SIMON[SIMON["phase"] == "training"]
MEANS = {
    "none": ((553, 13), (586, 11), (33, 4), (0.956, 0.923)),
    "off": ((587, 26), (623, 25), (37, 4), (0.938, 0.903)),
    "on": ((567, 21), (600, 21), (33, 4), (0.947, 0.912)),
}
"""By medication: mean time of correct responses from 0.2 s on, ms, and its standard error over
people, congruent, incongruent and their difference; share of correct responses, congruent and
incongruent, of all trials pooled. Computed independently from the published files."""


def test_the_simon_task_has_the_published_numbers_of_people_sessions_and_trials():
    assert len(SIMON) == 47_371
    people = SIMON.groupby("group")["participant_id"].nunique()
    assert people.to_dict() == {"ctl": 28, "pd": 28}
    sessions = SIMON.groupby("participant_id")[["session", "medication"]].nunique()
    groups = SIMON.groupby("participant_id")["group"].first()
    assert (sessions[groups == "pd"] == 2).all(axis=None)
    assert (sessions[groups == "ctl"] == 1).all(axis=None)
    first = SIMON[(SIMON["session"] == 1) & (SIMON["group"] == "pd")]
    people = first.groupby("medication")["participant_id"].nunique()
    assert people.to_dict() == {"off": 14, "on": 14}


def test_people_and_patients_have_the_known_times_and_shares_in_the_simon_task():
    keys = ["medication", "participant_id", "congruency"]
    right = TRAINED[(TRAINED["response"] == 1) & (TRAINED["rt"] >= 0.2)]
    ms = 1000 * right.groupby(keys)["rt"].mean().unstack()
    ms["cost"] = ms["incongruent"] - ms["congruent"]
    answered = TRAINED.dropna(subset=["rt"]).astype({"response": float})
    share = answered.groupby(["medication", "congruency"])["response"].mean().unstack()
    for medication, (*times, shares) in MEANS.items():
        some = ms.loc[medication]
        for name, (mean, error) in zip(("congruent", "incongruent", "cost"), times, strict=True):
            assert some[name].mean() == pytest.approx(mean, abs=0.5)
            assert some[name].sem() == pytest.approx(error, abs=0.5)
        assert share.loc[medication].tolist() == pytest.approx(shares, abs=6e-4)


def test_learned_pairs_are_as_accurate_and_fast_as_published_and_rewarded_as_designed():
    table = SHIPPED["pedersen_frank_2020"].table
    of_people = table.groupby(["participant_id", "pair"])
    accuracy = of_people["response"].mean().groupby("pair").mean()
    assert accuracy.tolist() == pytest.approx([0.752, 0.672, 0.578], abs=6e-4)
    medians = of_people["rt"].median().groupby("pair").mean()
    assert medians.tolist() == pytest.approx([0.987, 0.999, 1.061], abs=6e-4)
    better = table[table["response"] == 1].groupby("pair")["reward"].agg(["mean", "size"])
    away = (better["mean"] - [0.8, 0.7, 0.6]) / np.sqrt(0.25 / better["size"])
    assert (away.abs() < 3).all()
