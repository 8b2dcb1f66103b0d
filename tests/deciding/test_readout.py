"""What the terminal refuses or warns of is refused or warned of in Python, once per call."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import bgmodel as bg
from bgmodel import BasalGanglia, Evidence, Msprt, Sprt, first_crossing, threshold_from_posterior
from bgmodel.deciding.decision import Decision, check_decision, crossing_of_each
from bgmodel.deciding.readout import ReadOut
from bgmodel.integrators.baselines import MaxVsNext
from bgmodel.integrators.criterion import check_threshold, readout_of, rest_out
from bgmodel.integrators.sprt import tally_sprt
from bgmodel.simulated_evidence import separated_evidence
from circuits.activity import RateMeans
from circuits.anatomy import CIRCUITS
from circuits.errors import InputError
from tests.helpers import refused, run, some_evidence, told

STEP_MS = 50.0
EVIDENCE = separated_evidence(60, 40, 0.5, rng=4, step_ms=STEP_MS)
FOUR = separated_evidence(60, 40, 0.5, rng=4, step_ms=STEP_MS, hypotheses=4)
MODEL = BasalGanglia("macaque", "algebra", 0.5)
TRACES = {"MSPRT": Msprt(0.5).run(EVIDENCE), "circuit": MODEL.run(EVIDENCE)}
LOW, REST = readout_of(MODEL.circuit).lowest, readout_of(MODEL.circuit).rest


def refusal(call):
    """Return the sentence with which a call is refused, or nothing."""
    try:
        call()
    except ValueError as error:
        return str(error)
    return ""


DECIDERS = {
    "first_crossing": lambda trace, level: first_crossing(trace, level),
    "crossing_of_each": lambda trace, level: crossing_of_each(trace, np.full(60, level)),
}


@pytest.mark.parametrize("decide", DECIDERS.values(), ids=DECIDERS)
def test_a_threshold_that_means_nothing_is_refused_by_all_that_decide(decide):
    for trace, level in (
        (TRACES["MSPRT"], -0.1),
        (TRACES["MSPRT"], 0.85),
        (Sprt().run(EVIDENCE), 0.85),
        (TRACES["circuit"], 0.9 * LOW),
        (TRACES["circuit"], -1.0),
        (TRACES["circuit"], REST),
        (TRACES["circuit"], 0.85),
        (TRACES["circuit"], np.nan),
    ):
        with refused("thresholds threshold"):
            decide(trace, level)
    for trace in TRACES.values():
        assert not told(lambda trace=trace: decide(trace, 0.3))


@pytest.mark.filterwarnings("ignore")
@given(st.sampled_from(sorted(CIRCUITS)), st.floats(-1, 3))
def test_a_trace_refuses_the_thresholds_that_the_terminal_refuses(name, level):
    model = BasalGanglia(name, "algebra", 0.5)
    trace = model.run(EVIDENCE[:2])
    sentence = refusal(lambda: check_threshold(model.circuit, level))
    assert refusal(lambda: first_crossing(trace, level)) == sentence
    assert refusal(lambda: model.decide(EVIDENCE[:2], level)) == sentence
    assert bool(sentence) == (
        level < model.circuit.readable_nats[0] or level >= rest_out(model.circuit)
    )


def test_a_posterior_in_place_of_a_threshold_is_asked_after():
    """Above OUT at rest it is refused; where it stops below a half it is warned of."""
    for trace in (*TRACES.values(), Sprt().run(EVIDENCE)):
        with refused(r"thresholds did you mean a posterior \(posterior=0.85\)"):
            first_crossing(trace, 0.85)
    with pytest.raises(ValueError, match=r"did you mean a posterior"):
        Msprt().session(threshold=0.85)
    with pytest.raises(ValueError, match=r"did you mean a posterior"):
        tally_sprt(EVIDENCE, [0.85])
    (warning,) = told(lambda: first_crossing(Msprt().run(FOUR), 0.85))
    assert "a posterior of 0.427; did you mean" in warning
    for level in (-np.log(0.85), threshold_from_posterior(0.85, 4), 1.1):
        assert not told(lambda level=level: first_crossing(Msprt().run(FOUR), level))


@pytest.mark.parametrize("posterior", [0.6, 0.85, 0.94])
def test_a_posterior_is_the_threshold_that_it_stands_for(posterior):
    level = threshold_from_posterior(posterior, 2)
    for trace in TRACES.values():
        one, other = first_crossing(trace, posterior=posterior), first_crossing(trace, level)
        assert np.array_equal(one.time_ms, other.time_ms)
    of_sprt = first_crossing(Sprt().run(EVIDENCE), posterior=posterior)
    of_msprt = first_crossing(Msprt().run(EVIDENCE), posterior=posterior)
    assert np.array_equal(of_sprt.time_ms, of_msprt.time_ms)
    assert np.array_equal(of_sprt.choice, of_msprt.choice)


def test_a_posterior_needs_an_out_that_stands_for_one():
    trace = TRACES["MSPRT"]
    salience = BasalGanglia("gpr", "algebra", 1.0).run(EVIDENCE)
    for call in (
        lambda: first_crossing(trace),
        lambda: first_crossing(trace, 0.2, posterior=0.9),
        lambda: first_crossing(MaxVsNext().run(EVIDENCE), posterior=0.9),
        lambda: first_crossing(salience, posterior=0.9),
        lambda: first_crossing(trace, posterior=0.5),
        lambda: first_crossing(trace, posterior=1.0),
        lambda: first_crossing(TRACES["circuit"], posterior=0.99),
        lambda: MODEL.decide(EVIDENCE),
        lambda: MODEL.decide(EVIDENCE, 0.2, posterior=0.9),
        lambda: MODEL.decide(EVIDENCE, posterior=[0.8, 0.9]),
    ):
        with pytest.raises(ValueError, match=r"posterior|one number"):
            call()


@pytest.mark.parametrize("forced", [True, False])
def test_a_majority_that_met_no_threshold_is_warned_of_with_its_number(forced):
    few = EVIDENCE[:20]
    short = Evidence(few.log_likelihood[:, :2], few.truth, step_ms=STEP_MS, baseline=0.0)
    level = -np.log(0.9)
    for call in (
        lambda: first_crossing(Msprt(0.5).run(short), level, forced=forced),
        lambda: first_crossing(MODEL.run(short), level, forced=forced),
        lambda: MODEL.decide(short, level, forced=forced),
        lambda: crossing_of_each(Msprt(0.5).run(short), np.full(20, level), forced=forced),
    ):
        (warning,) = told(call)
        assert warning.startswith("20 of 20 trials never meet the threshold")
        assert ("the deadline decides them" in warning) == forced
        assert ("they stay undecided" in warning) != forced


def test_a_lesion_that_decides_nothing_is_warned_of_and_one_that_needs_no_evidence_refused():
    table = MODEL.circuit
    silent = replace(MODEL, circuit=table.lesion("GPe", 0.25))
    (warning,) = told(lambda: first_crossing(silent.run(EVIDENCE), posterior=0.9))
    assert warning.startswith("60 of 60 trials never meet the threshold")
    eager = replace(MODEL, circuit=table.scale("ctx->STN", 0.5))
    with refused("thresholds would decide without evidence"):
        first_crossing(eager.run(EVIDENCE), posterior=0.9)


def test_the_highest_posterior_that_is_named_may_be_given():
    read_out = readout_of(MODEL.circuit)
    with pytest.raises(ValueError, match="posteriors must be at most") as caught:
        read_out.one(None, 0.999, 2)
    named = float(str(caught.value).split("at most ")[1].split(";")[0])
    assert read_out.one(None, named, 2) > 0
    with refused("thresholds"):
        read_out.one(None, named + 0.001, 2)


def counted(trials, late, early, of_test=True):
    """Check decisions at 0.3 nats, some of which come late or early."""
    forced, premature = (np.arange(trials) < count for count in (late, early))
    times = np.zeros(trials)
    decision = Decision(np.zeros(trials, int), times, forced, premature, STEP_MS, times)
    check_decision(decision, 0.3, forced=True, of_test=of_test)


@pytest.mark.parametrize(("late", "early"), [(2, 0), (3, 0), (0, 2), (0, 3)])
def test_more_than_half_of_the_trials_are_a_majority(late, early):
    warned = told(counted, 4, late, early)
    assert [one[:13] for one in warned] == ["3 of 4 trials"] * (max(late, early) > 2)


def test_all_trials_before_their_first_reading_are_refused_of_a_test_alone():
    """A circuit has noise, so that a single early trial is a result and no error."""
    with refused("thresholds every trial decides before its first reading"):
        counted(1, 0, 1)
    (warning,) = told(counted, 1, 0, 1, of_test=False)
    assert warning.startswith("1 of 1 trials decide before their first reading")
    biased = some_evidence(hypotheses=2, prior=[0.2, 0.8])
    for decide in (
        lambda: first_crossing(Msprt().run(biased), posterior=0.7),
        lambda: Msprt().session(posterior=0.7, prior=[0.2, 0.8]),
    ):
        with pytest.raises(ValueError, match=r"before its first reading"):
            decide()


def test_noise_that_crosses_the_threshold_at_rest_is_warned_of():
    model = BasalGanglia("macaque", "population", 0.55, 1)
    few = EVIDENCE[:4]
    for call in (lambda: first_crossing(model.run(few), 0.65), lambda: model.decide(few, 0.65)):
        assert any(one.startswith("without evidence, noise takes OUT below") for one in told(call))
    assert not told(lambda: model.decide(few, 0.35))


@given(st.lists(st.floats(-0.5, 1.5), min_size=2, max_size=12))
def test_of_many_thresholds_each_kind_is_warned_of_once_and_all_are_refused(levels):
    known = ReadOut("it", lowest=0.1, rest=0.7)
    wrong = [level >= 0.7 for level in levels], [level < 0.1 for level in levels]
    if all(any(pair) for pair in zip(*wrong, strict=True)):
        with refused("thresholds (rests at|resolves no) OUT"):
            known.check(levels)
        return
    warned = told(lambda: known.check(levels))
    counts = [f"{sum(kind)} of {len(levels)} thresholds" for kind in wrong if any(kind)]
    assert [one.partition(" are unusable")[0] for one in warned] == counts


def test_a_response_that_is_left_out_by_its_own_threshold_is_no_error():
    trace = TRACES["circuit"]
    assert not told(lambda: first_crossing(trace, [[0.3, -1e9]]))
    with refused("thresholds rests at OUT"):
        first_crossing(trace, [[0.3, 0.85]])


BROKEN = {
    "ends beyond the ticks": {"ends": np.full(60, 1000)},
    "ends of no tick": {"ends": np.zeros(60, int)},
    "ends of few trials": {"ends": np.full(3, 2)},
    "ends between ticks": {"ends": np.full(60, 2.5)},
    "numbers of few trials": {"numbers": np.arange(3)},
    "times of few ticks": {"time_ms": np.arange(3.0)},
    "times that fall": {"time_ms": -np.arange(41.0)},
    "no step": {"step_ms": 0.0},
    "a step in words": {"step_ms": "50"},
    "OUT of one trial": {"out_nats": np.ones((41, 2))},
    "OUT of no trial": {"out_nats": np.ones((0, 41, 2))},
    "OUT of no tick": {"out_nats": np.ones((60, 0, 2))},
    "OUT of no channel": {"out_nats": np.ones((60, 41, 0))},
    "OUT in words": {"out_nats": "low"},
}


@pytest.mark.parametrize("decide", DECIDERS.values(), ids=DECIDERS)
@pytest.mark.parametrize("broken", BROKEN.values(), ids=BROKEN)
def test_nothing_is_read_where_a_trace_has_nothing(decide, broken):
    """Compiled loops check no bounds: what does not fit never reaches them."""
    with pytest.raises(InputError) as caught:
        decide(replace(TRACES["MSPRT"], **broken), 0.3)
    assert caught.value.field in broken
    for odd in (EVIDENCE, TRACES["MSPRT"].out_nats, None):
        with refused("trace"):
            decide(odd, 0.3)


@pytest.mark.parametrize("kind", ["f2", ">f4", ">f8", "g"])
def test_out_of_any_precision_is_decided_on(kind):
    trace = TRACES["MSPRT"]
    given_as = replace(trace, out_nats=trace.out_nats.astype(kind))
    want = replace(trace, out_nats=trace.out_nats.astype(kind).astype(np.float64))
    for decide in DECIDERS.values():
        assert repr(decide(given_as, 0.3)) == repr(decide(want, 0.3))


def test_a_trial_that_was_dropped_is_not_decided_below_its_drop():
    model = BasalGanglia("macaque", "rate", 0.5).until(0.3)
    trace = model.run(EVIDENCE)
    assert np.isnan(trace.out_nats).any()
    above = first_crossing(trace, 0.35)
    assert np.array_equal(
        above.choice, first_crossing(replace(model, engine="rate").run(EVIDENCE), 0.35).choice
    )
    unknown = replace(trace, out_nats=np.full_like(trace.out_nats, np.nan))
    for decide, dropped in product(DECIDERS.values(), (trace, unknown)):
        with refused("thresholds trials is NaN at their end"):
            decide(dropped, 0.1)


def test_a_circuit_decides_in_python_what_it_decides_at_the_terminal(tmp_path):
    """In parts, with trials that end at their decision or with rates to their ends."""
    from bgmodel.support.files import read_table
    from bgmodel.task import Gaussian

    out = tmp_path / "out.csv"
    options = ("--task", "trials=30", "--engine", "population", "--seed", 5, "--posterior", 0.85)
    assert run("circuit", "run", "--save", out, *options) == 0
    evidence = Gaussian(trials=30).evidence(seed=bg.stream(5, "circuit run"))
    model = BasalGanglia("macaque", "population", 0.55, 5)
    means = RateMeans()
    table = read_table(out)
    for decision in (
        model.decide(evidence, posterior=0.85),
        model.decide(evidence, posterior=0.85, rates=means),
        first_crossing(model.run(evidence), posterior=0.85),
    ):
        assert (decision.choice == evidence.truth).tolist() == table["correct"].tolist()
        assert decision.time_ms.tolist() == pytest.approx((1000 * table["rt"]).tolist())
    assert {"STN", "GPe"} <= {*means.table()["population"]}
