"""Constraints of OUT = -ln P against the fixed point, and the shift of OUT by a loss of STN."""

import numpy as np
import pytest

from circuits import anatomy
from circuits.anatomy import load_circuit
from circuits.dynamics.fixed_point import off_nats, resting_hz, solve, wired
from circuits.laws.family import constraints, failures, offset_nats, shift_nats
from circuits.laws.members import SIGMA0, dependent, directions, loop, moved

LOSSES = (0.1, 0.2, 0.3, 0.5)
EDITS = {
    "scale ctx->STN 1.05": "exponent",
    "scale ctx->D1 1.05": "direct",
    "scale STN->SNr 0.9": "sum",
    "cut STN->SNr 10%": "sum",
    "set SNr.bias_nats -1": "offset",
    "scale D2->GPe 1.5": "exponent direct",
    "lesion GPe 10%": "exponent direct sum log",
    "add ctx_inh->STN weight=-0.1": "common",
    "scale ctx->D1[0] 1.05": "alike direct",
}


def above(circuit, drive):
    """OUT - (-ln P) of the favoured channel, (drives,) nats; P follows from cortical activity."""
    wiring = wired(circuit)
    rates = wiring.rates(solve(wiring, drive))
    y = wiring.activity(rates[:, wiring.blocks_of(circuit.input)], circuit.input)
    y = y / circuit.drive_gain
    out = wiring.activity(rates[:, wiring.blocks_of(circuit.readout)], circuit.readout)
    best, rows = y.argmax(axis=1), np.arange(len(y))
    return out[rows, best] - (np.log(np.exp(y).sum(axis=1)) - y[rows, best])


def drives(channels, seed=0, trials=50):
    return np.random.default_rng(seed).uniform(-0.8, 0.8, (trials, channels))


@pytest.mark.parametrize("name", ["macaque", "bogacz_gurney", "appendix_b"])
@pytest.mark.parametrize("channels", range(2, 9))
def test_exact_circuits_and_the_default_meet_all_constraints(name, channels):
    circuit = load_circuit(name, channels)
    assert failures(circuit) == []
    assert max(abs(one.fails_by) for one in constraints(circuit)) < 1e-12
    assert np.abs(above(circuit, drives(channels))).max() < 1e-6


@pytest.mark.parametrize(("edit", "names"), EDITS.items(), ids=[*EDITS])
def test_an_edit_fails_the_constraint_that_it_breaks(edit, names):
    circuit = load_circuit("macaque", 3).edited(edit)
    failed = {one.name for one in constraints(circuit) if not one.holds} - {"offset"}
    assert failed == set(names.split()) - {"offset"}
    # The fixed point agrees: OUT is off by no constant, unless the offset alone fails.
    off = above(circuit, drives(3))
    assert (np.ptp(off) < 1e-6) == (names == "offset")
    assert (offset_nats(circuit) is None) == (names != "offset")


def test_circuits_outside_the_family_say_which_constraint_they_fail():
    failed = [one.name for one in constraints(anatomy.linear_gpe(3)) if not one.holds]
    assert failed == ["log"]
    # A linear S - ln S is the family's to first order, but has no logarithm.
    failed = [one.name for one in constraints(load_circuit("spiking_msprt", 3)) if not one.holds]
    assert failed == ["sum", "log", "offset"]
    assert len(failures(load_circuit("gpr", 3))) == 1  # in salience, not nats
    assert offset_nats(load_circuit("gpr", 3)) is None


@pytest.mark.parametrize("edit", ["clamp STN 10%", "lesion STN[0] 10%", "lesion STN"])
def test_a_loss_that_does_not_scale_the_sum_over_stn_has_no_shift(edit):
    edited = load_circuit("macaque", 3).edited(edit)
    assert len(failures(edited)) == 1
    assert shift_nats(edited) is None


@pytest.mark.parametrize("lost", LOSSES)
@pytest.mark.parametrize("name", ["macaque", "bogacz_gurney", "appendix_b"])
@pytest.mark.parametrize("channels", [2, 4, 8])
def test_a_loss_of_stn_shifts_out_by_ln_of_what_survives(name, channels, lost):
    """``OUT = -ln P + ln(1 - f)`` whatever the evidence, and the bias of SNr alone undoes it."""
    circuit = load_circuit(name, channels)
    lesioned = circuit.lesion("STN", lost)
    assert shift_nats(lesioned) == pytest.approx(np.log1p(-lost), abs=1e-12)
    level = drives(channels) * 0.3  # OUT stays above 0, where SNr would fall silent
    if circuit.centred:
        level -= level.mean(axis=1, keepdims=True)
    off = above(lesioned, level)
    silent = off + np.log(channels) < 0.3
    assert np.abs(off - np.log1p(-lost))[~silent].max(initial=0) < 1e-4
    bias = lesioned["SNr"].bias_nats - np.log1p(-lost)
    restored = lesioned.with_population("SNr", bias_nats=bias)
    assert np.abs(above(restored, level)).max() < 1e-4
    assert shift_nats(restored) == pytest.approx(0, abs=1e-12)


def test_losses_add_up_and_homeostasis_undoes_them():
    circuit = load_circuit("macaque", 4)
    twice = circuit.lesion("STN", 0.2).lesion("STN", 0.5)
    assert shift_nats(twice) == pytest.approx(np.log(0.8 * 0.5))
    assert shift_nats(twice, circuit.lesion("STN", 0.2)) == pytest.approx(np.log(0.5))
    assert shift_nats(twice.compensate()) == pytest.approx(0, abs=1e-9)
    rebound = twice.compensate(rebound_nats={"SNr": 0.2})
    assert shift_nats(rebound) == pytest.approx(0.2)
    assert shift_nats(circuit) is None  # not edited
    assert shift_nats(circuit.lesion("GPe_ctx", 0.5)) == pytest.approx(0, abs=1e-12)


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
