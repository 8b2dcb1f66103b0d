"""Decisions while readings come are those of all readings at once."""

import warnings

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import bgmodel as bg
from circuits.errors import DeadlineWarning, RangeWarning
from tests.helpers import refused, refusing

CIRCUIT = bg.load_circuit("macaque", 2)
SMALL = bg.load_circuit("spiking_msprt", 2).with_neurons(40)
FIELDS = ("choice", "time_ms", "forced", "premature")


def evidence_of(trials, t_max=20, d_prime=0.9, channels=2, seed=3, step_ms=20.0):
    return bg.gaussian_evidence(
        trials, d_prime=d_prime, channels=channels, t_max=t_max, seed=seed, step_ms=step_ms
    )


def decided(session, evidence):
    """Return what a session decides, one array per field, and how many readings it took."""
    decisions, taken = [], []
    for readings in evidence.log_likelihood:
        for reading in readings:
            if session.add(reading) is not None:
                break
        decisions.append(session.decision)
        taken.append(len(session.readings))
        session.next()
    return [np.array([getattr(d, name)[0] for d in decisions]) for name in FIELDS], np.array(taken)


def same(session, decision, evidence):
    fields, taken = decided(session, evidence)
    for name, values in zip(FIELDS, fields, strict=True):
        np.testing.assert_array_equal(values, getattr(decision, name), err_msg=name)
    return taken


@pytest.mark.parametrize("model", [bg.Msprt(), bg.Sprt(), bg.Msprt(0.55)])
def test_a_test_decides_as_it_does_with_all_readings(model):
    evidence = evidence_of(1000)
    session = model.session(2, posterior=0.9, step_ms=20.0, t_max=20)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        at_once = model.decide(evidence, posterior=0.9)
    taken = same(session, at_once, evidence)
    # It stops at the reading that decides.
    np.testing.assert_array_equal(taken * 20.0, at_once.time_ms)


@pytest.mark.parametrize(
    ("circuit", "engine", "trials"),
    [(CIRCUIT, "rate", 40), (CIRCUIT, "population", 60), (SMALL, "spikes", 12)],
)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_circuit_decides_as_it_does_with_all_readings(circuit, engine, trials):
    evidence = evidence_of(trials)
    model = bg.BasalGanglia(circuit, engine, seed=5).adapted_to(evidence)
    session = model.session(posterior=0.82, step_ms=20.0, t_max=20, baseline=evidence.baseline)
    at_once = model.decided(evidence, model.threshold(None, 0.82))
    taken = same(session, at_once, evidence)
    # It decides between readings, and takes no more of them than had come.
    early = ~at_once.forced
    assert (at_once.time_ms[early] % 20 > 0).any()
    np.testing.assert_array_equal(
        taken[early], np.maximum(np.ceil(at_once.time_ms / 20) - 1, 1)[early]
    )


@given(st.integers(2, 12), st.integers(0, 2**16))
@settings(max_examples=15, deadline=None)
def test_a_session_never_looks_ahead(step, seed):
    """What it has made of the first readings does not depend on those to come."""
    evidence = evidence_of(2, seed=seed)
    model = bg.BasalGanglia(CIRCUIT, "population", seed=5)
    outs = []
    for readings in evidence.log_likelihood:
        session = model.session(1e-9 + 0.06, step_ms=20.0, t_max=20, baseline=0.0)
        for reading in (*evidence.log_likelihood[0, :step], readings[step]):
            if session.add(reading) is not None:
                break
        outs.append(session.trace.out_nats[0, : (step + 1) * 20])
    few = min(map(len, outs))
    np.testing.assert_array_equal(outs[0][:few], outs[1][:few])


def test_without_a_reading_a_test_waits_and_a_circuit_goes_on():
    session = bg.Msprt().session(2, posterior=0.95, step_ms=100.0)
    assert session.add([0.5, 0.0]) is None
    before = session.trace.out_nats[0, -1]
    with pytest.warns(DeadlineWarning, match="reading 2 came 200 ms late: 2 steps"):
        session.add([0.0, 0.0], at_ms=400.0)
    np.testing.assert_allclose(session.trace.out_nats[0, -1], before)
    assert session.trace.time_ms[-1] == 400
    with refused("at_ms readings must come in order"):
        session.add([0.0, 0.0], at_ms=350.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        session.add([0.0, 0.0], at_ms=540.0)


def test_the_deadline_forces_what_the_readings_favour_or_leaves_it_undecided():
    for forced in (True, False):
        session = bg.Msprt().session(3, posterior=0.99, t_max=3, forced=forced)
        for _ in range(2):
            assert session.add([0.0, 0.1, 0.0]) is None
        decision = session.add([0.0, 0.1, 0.0])
        assert decision.choice[0] == (1 if forced else -1)
        assert decision.forced[0] == forced
        with refused("reading is decided"):
            session.add([0.0, 0.1, 0.0])
        session.next()
        assert session.add([0.0, 0.1, 0.0]) is None
        assert session.finish().forced[0] == forced


test_bad_input_gets_one_clear_sentence = refusing(
    (lambda: bg.Msprt().session(2), "posterior neither"),
    (lambda: bg.Msprt().session(1, posterior=0.9), "hypotheses"),
    (lambda: bg.Msprt().session(2, posterior=0.4), "posterior chance"),
    (lambda: bg.Msprt().session(2, posterior=0.9).add([1.0]), "reading 2 finite"),
    (lambda: bg.Msprt().session(2, posterior=0.9).add([1.0, np.nan]), "reading finite"),
    (lambda: bg.Msprt().session(2, posterior=0.9).add("ab"), "reading"),
    (lambda: bg.Msprt().session(2, posterior=0.9).finish(), "reading"),
    (lambda: bg.Msprt().session(2, posterior=0.9, t_max=0), "t_max"),
    (lambda: bg.Msprt().session(2, posterior=0.9, step_ms=-1), "step_ms"),
    (lambda: bg.Msprt().session(2, posterior=0.9, prior=[0.9, 0.3]), "prior"),
    (lambda: bg.BasalGanglia(CIRCUIT).session(posterior=0.82), "baseline"),
    (lambda: bg.BasalGanglia(CIRCUIT, "algebra").session(posterior=0.82, baseline=0), "engine"),
)


@pytest.mark.filterwarnings("ignore::circuits.errors.DeadlineWarning")
@given(at_ms=st.floats(100.0, 2000.0))
def test_a_late_reading_takes_the_nearest_step(at_ms):
    assume(abs(at_ms / 100.0 % 1 - 0.5) > 1e-6)
    session = bg.Msprt().session(2, posterior=0.95, step_ms=100.0)
    session.add([0.1, 0.0], at_ms=at_ms)
    assert len(session.readings) == round(at_ms / 100.0)


def test_a_session_says_once_that_readings_leave_the_range_of_the_circuit():
    """As `decide` says it of the same readings."""
    model = bg.BasalGanglia(CIRCUIT, "rate")
    session = model.session(posterior=0.82, step_ms=20.0, t_max=20, baseline=0.0)
    with pytest.warns(RangeWarning, match="macaque works from"):
        session.add([-9.0, -9.0])
    with warnings.catch_warnings():
        warnings.simplefilter("error", RangeWarning)
        session.add([-9.0, -9.0])
        session.next()
        session.add([-9.0, -9.0])
