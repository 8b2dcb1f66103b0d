"""The fixed point against -ln P and against closed forms of every lesion."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import brentq
from scipy.special import lambertw, logsumexp

from circuits import anatomy
from circuits.declaration.rows import Projection
from tests.circuits.helpers import CLOSE, REFERENCE, evidence, run_algebra


def output(circuit, drive):
    """OUT (trials, channels), nats, of drives (trials, channels)."""
    return run_algebra(circuit, np.asarray(drive)[:, None]).output_nats[:, 0]


def surprise(drive):
    """-ln P of the posterior given by the drive."""
    return logsumexp(drive, axis=-1, keepdims=True) - drive


def root(equation, low=1e-9, high=1e9):
    return brentq(equation, low, high, xtol=1e-13, rtol=1e-14)


def solved(sigma, targets):
    """Return the Sigma > 0 at which sigma(Sigma) is each target."""
    return np.array([root(lambda s, t=t: sigma(s) - t) for t in targets.ravel()])[:, None]


@st.composite
def cases(draw):
    """Draw a member of the appendix-B family, and evidence for it."""
    channels = draw(st.integers(2, 20))
    weights = {"w_gpe_stn": draw(st.floats(0.05, 1)), "w_d2_gpe": draw(st.floats(0, 2))}
    member = anatomy.appendix_b(channels, **weights)
    finite = st.floats(-12, 12, allow_nan=False)
    drive = draw(arrays(np.float64, (3, channels), elements=finite))
    return member, drive - drive.mean(axis=1, keepdims=True)


@settings(max_examples=60)
@given(cases())
def test_random_members_of_appendix_b_give_minus_log_posterior(case):
    member, drive = case
    assert member.exact
    assert np.abs(output(member, drive) - surprise(drive)).max() < CLOSE


@settings(max_examples=40)
@given(cases(), st.floats(-2.5, 10))
def test_a_common_input_changes_nothing(case, common):
    member, drive = case  # S >= 3 before the common input
    moved = output(member, drive + common)
    assert np.abs(moved - output(member, drive)).max() < CLOSE
    channels = replace(member, reference_nats=REFERENCE + common)
    assert np.abs(output(channels, drive) - moved).max() < CLOSE


def test_the_total_must_be_positive_unless_gpe_reaches_the_readout():
    """Without S > 0 the simple circuit falls silent; with v > 0 every S has its Sigma."""
    drive = evidence(3)
    with pytest.raises(ValueError, match="bogacz_gurney has no fixed point"):
        output(replace(anatomy.bogacz_gurney(3), reference_nats=-8), drive)
    full = replace(anatomy.appendix_b(3), reference_nats=-8)
    assert np.abs(output(full, drive) - surprise(drive)).max() < CLOSE


@pytest.mark.parametrize("slope", [0.3, 0.84, 1.0, 2.5])
def test_a_linear_gpe_gives_lamberts_w(slope):
    drive = evidence(5)
    s = REFERENCE + logsumexp(drive, axis=1) - np.log(5)
    sigma = np.real(lambertw(slope * np.exp(s))) / slope
    expected = sigma[:, None] - (drive + REFERENCE - np.log(5))
    out_nats = output(anatomy.linear_gpe(5, slope=slope), drive)
    assert np.abs(out_nats - np.maximum(expected, 0)).max() < CLOSE


# ---- lesions of the exact circuit: y, S and OUT as Bogacz & Gurney write them


class Exact:
    """The exact circuit with five channels, and its quantities."""

    circuit = anatomy.bogacz_gurney(5)
    drive = evidence(5)
    y = drive + REFERENCE - np.log(5)
    s = logsumexp(y, axis=1, keepdims=True)


def agrees(circuit, expected, drive=Exact.drive):
    """Whether OUT is as expected, where rates can follow: OUT is never negative."""
    return np.abs(output(circuit, drive) - np.maximum(expected, 0)).max() < CLOSE


def test_without_stn_out_is_a_race_or_silent():
    """With its drive replaced an unnormalised race is left; without, OUT is silent."""
    assert agrees(Exact.circuit.clamp("STN"), REFERENCE - Exact.y)
    positive = Exact.drive - Exact.y.min() + 0.1  # every y > 0, so that D1 only inhibits
    assert not output(Exact.circuit.lesion("STN"), positive).any()


def test_a_lost_part_of_gpe_held_at_rest_solves_its_equation():
    """What GPe sends at rest is REFERENCE - ln REFERENCE, held for the lost fraction."""
    rest = REFERENCE - np.log(REFERENCE)
    for fraction in (0.3, 1.0):
        # ln Sigma = S - (1 - f)(Sigma - ln Sigma) - f rest
        sigma = solved(
            lambda x, f=fraction: np.log(x) + (1 - f) * (x - np.log(x)) + f * rest, Exact.s
        )
        out_nats = output(Exact.circuit.clamp("GPe", fraction), Exact.drive)
        assert np.abs(out_nats / (sigma - Exact.y) - 1).max() < CLOSE


# ---- lesions with all pathways. GPe has the weights w to STN and v = 1 - w to SNr, D2 has d:
# GPe_i = Sigma - ln Sigma - d y_i, so STN_i = exp((1 + w d) y_i) (Sigma e^-Sigma)^w, and thus
# w Sigma + v ln Sigma = ln sum exp((1 + w d) y) = S. Below, the same with weights changed.


class Full:
    """A member of appendix B with five channels, and its quantities."""

    w, v, d = 0.6, 0.4, 0.8
    circuit = anatomy.appendix_b(5, w_gpe_stn=w, w_d2_gpe=d)
    drive = evidence(5, trials=8)
    y = (drive + REFERENCE - np.log(5)) / (1 + w * d)

    @classmethod
    def out(cls, *, d1=1.0, d2=1.0, hyperdirect=1.0, to_stn=1.0, to_snr=1.0):
        """OUT with each pathway's weight multiplied."""
        w, v, d = cls.w * to_stn, cls.v * to_snr, cls.d * d2
        s = logsumexp((hyperdirect + w * d) * cls.y, axis=1, keepdims=True)
        sigma = solved(lambda x: w * x + (1 - w) * np.log(x), s)
        gpe = sigma - np.log(sigma) - d * cls.y
        return sigma - v * gpe - d1 * (1 + cls.d) * cls.y


