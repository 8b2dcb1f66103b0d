"""Random members of the family compute -ln P; the default is one, and keeps its coordinates."""

import numpy as np
import pytest

from circuits.anatomy import load_circuit
from circuits.dynamics.fixed_point import off_nats, resting_hz
from circuits.laws.family import constraints, shift_nats
from circuits.laws.members import SIGMA0, dependent, directions, loop, moved
from tests.circuits.laws.test_family import above, drives


def somewhere(channels, seed):
    """Return a random member: D2 fires in all of the readable range, so that no line is cut."""
    rng = np.random.default_rng(seed)
    low, high = rng.uniform([1.2, 0.1, 0.0], [3.0, 0.9, 0.3]), rng.uniform(0.5, 3)
    to = {
        SIGMA0: low[0],
        "GPe->STN.weight": -low[1],
        "D2->GPe.weight": -low[2],
        "STN->GPe.weight": rng.uniform(0.8, 1.05),
        "GPe_ctx->ctx.weight": -rng.uniform(0.5, 2),
        "D2.baseline_hz": 5.0,
        "STN.gain_hz_per_nat": 20 * high,
        "SNr.baseline_hz": rng.uniform(10, 40),
        "STN->SNr.tau_ms": rng.uniform(5, 30),
    }
    return moved(load_circuit("macaque", channels), to), to


@pytest.mark.parametrize("channels", range(2, 9))
@pytest.mark.parametrize("seed", range(4))
def test_random_members_compute_the_posterior(channels, seed):
    member, to = somewhere(channels, seed)
    assert max(abs(one.fails_by) for one in constraints(member)) < 1e-9
    assert np.abs(off_nats(member)).max() < 1e-3  # the readable range
    assert np.abs(above(member, drives(channels, seed))).max() < 1e-3
    # A weight moved off the family, as a negative control.
    off = member.scale("GPe->STN", 1.2)
    assert {"log", "sum"} <= {one.name for one in constraints(off) if not one.holds}
    assert np.ptp(above(off, drives(channels, seed))) > 1e-3
    here = {one.name: one.value for one in directions(member)}
    assert here == pytest.approx(here | to)
    # The lesion theorem holds for all of them.
    assert shift_nats(member.lesion("STN", 0.1)) == pytest.approx(np.log(0.9), abs=1e-4)


def test_the_default_is_a_member_with_these_coordinates():
    circuit = load_circuit("macaque", 4)
    known = {"Sigma0": 2.6, "loop gain": 0.45 * 1.6, "loop share": 0.45, "indirect share": 0.045}
    assert loop(circuit) == pytest.approx(known)
    assert [*dependent(circuit)] == ["log", "exponent", "direct", "sum"]
    units = {one.name: one.unit for one in directions(circuit)}
    assert units["SNr.gain_hz_per_nat"] == "Hz per nat"
    assert units["GPe->STN.delay_ms"] == "ms"
    assert "ctx->STN.weight" not in units  # it follows


def test_a_move_to_where_it_is_changes_nothing():
    circuit = load_circuit("macaque", 3)
    same = moved(circuit, {one.name: one.value for one in directions(circuit)})
    for name in circuit:
        for field in ("weight", "bias_nats"):
            value = getattr(circuit[name], field, 0.0)
            assert getattr(same[name], field, 0.0) == pytest.approx(value, abs=1e-9)


def test_a_move_keeps_resting_activity_and_dopamine_neutral_at_rest():
    circuit = load_circuit("macaque", 2)
    member = moved(circuit, {SIGMA0: 2.2, "GPe->STN.weight": -0.35})
    before, after = resting_hz(circuit), resting_hz(member)
    assert after.pop("STN") / before.pop("STN") == pytest.approx(2.2 / 2.6)
    assert after == pytest.approx(before)
    assert resting_hz(member.dopamine(0.8)) == pytest.approx(resting_hz(member))


def test_the_weights_onto_d1_and_stn_follow_from_the_loop():
    member = moved(load_circuit("macaque", 2), {SIGMA0: 2.2, "GPe->STN.weight": -0.35})
    assert member["GPe->SNr"].weight == pytest.approx(-0.65)
    assert member["ctx->STN"].weight == pytest.approx(1 - 0.1 * 0.35)
    assert member["ctx->D1"].weight == pytest.approx(1 + 0.1 * 0.65 + 0.15)
    assert member["STN->SNr"].weight == pytest.approx(1)


def test_exact_circuits_move_too_and_stay_exact():
    circuit = load_circuit("appendix_b", 5)
    member = moved(circuit, {"GPe->STN.weight": -0.4, "D2->GPe.weight": -0.2})
    assert member.exact
    assert off_nats(member) == pytest.approx((0, 0), abs=1e-6)
    simple = moved(load_circuit("bogacz_gurney", 3), {"GPe->STN.weight": -0.5})
    assert simple["STN->GPe"].weight == pytest.approx(2)
    assert off_nats(simple) == pytest.approx((0, 0), abs=1e-6)


def test_a_move_in_time_makes_the_largest_lead_unknown_and_one_in_hz_does_not():
    circuit = load_circuit("macaque", 2)
    assert moved(circuit, {"SNr.gain_hz_per_nat": 40}).max_lead_nats == circuit.max_lead_nats
    assert moved(circuit, {SIGMA0: 2.3}).max_lead_nats == np.inf
