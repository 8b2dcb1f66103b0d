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
    member = anatomy.appendix_b(
        channels, w_gpe_stn=draw(st.floats(0.05, 1)), w_d2_gpe=draw(st.floats(0, 2))
    )
    finite = st.floats(-12, 12, allow_nan=False)
    drive = draw(arrays(np.float64, (3, channels), elements=finite))
    return member, drive - drive.mean(axis=1, keepdims=True)


@pytest.mark.parametrize("channels", range(2, 21))
@pytest.mark.parametrize("name", ["bogacz_gurney", "appendix_b"])
def test_exact_tables_give_minus_log_posterior(name, channels):
    circuit = anatomy.load_circuit(name, channels)
    assert circuit.exact
    drive = evidence(channels)
    assert np.abs(output(circuit, drive) - surprise(drive)).max() < CLOSE


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


def test_two_alternatives_map_onto_the_sprt():
    """OUT_2 = ln(1 + exp(-Z)), so a bound delta/2 on Z is a threshold on OUT."""
    z = np.linspace(-12, 12, 49)
    drive = np.stack([-z / 2, z / 2], axis=1)
    second = output(anatomy.bogacz_gurney(), drive)[:, 1]
    assert np.abs(second - np.log1p(np.exp(-z))).max() < CLOSE
    for delta in (1.3, 4.7, 9.9):
        threshold = np.log1p(np.exp(-delta / 2))
        assert np.array_equal(z >= delta / 2, second <= threshold)
        assert np.array_equal(np.exp(-second) >= 1 / (1 + np.exp(-delta / 2)), second <= threshold)


@pytest.mark.parametrize("slope", [0.3, 0.84, 1.0, 2.5])
def test_a_linear_gpe_gives_lamberts_w(slope):
    drive = evidence(5)
    s = REFERENCE + logsumexp(drive, axis=1) - np.log(5)
    sigma = np.real(lambertw(slope * np.exp(s))) / slope
    expected = sigma[:, None] - (drive + REFERENCE - np.log(5))
    out_nats = output(anatomy.linear_gpe(5, slope=slope), drive)
    assert np.abs(out_nats - np.maximum(expected, 0)).max() < CLOSE


@pytest.mark.parametrize(
    "wrong",
    [
        anatomy.linear_gpe(4),
        anatomy.linear_gpe(4, slope=0.84),
        anatomy.bogacz_gurney(4).with_population("STN", transfer="linear"),
        anatomy.appendix_b(4).with_population("STN", transfer="rectified"),
    ],
    ids=["GPe linear", "GPe linear 0.84", "STN linear", "STN rectified"],
)
def test_other_transfers_do_not_give_the_log_posterior(wrong):
    """Negative control: the match is no property of just any circuit of this shape."""
    drive = evidence(4)
    assert not wrong.exact
    assert np.abs(output(wrong, drive) - surprise(drive)).max() > 0.1


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


@pytest.mark.parametrize("fraction", [0.1, 0.5, 0.9])
def test_a_loss_of_stn_shifts_out_by_ln_of_what_is_left(fraction):
    lost = Exact.circuit.lesion("STN", fraction)
    assert agrees(lost, Exact.s + np.log(1 - fraction) - Exact.y)


def test_without_stn_out_is_a_race_or_silent():
    """With its drive replaced an unnormalised race is left; without, OUT is silent."""
    assert agrees(Exact.circuit.clamp("STN"), REFERENCE - Exact.y)
    positive = Exact.drive - Exact.y.min() + 0.1  # every y > 0, so that D1 only inhibits
    assert not output(Exact.circuit.lesion("STN"), positive).any()


@pytest.mark.parametrize("fraction", [0.2, 0.5, 1.0])
def test_a_loss_of_gpe_raises_sigma_as_its_equation_says(fraction):
    """(1 - f) Sigma + f ln Sigma = S."""
    sigma = solved(lambda x: (1 - fraction) * x + fraction * np.log(x), Exact.s)
    assert (sigma > Exact.s).all()
    out_nats = output(Exact.circuit.lesion("GPe", fraction), Exact.drive)
    assert np.abs(out_nats / (sigma - Exact.y) - 1).max() < CLOSE


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


