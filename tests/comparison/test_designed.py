"""Designed trials: closed forms of each theory, and deciders whose theory is known."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.stats import ttest_1samp

from bgmodel.comparison.designed import (
    APART,
    AVERAGE,
    FOLLOWS,
    LEAD,
    MSPRT,
    OPEN,
    RISE_NATS_S,
    STEP_MS,
    THRESHOLDS,
    UNABLE,
    _intervals,
    check_read,
    designed,
    designed_circuit,
    designs,
    size,
    theories,
    verdicts,
)
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.baselines import MaxVsAverage, MaxVsNext
from bgmodel.integrators.sprt import Msprt
from circuits import anatomy
from circuits.engines import Populations
from circuits.laws.controls import linear_stn
from tests.helpers import refused

OF_COMPETITORS = {
    MSPRT: lambda competitors: np.log(np.exp(competitors).sum()),
    "max vs next": np.max,
    "max vs average": np.mean,
}
"""What a theory hears of the competitors: it decides when the leader is far enough above."""
OWN = {MSPRT: [0.35, 0.15], "max vs next": [-1.5, -2.5], "max vs average": [-2.0, -2.5]}
"""Thresholds on the OUT of each theory."""


def exact(name, gain=0.5):
    return BasalGanglia(anatomy.CIRCUITS[name](4), "algebra", gain)


def outcomes(table):
    return verdicts(table).set_index("theory")["outcome"].to_dict()


def changes(table):
    """How much later than with equal competitors the observed decides, a row per design."""
    rows = table[table["theory"] == MSPRT]
    equal = rows[rows["held"] == ""].set_index("threshold")["observed_ms"]
    return rows.assign(change=rows["observed_ms"] - rows["threshold"].map(equal))


@pytest.mark.parametrize("channels", [3, 4, 8])
def test_designs_keep_the_lead_over_the_next_or_the_average(channels):
    equal, *others = designs(channels)
    assert set(equal.competitors) == {0.0}
    for design in others:
        held = max if design.held == LEAD else np.mean
        assert held(design.competitors) == pytest.approx(0.0, abs=1e-12)
        assert len(set(design.competitors)) == 2
        totals = design.evidence(5, kappa=0.5).own_totals
        np.testing.assert_allclose(0.5 * totals[0, 1:, 1:], np.tile(design.competitors, (5, 1)))
        rise = RISE_NATS_S * STEP_MS / 1000
        np.testing.assert_allclose(0.5 * totals[0, :, 0], rise * np.arange(6), atol=1e-12)
    names = [(design.name, design.held) for design in designs(channels)]
    assert len(set(names)) == len(names) == (3 if channels == 3 else 5)


@pytest.mark.parametrize("name", OF_COMPETITORS)
def test_a_theory_decides_later_by_what_it_hears_of_the_competitors(name):
    """In closed form, from what the readings are alone; and 0 against itself."""
    table = designed(theories()[name], OWN[name])
    for design in designs():
        heard = OF_COMPETITORS[name]
        want_ms = heard(np.array(design.competitors)) - heard(np.zeros(3))
        rows = changes(table)
        rows = rows[(rows["design"] == design.name) & (rows["held"] == design.held)]
        np.testing.assert_allclose(rows["change"], 1000 * want_ms / RISE_NATS_S, atol=1.0)
    assert np.abs(table[table["theory"] == name]["value"]).max() < 1e-9
    assert outcomes(table) == {**dict.fromkeys(OF_COMPETITORS, APART), name: FOLLOWS}


@pytest.mark.parametrize(("name", "held"), UNABLE.items())
def test_what_a_competitor_cannot_tell_apart_and_the_sign_where_designs_are_swapped(name, held):
    """The MSPRT: quicker with hopeless competitors at the same lead, slower at one average."""
    for observed, thresholds in ((theories()[name], OWN[name]), (Msprt(), OWN[MSPRT])):
        rows = changes(designed(observed, thresholds))
        rows = rows[rows["held"] != ""]
        blind = rows[rows["held"] == held]["change"]
        other = rows[rows["held"] != held]["change"]
        if isinstance(observed, Msprt):
            assert (np.sign(blind) == (-1 if held == LEAD else 1)).all()
        else:
            assert np.abs(blind).max() < 1e-9
            assert (np.sign(other) == (1 if held == LEAD else -1)).all()
    table = designed(Msprt(), OWN[MSPRT])
    rows = table[(table["theory"] == name) & (table["held"] == held)]
    assert (np.sign(rows["value"]) == (-1 if held == LEAD else 1)).all()


@pytest.mark.parametrize("name", ["bogacz_gurney", "appendix_b"])
def test_an_exact_circuit_is_the_msprt_to_far_less_than_a_reading(name):
    table = designed_circuit(exact(name), THRESHOLDS)
    assert np.abs(table[table["theory"] == MSPRT]["value"]).max() < 1.0
    assert (table["latency_ms"] == 0).all()
    assert outcomes(table) == {MSPRT: FOLLOWS, **dict.fromkeys(UNABLE, APART)}
    msprt = table[table["theory"] == MSPRT]
    np.testing.assert_allclose(msprt["theory_threshold"], msprt["threshold"], atol=1e-3)


def test_without_the_exponential_of_stn_a_circuit_follows_max_vs_average():
    """The sum of lines is a mean, which distinguishes the MSPRT from max-vs-next."""
    table = linear_stn(anatomy.spiking_msprt(4))
    differences = designed_circuit(BasalGanglia(table, "algebra", 0.5), THRESHOLDS)
    assert outcomes(differences) == {MSPRT: APART, "max vs next": APART, "max vs average": FOLLOWS}


@pytest.mark.parametrize("name", ["macaque", "spiking_msprt"])
def test_the_circuits_follow_the_msprt_by_populations(name):
    model = BasalGanglia(anatomy.CIRCUITS[name](4), Populations(rates=False), 0.5, 7)
    table = designed_circuit(model, THRESHOLDS, trials=100)
    assert outcomes(table) == {MSPRT: FOLLOWS, **dict.fromkeys(UNABLE, APART)}
    assert (table["right"] > 0.95).all()
    equal = table["held"] == ""
    np.testing.assert_allclose(table[equal]["value"], 0, atol=1e-9)
    assert (table[~equal]["low"] < table[~equal]["high"]).all()


def test_what_a_circuit_does_not_read_is_refused():
    macaque, spiking = anatomy.macaque(4), anatomy.spiking_msprt(4)
    for table, out, says in (
        (macaque, 0.05, "thresholds macaque resolves no OUT below 0.0798"),
        (macaque, 1.5, "thresholds would decide without evidence"),
        (spiking, 0.7, "thresholds rests at OUT = 0.65"),
        (anatomy.bogacz_gurney(4), np.nan, "thresholds finite"),
    ):
        with refused(says):
            check_read(table, out)
    with refused("trials"):
        designed_circuit(BasalGanglia(macaque, "population", 0.5, 1), trials=1)
    with refused("channels"):
        designs(2)
    with refused("thresholds is not reached in .* s of designed trials"):
        designed(MaxVsAverage(), [-1e3])
    model = BasalGanglia(macaque, "population", 0.5, 1)
    assert size(model, THRESHOLDS, 2)[0] == 2
    assert size(replace(model, engine="rate"), THRESHOLDS, 200)[0] == 1


def test_a_leader_that_is_not_chosen_leaves_the_difference_unknown():
    """By max-vs-next the close competitor meets a low threshold before the leader rises."""
    table = designed(MaxVsNext(), [-0.5])
    wrong = (table["held"] == AVERAGE) & table["design"].str.startswith("1 close")
    assert table[wrong]["value"].isna().all()
    assert (table[wrong]["right"] == 0).all()
    assert outcomes(table)["max vs next"] != FOLLOWS


def test_means_over_trials_have_the_intervals_of_students_t():
    moved = np.random.default_rng(8).normal(20, 5, (3, 40))
    moved[1, 4] = np.nan
    value, low, high = _intervals(moved)
    for row, *estimates in zip(moved, value, low, high, strict=True):
        known = row[np.isfinite(row)]
        interval = ttest_1samp(known, 0).confidence_interval(0.95)
        np.testing.assert_allclose(estimates, [known.mean(), interval.low, interval.high])


def told(*differences):
    """Return the outcome of differences in ms, without noise, at one threshold each."""
    rows = {"theory": "one", "threshold": np.arange(len(differences)), "value": differences}
    return outcomes(pd.DataFrame(rows).assign(low=differences, high=differences))["one"]


def test_a_theory_is_followed_within_60_ms_and_told_apart_beyond_100():
    """Between the two, or with what is not known, it is left open."""
    assert told(59.0, -59.0) == FOLLOWS
    assert told(61.0, 0.0) == told(99.0, -99.0) == told(120.0, 99.0) == OPEN
    assert told(101.0, -101.0) == APART
    assert told(10.0, np.nan) == OPEN
