"""What a user gives is a value of the kind that is asked for, or one sentence, never a crash."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bgmodel import BasalGanglia, Evidence, Msprt, Sprt, compare, first_crossing, stream
from bgmodel.deciding.reward import reward
from bgmodel.deciding.tradeoff import tradeoff
from bgmodel.integrators.at_thresholds import decide_at_thresholds
from bgmodel.integrators.baselines import BASELINES, Lca, LinearGpe
from bgmodel.integrators.sprt import tally_sprt
from bgmodel.learning.dopamine import stopping_posterior, working_range
from bgmodel.simulated_evidence import expecting, separated_evidence
from bgmodel.support.checks import is_number, is_whole, one_per_trial, reals, whole
from bgmodel.support.files import read_table
from bgmodel.trials.evidence_table import read_evidence_table
from bgmodel.trials.named_evidence import NamedEvidence, trial_table
from circuits import engines
from circuits.anatomy import CIRCUITS, load_circuit
from circuits.errors import InputError
from tests.helpers import refused, some_evidence

READINGS = some_evidence(trials=4, steps=3, hypotheses=2).log_likelihood
EVIDENCE = Evidence(READINGS, np.array([0, 1, 0, 1]), step_ms=50.0, baseline=0.0)
TABLE = load_circuit("macaque")


@given(st.one_of(st.integers(), st.floats(), st.booleans(), st.text(), st.none()))
def test_a_number_is_one_and_a_whole_number_is_a_number(value):
    assert is_number(value) == (type(value) in (int, float))
    assert is_whole(value) == (is_number(value) and value == value // 1)


@given(st.integers(-5, 5), st.integers(0, 3), st.sampled_from([int, float, np.int32, np.float32]))
def test_a_whole_number_of_any_type_is_the_same_int(value, least, kind):
    if value >= least:
        number = whole("n", kind(value), least)
        assert type(number) is int
        assert number == value
    else:
        with refused("n"):
            whole("n", kind(value), least)


@pytest.mark.parametrize("kind", ["f2", ">f4", ">f8", "g", "i1", "u8", "?", "O"])
def test_numbers_of_any_type_become_those_that_compiled_loops_take(kind):
    values = np.array([0, 1, 1]).astype(kind)
    numbers = reals("x", values)
    assert numbers.dtype == np.float64
    assert numbers.tolist() == [0, 1, 1]
    assert reals("x", numbers) is numbers


@pytest.mark.parametrize("values", ["a", [1, [2]], 1j, ["1"], [None, "x"], np.array("2020", "M8")])
def test_what_holds_no_numbers_is_refused_by_name(values):
    with refused("x"):
        reals("x", values)


@pytest.mark.parametrize("kind", [">i8", "u8", "i1"])
def test_whole_numbers_per_trial_come_in_the_machines_order(kind):
    numbers = one_per_trial("x", np.arange(3).astype(kind), 3)
    assert numbers.dtype.isnative
    assert numbers.tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    "integrator",
    [Sprt(), Msprt(), BasalGanglia(TABLE, "algebra"), *(kind() for kind in BASELINES.values())],
    ids=lambda one: type(one).__name__,
)
def test_an_integrator_is_given_evidence_and_no_bare_array(integrator):
    for odd in (READINGS, READINGS.tolist(), "mine.csv", None):
        with refused("evidence must be an Evidence"):
            integrator.run(odd)
    assert integrator.run(EVIDENCE).out_nats.shape == (4, 4, 2)


@pytest.mark.parametrize("name", CIRCUITS)
def test_a_whole_number_of_channels_may_be_written_as_a_float(name):
    assert load_circuit(name, 3.0) == load_circuit(name, 3)
    assert type(load_circuit(name, 3.0).channels) is int
    assert load_circuit(name, 3).with_channels(2.0).channels == 2


def test_a_seed_in_place_of_a_generator_is_that_of_its_stream():
    one, other = (separated_evidence(3, 4, 0.5, rng=rng) for rng in (7, stream(7)))
    assert np.array_equal(one.log_likelihood, other.log_likelihood)
    with refused("seed"):
        separated_evidence(3, 4, 0.5, rng=-1)


def test_parts_that_belong_to_other_trials_are_refused():
    """Shapes that only happen to fit gave numbers without meaning."""
    evidence = some_evidence(hypotheses=2, baseline=0.0)
    trace = Msprt().run(evidence)
    decision = first_crossing(trace, 0.3)
    low = BasalGanglia(TABLE, "algebra").circuit.readable_nats[0] / 2
    for call in (
        lambda: tradeoff(trace, some_evidence(hypotheses=4)),
        lambda: tradeoff(trace, evidence[:10]),
        lambda: tradeoff(trace.out_nats, evidence),
        lambda: stopping_posterior("maca", 1.0, 0.3, 0.5),
        lambda: working_range(3, 0.3),
        lambda: working_range(TABLE, "0.3"),
        lambda: tradeoff(trace, evidence, 0.3),
        lambda: tradeoff(trace, evidence, [[0.3, 0.2]]),
        lambda: reward(decision, evidence.truth[:3], 5.0),
        lambda: first_crossing(trace, [0.3, 0.2]).plot(truth=evidence.truth[:3]),
        lambda: NamedEvidence(evidence, ["a"]),
        lambda: trial_table(decision, NamedEvidence(evidence[:5], ["a", "b"]), model="m"),
        lambda: trial_table(decision, evidence, model="m"),
        lambda: decide_at_thresholds(BasalGanglia(TABLE, "algebra"), evidence, [low]),
        lambda: compare(BasalGanglia(TABLE, "algebra"), evidence, intact="macaque"),
        lambda: BasalGanglia(TABLE, "algebra").decide(evidence, 0.3, rates="a"),
        lambda: stopping_posterior(TABLE, 1.0, 0.3, -1.0),
        lambda: engines.run("macaque", np.zeros((1, 1, 2)), engine="algebra", step_ms=1.0),
    ):
        with pytest.raises(ValueError, match=r"must|not of|resolves no OUT|equals"):
            call()


@pytest.mark.parametrize("read", [read_table, read_evidence_table])
def test_a_file_is_given_by_its_path(read):
    for odd in (None, 3, [], EVIDENCE):
        with refused("path must be the path"):
            read(odd)


@pytest.mark.parametrize(
    "index", [999, -999, [0, 999], "a", 1.5, (0, 1), None, np.array([[0]]), np.array([True])]
)
def test_trials_that_are_not_there_are_an_index_error(index):
    with pytest.raises(IndexError, match=r"^trials must be"):
        EVIDENCE[index]


def test_one_trial_by_its_number_is_evidence_of_that_trial():
    for index, number in ((0, 0), (-1, 3), (np.int64(2), 2)):
        one = EVIDENCE[index]
        assert one.trials == 1
        assert one.trial_numbers.tolist() == [number]
        assert np.array_equal(one.log_likelihood[0], READINGS[number])
    assert [one.trial_numbers[0] for one in EVIDENCE] == [0, 1, 2, 3]
    with refused("trials got 0 of 4"):
        EVIDENCE[2:2]


ODD = ["0.5", "abc", None, 1j, [], {}, object()]


CALLS = {
    "leak_hz": Lca,
    "slope": lambda odd: LinearGpe(slope=odd),
    "separation": lambda odd: separated_evidence(2, 3, odd, rng=1),
    "conflict": lambda odd: separated_evidence(2, 3, 0.5, rng=1, conflict=odd),
    "trials": lambda odd: separated_evidence(odd, 3, 0.5, rng=1),
    "rng": lambda odd: separated_evidence(2, 3, 0.5, rng=odd),
    "foreperiod_ms": lambda odd: expecting(EVIDENCE, 1.0, odd, rng=1),
    "thresholds": lambda odd: tally_sprt(EVIDENCE, odd),
}


@pytest.mark.parametrize("field", CALLS)
def test_what_is_of_the_wrong_kind_is_refused_by_name(field):
    for odd in ODD:
        with pytest.raises(InputError) as caught:
            CALLS[field](odd)
        assert caught.value.field.startswith(field)
