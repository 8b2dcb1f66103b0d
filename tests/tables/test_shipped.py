"""The shipped sets are what was published."""

from importlib import resources

import numpy as np
import pytest

from bgmodel.support.files import read_provenance
from bgmodel.tables.choices import read_choices, shipped
from bgmodel.tables.statistics import statistics
from tests.helpers import ROOT

SHIPPED = shipped()
MOTION = ("roitman_shadlen_2002", "palmer_huk_shadlen_2005")


@pytest.mark.parametrize(
    ("name", "trials", "people"),
    [
        ("roitman_shadlen_2002", 6149, 2),
        ("palmer_huk_shadlen_2005", 3373, 6),
        ("cavanagh_2011", 3988, 14),
    ],
)
def test_a_set_has_the_trials_and_participants_that_were_published(name, trials, people):
    one = SHIPPED[name]
    assert (one.trials, one.people) == (trials, people)
    assert list(one.columns) == list(one.table.columns)
    assert one.table.columns[:4].tolist() == ["participant_id", "trial", "rt", "response"]
    choices = read_choices(name)
    assert (choices.trials, len(choices.people()), choices.source) == (trials, people, name)
    for _, own in one.table.groupby("participant_id"):
        assert own["trial"].tolist() == list(range(len(own)))


@pytest.mark.parametrize("name", SHIPPED)
def test_a_set_says_where_it_comes_from_and_its_licence_lies_beside_it(name):
    folder = ROOT / "bgmodel" / "data"
    about = read_provenance(folder / f"{name}.parquet")["parameters"]
    assert about["note"] == "No repository states a licence for the data apart from its code."
    assert about["source"].startswith("https://github.com/")
    assert about["licence"] in ("BSD-3-Clause", "BSD-2-Clause")
    assert "Redistribution" in (resources.files("bgmodel.data") / about["licence_file"]).read_text()
    assert len(about["made_from"]["sha256"]) == 64


@pytest.mark.parametrize("name", MOTION)
def test_accuracy_rises_with_the_strength_of_motion_and_times_fall(name):
    table = SHIPPED[name].table
    assert not np.signbit(table["coherence"][table["coherence"] == 0]).any()
    share = table.groupby("coherence")["response"].mean()
    assert (share.diff().dropna() >= 0).all()
    assert share.iloc[0] == 0
    assert share.iloc[-1] == 1
    known = table[table["correct"].notna()]
    assert ((known["response"] == 1) == (known["coherence"] > 0)).eq(known["correct"] == 1).all()
    assert (table["correct"].isna() == (table["coherence"] == 0)).all()
    choices = read_choices(name, strength="coherence")
    found = statistics(choices).groupby("strength")[["accuracy", "mean_s"]].mean()
    assert found.index.tolist() == [0, 0.032, 0.064, 0.128, 0.256, 0.512]
    assert (found["accuracy"].dropna().diff().dropna() > 0).all()
    assert (found["mean_s"].diff().dropna() < 0).all()
    assert np.array_equal(np.isnan(choices.correct), table["correct"].isna())


def test_without_coherence_the_monkeys_times_scatter_as_published():
    found = statistics(read_choices("roitman_shadlen_2002", strength="coherence"))
    found = found.set_index(["participant_id", "strength"])
    assert found.loc["b", 0.0]["sd_s"] == pytest.approx(0.197, abs=5e-4)
    assert found.loc["n", 0.0]["sd_s"] == pytest.approx(0.242, abs=5e-4)
    quantiles = found.loc["b", 0.0][["q10_s", "q50_s", "q90_s"]]
    assert quantiles.tolist() == pytest.approx([0.559, 0.763, 1.037], abs=5e-4)
    assert np.isnan(found.loc["b", 0.0]["accuracy"])


PUBLISHED = {
    ("off", "high"): (1.518, 0.592),
    ("on", "high"): (1.391, 0.580),
    ("off", "low"): (1.393, 0.788),
    ("on", "low"): (1.318, 0.754),
}
"""Stimulation and conflict: mean over 14 participants of mean time, s, and accuracy."""


def test_patients_are_as_fast_and_as_right_as_published_in_each_condition():
    choices = read_choices("cavanagh_2011", conditions=("stimulation", "conflict"))
    found = statistics(choices).groupby(["stimulation", "conflict"])[["mean_s", "accuracy"]].mean()
    for cell, (seconds, share) in PUBLISHED.items():
        assert found.loc[cell, "mean_s"] == pytest.approx(seconds, abs=6e-4)
        assert found.loc[cell, "accuracy"] == pytest.approx(share, abs=6e-4)
    assert len(statistics(choices)) == 14 * 4


def test_conflict_is_between_two_good_items_or_two_bad_ones():
    table = SHIPPED["cavanagh_2011"].table
    pairs = table.groupby("conflict")["pair"].unique()
    assert set(pairs["high"]) == {"LL", "WW"}
    assert set(pairs["low"]) == {"WL"}
    assert set(table["stimulation"]) == {"on", "off"}


def test_theta_slows_under_conflict_and_no_more_with_stimulation():
    """The reversal that was published, as a mean over participants of their correlations."""
    table = SHIPPED["cavanagh_2011"].table
    high = table[table["conflict"] == "high"]
    r = {
        state: np.mean([one["theta"].corr(one["rt"]) for _, one in part.groupby("participant_id")])
        for state, part in high.groupby("stimulation")
    }
    assert r["off"] == pytest.approx(0.056, abs=6e-4)
    assert r["on"] == pytest.approx(-0.065, abs=6e-4)