@pytest.mark.parametrize(
    ("edit", "scaled"),
    [
        ("scale D1->SNr", "d1"), ("scale ctx->D1", "d1"), ("lesion D1", "d1"),
        ("scale D2->GPe", "d2"), ("lesion D2", "d2"), ("scale ctx->STN", "hyperdirect"),
        ("scale GPe->SNr", "to_snr"), ("scale GPe->STN", "to_stn"), ("lesion GPe", "to_stn to_snr"),
        ("dopamine", "d1"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("factor", [0.4, 0.9])
def test_lesions_with_all_pathways_follow_their_closed_form(edit, scaled, factor):
    lost = edit.startswith("lesion")
    lesioned = Full.circuit.edited(f"{edit} {1 - factor if lost else factor}")
    factors = dict.fromkeys(scaled.split(), factor)
    factors |= {"d2": 2 - factor} if edit == "dopamine" else {}
    assert not lesioned.exact
    expected = Full.out(**factors)
    assert agrees(lesioned, expected, Full.drive)
    assert np.abs(expected - surprise(Full.drive)).max() > 0.01


def test_readings_and_trials_do_not_mix():
    circuit = anatomy.appendix_b(3)
    drive = evidence(3, trials=12)
    activity = run_algebra(circuit, drive.reshape(4, 3, 3), step_ms=50)
    assert np.abs(activity.output_nats.reshape(12, 3) - output(circuit, drive)).max() < 1e-12
    assert activity.time_ms.tolist() == [0, 50, 100]
    assert activity.engine == "algebra"


def test_the_common_mode_holds_stn_near_its_set_point_and_leaves_out_as_it_is():
    """Its leak lets Sigma rise by a gain-th of what it takes away."""
    circuit = anatomy.spiking_msprt(2)
    drive = np.zeros((1, 2, 2))
    drive[0, 1] = np.array([0.6, -0.6])
    activity = run_algebra(circuit, drive)
    taken = activity.decoded_nats("common")[0, :, 0]
    sigma = activity.decoded_nats("STN")[0].sum(axis=1)
    assert np.diff(sigma) == pytest.approx(np.diff(taken) / 10, abs=1e-9)
    exact = -np.log(np.exp(drive[0, 1]) / np.exp(drive[0, 1]).sum())
    # No cell is silent here: what is left is the line in place of S - ln S.
    assert activity.output_nats[0, 1, 0] == pytest.approx(exact[0], abs=0.001)


def test_a_loop_without_fixed_point_says_so():
    runaway = anatomy.spiking_msprt(4).with_rows(Projection("STN", "STN", 3.0, "diffuse"))
    with pytest.raises(ValueError, match="spiking_msprt has no fixed point at drive"):
        run_algebra(runaway, np.zeros((1, 1, 4)))
    # The bounded one of the table stops at silence.
    lesioned = run_algebra(anatomy.spiking_msprt(4).lesion("STN"), np.zeros((1, 1, 4)))
    assert lesioned.rates_hz["common"][0, 0, 0] == 0