@pytest.mark.parametrize("gain", [0.0, 0.7, 0.95, 1.05, 1.5])
def test_a_gain_of_d1_multiplies_the_evidence_of_its_channel(gain):
    expected = Exact.s - gain * Exact.y
    assert agrees(Exact.circuit.scale("D1->SNr", gain), expected)
    assert agrees(Exact.circuit.scale("ctx->D1", gain), expected)
    assert agrees(Exact.circuit.dopamine(gain), expected)
    if gain < 1:
        assert agrees(Exact.circuit.lesion("D1", 1 - gain), expected)


@pytest.mark.parametrize("gain", [0.5, 1.3])
def test_a_gain_of_the_hyperdirect_pathway_sums_evidence_at_that_gain(gain):
    """Sigma = ln sum exp(k y): S at another gain of the evidence."""
    expected = logsumexp(gain * Exact.y, axis=1, keepdims=True) - Exact.y
    assert agrees(Exact.circuit.scale("ctx->STN", gain), expected)


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


def test_the_closed_form_of_all_pathways_is_minus_log_posterior():
    assert np.abs(Full.out() - surprise(Full.drive)).max() < CLOSE


@pytest.mark.parametrize(
    ("edit", "factors"),
    [
        (lambda c, k: c.scale("D1->SNr", k), lambda k: {"d1": k}),
        (lambda c, k: c.scale("ctx->D1", k), lambda k: {"d1": k}),
        (lambda c, k: c.lesion("D1", 1 - k), lambda k: {"d1": k}),
        (lambda c, k: c.scale("D2->GPe", k), lambda k: {"d2": k}),
        (lambda c, k: c.lesion("D2", 1 - k), lambda k: {"d2": k}),
        (lambda c, k: c.scale("ctx->STN", k), lambda k: {"hyperdirect": k}),
        (lambda c, k: c.scale("GPe->SNr", k), lambda k: {"to_snr": k}),
        (lambda c, k: c.scale("GPe->STN", k), lambda k: {"to_stn": k}),
        (lambda c, k: c.lesion("GPe", 1 - k), lambda k: {"to_stn": k, "to_snr": k}),
        (lambda c, k: c.dopamine(k), lambda k: {"d1": k, "d2": 2 - k}),
    ],
    ids=[
        "D1-SNr",
        "ctx-D1",
        "D1",
        "D2-GPe",
        "D2",
        "hyperdirect",
        "GPe-SNr",
        "GPe-STN",
        "GPe",
        "dopamine",
    ],
)
@pytest.mark.parametrize("factor", [0.4, 0.9])
def test_lesions_with_all_pathways_follow_their_closed_form(edit, factors, factor):
    lesioned = edit(Full.circuit, factor)
    assert not lesioned.exact
    expected = Full.out(**factors(factor))
    assert agrees(lesioned, expected, Full.drive)
    assert np.abs(expected - surprise(Full.drive)).max() > 0.01


@pytest.mark.parametrize("fraction", [0.3, 0.6])
def test_a_loss_of_stn_with_all_pathways_shifts_s_alone(fraction):
    """Now w Sigma + v ln Sigma = S + ln(1 - f)."""
    w, v, d = Full.w, Full.v, Full.d
    s = logsumexp((1 + w * d) * Full.y, axis=1, keepdims=True) + np.log(1 - fraction)
    sigma = solved(lambda x: w * x + v * np.log(x), s)
    expected = sigma - v * (sigma - np.log(sigma) - d * Full.y) - (1 + d) * Full.y
    assert np.abs(expected - (s - (1 + w * d) * Full.y)).max() < CLOSE
    assert agrees(Full.circuit.lesion("STN", fraction), expected, Full.drive)


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
