"""The score of the exam: controls rest as the circuit they are edits of, ranks, and stability."""

import numpy as np
import pandas as pd
import pytest

from bgmodel.exam.exam import Exam
from circuits.anatomy import CIRCUITS, DEFAULT, load_circuit
from circuits.dynamics.fixed_point import resting_hz, solve, wired
from figures.exam.measure_exam import (
    CONTROLS,
    MECHANISMS,
    NO_MOTIFS,
    WITHOUT,
    examinees,
    judged,
    noise_alone,
    ranks,
)


def test_every_circuit_and_four_controls_are_examined():
    without = [f"{name}{WITHOUT}" for name in NO_MOTIFS]
    assert list(examinees()) == [*CIRCUITS, *CONTROLS, *without]
    assert {domain for domain, _ in CONTROLS.values()} <= set(Exam.shipped().domains)


@pytest.mark.parametrize("channels", [2, 4])
def test_noise_alone_rests_as_the_circuit(channels):
    circuit = load_circuit(DEFAULT, channels)
    before, after = resting_hz(circuit), resting_hz(noise_alone(circuit))
    assert after == pytest.approx(before, rel=1e-6, abs=1e-6)


def test_differences_keep_their_sign_or_do_not():
    rows = [
        ("x", "a", 3.0, "disagrees"), ("x", "a", 2.5, "disagrees"), ("x", "a", 1.0, "agrees"),
        ("x", "b", 3.0, "disagrees"), ("x", "b", -0.5, "agrees"),
        ("x", "c", np.nan, "agrees"), ("x", "c", np.nan, "agrees"),
        ("x", "d", 0.5, "agrees"), ("x", "d", np.nan, "fails"),
    ]  # fmt: skip
    table = pd.DataFrame(rows, columns=["examinee", "id", "z", "outcome"])
    verdicts = judged(table)["x"]
    assert verdicts.tolist() == ["same sign", "other sign", "same outcome", "other outcome"]


def test_a_control_is_ranked_among_circuits_and_not_among_controls():
    names = [DEFAULT, "gpr", *CONTROLS]
    shares = [0.8, 0.1, 0.3, 0.0, 0.1, 0.0]
    one = pd.DataFrame({"examinee": names, "share": shares, "domain": "optimality"})
    other = one.assign(domain="resting rates", share=0.4)
    ranked = ranks(pd.concat([one, other])).set_index("control")
    assert ranked.loc["no GPe", ["worse", "tied", "of"]].tolist() == [1, 0, 3]
    assert ranked.loc["no D1", ["worse", "tied"]].tolist() == [0, 1]
    assert set(ranked["as_good_as_default"]) == {"resting rates"}


def test_a_cortex_that_codes_likelihoods_leaves_out_as_it_is():
    circuit = load_circuit(DEFAULT, 4)
    coded = circuit.edited(*MECHANISMS["cortex codes likelihoods"])
    drive = np.random.default_rng(1).normal(0, 0.4, (50, 4))
    wirings = [wired(each) for each in (circuit, coded)]
    states = [solve(wiring, drive) for wiring in wirings]
    out, cortex = (wirings[0].blocks_of(name) for name in (circuit.readout, circuit.input))
    assert min(x[:, cortex].min() for x in states) > 0, "cortex falls silent"
    nats, coded_nats = (x[:, out] for x in states)
    read = nats < np.log(4)
    assert read.sum() > 50
    np.testing.assert_allclose(coded_nats[read], nats[read], atol=2e-3)
    plain, other = (w.rates(x)[:, cortex] for w, x in zip(wirings, states, strict=True))
    np.testing.assert_allclose(np.log(other) - states[1][:, cortex], np.log(4.4), atol=1e-6)
    assert np.ptp(other) > 2 * np.ptp(plain)
