"""The macaque's table: OUT is -ln P of raw evidence, what channels share is cancelled inside."""

import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.tuning.strength import decided, drawn, late, variants
from benchmarks.tuning.strength import stability as stability_of_loop
from bgmodel.evidence import Evidence, minus_log_softmax
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.simulated_evidence import separated_evidence
from circuits import anatomy
from circuits.declaration.transfer import MOST_NATS
from circuits.dynamics.fixed_point import off_nats, resting_hz
from circuits.engines import Population, run
from circuits.laws import stability
from circuits.laws.family import failures, shift_nats
from circuits.laws.fluctuation import rate_spectrum
from tests.helpers import refused

ALTERNATIVES = (2, 4, 8)
LEADER_MS, STEP_MS = 500, 50.0


def out(table, drive):
    return run(table, np.asarray(drive)[None, None], engine="algebra", step_ms=1.0).output_nats[
        0, 0
    ]


def stepped(table, lead, size):
    """OUT of the leader, ms by ms, less what it was before all channels rise by a size."""
    drive = np.zeros((1, 40, table.channels))
    drive[0, :, 0] = lead
    drive[0, 10:] += size
    model = BasalGanglia(table, Population(noise=False), 1.0)
    activity = model.run_drive(drive, STEP_MS)
    moved = activity.output_nats[0, :, 0]
    before = (activity.time_ms >= 450) & (activity.time_ms < LEADER_MS)
    return activity.time_ms - LEADER_MS, moved - moved[before].mean()


@pytest.mark.parametrize("channels", ALTERNATIVES)
@given(st.lists(st.floats(-2, 3), min_size=8, max_size=8), st.floats(-1, 3, allow_subnormal=False))
def test_out_is_minus_ln_p_of_the_leader_for_any_competitors_and_any_common_input(
    channels, drive, common
):
    """Exact while no cortical channel is silent; a silent one counts as one at 0 does."""
    table = anatomy.macaque(channels)
    drive = np.array(drive[:channels])
    leader = drive.argmax()
    want = minus_log_softmax(drive)[leader]
    activity = run(table, (drive + common)[None, None], engine="algebra", step_ms=1.0)
    y = activity.decoded_nats("ctx")[0, 0]
    silent = np.count_nonzero(y <= 0) * np.exp(-y[leader])
    low = table.readable_nats[0]
    assert activity.output_nats[0, 0, leader] == pytest.approx(max(want, low), abs=0.01 + silent)


@pytest.mark.parametrize("channels", ALTERNATIVES)
def test_two_competitors_apart_and_the_others_out_of_the_running_are_read_as_the_table_says(
    channels,
):
    """Silent competitors add (N - 2) / N exp(-rest) to the sum: 0.055 nats of OUT for N = 4."""
    bound = (channels - 2) / channels * np.exp(-2.2)
    for low_or_high in off_nats(anatomy.macaque(channels), 1):
        assert low_or_high == pytest.approx(bound, abs=0.01)
    assert np.abs(off_nats(anatomy.macaque(channels))).max() < 0.002


def test_delays_are_those_of_the_animal_and_synapses_have_the_times_of_their_receptors():
    """Delays: Lienard & Girard 2014. Times: AMPA 2 and GABA 4 ms, but for what is tuned."""
    delays = {"ctx->D1": 7, "ctx->D2": 7, "ctx->STN": 3, "D1->SNr": 11, "D2->GPe": 7}
    delays |= {"STN->GPe": 3, "STN->SNr": 3, "GPe->STN": 10, "GPe->SNr": 3}
    times = {"ctx->D1": 2, "ctx->D2": 2, "ctx->STN": 2, "D1->SNr": 4, "D2->GPe": 4, "GPe->SNr": 4}
    times |= {"STN->GPe": 3, "STN->SNr": 18, "GPe->STN": 12}
    for channels in ALTERNATIVES:
        rows = {p.name: p for p in anatomy.macaque(channels).projections if p.name in delays}
        assert {name: p.delay_ms for name, p in rows.items()} == delays
        assert {name: p.tau_ms for name, p in rows.items()} == times


@pytest.mark.parametrize("channels", ALTERNATIVES)
def test_it_rests_at_ln_n_and_says_that_it_reads_up_to_there(channels):
    table = anatomy.macaque(channels)
    np.testing.assert_allclose(out(table, np.zeros(channels)), np.log(channels), rtol=1e-9)
    assert table.readable_nats[1] == pytest.approx(np.log(channels))


@pytest.mark.parametrize("channels", ALTERNATIVES)
@pytest.mark.parametrize("lead", [0.0, 2.0])
@pytest.mark.parametrize("size", [-1.0, 1.0])
def test_a_step_of_all_channels_hardly_reaches_out(channels, lead, size):
    after_ms, moved = stepped(anatomy.macaque(channels), lead, size)
    later = after_ms >= 0
    assert moved[later].min() > -0.1
    assert moved[later].max() < 0.15
    assert (moved[later] > 0.03).sum() < 100
    assert np.abs(moved[after_ms >= LEADER_MS]).max() < 0.03


def test_without_its_parts_a_step_of_all_channels_does_reach_out():
    """What each part is for: a fast loop, cells of D1 that can follow a fall."""
    table = anatomy.macaque(2)
    linear = table.with_projection("STN", "GPe", transfer="linear", weight=1 - 1 / 2.2)
    linear = linear.with_population("GPe", bias_nats=1 - 2.2)
    after_ms, moved = stepped(table, 2.0, 1.0)
    held = (after_ms > 100) & (after_ms < 300)
    assert np.abs(stepped(linear, 2.0, 1.0)[1][held]).max() > 3 * np.abs(moved[held]).max()
    by = {"bias_nats": table.population("D1").bias_nats - 0.4}
    silent = table.with_population("D1", **by)
    assert stepped(silent, 0.0, -1.0)[1].min() < -0.3


PUBLISHED_HZ = {
    "FSI": (7.8, 14.0), "STN": (15.2, 22.8), "GPe": (55.7, 74.5), "SNr": (59.1, 79.5),
}  # fmt: skip
"""Lienard & Girard 2014."""


def test_two_alternatives_rest_at_the_published_rates():
    rates = resting_hz(anatomy.macaque(2))
    for name, (low, high) in PUBLISHED_HZ.items():
        assert low <= rates[name] <= high, name
    assert 0 < (rates["D1"] + rates["D2"]) / 2 <= 1


def test_without_half_the_dopamine_stn_beats_at_8_to_15_hz():
    hz = np.arange(4.0, 60.25, 0.25)
    power = rate_spectrum(anatomy.macaque(2).dopamine(0.5), "STN", hz)
    assert 8 <= hz[power.argmax()] <= 15


@pytest.mark.parametrize("channels", [2, 4])
def test_rates_where_a_decision_falls_are_those_of_the_animal(channels):
    drive = np.zeros((1, 1, channels))
    drive[0, 0, 0] = 2.0 + np.log(channels - 1)
    rates_hz = run(anatomy.macaque(channels), drive, engine="algebra", step_ms=1).rates_hz
    winner, losers = (lambda name: rates_hz[name][0, 0, 0]), (lambda name: rates_hz[name][0, 0, 1:])
    assert winner("ctx") < 60
    assert winner("D1") < 30
    assert losers("SNr").max() < 120
    assert losers("ctx").min() > 1.5
    assert winner("SNr") < resting_hz(anatomy.macaque(channels))["SNr"] - 20 < losers("SNr").min()


@pytest.mark.parametrize("channels", ALTERNATIVES)
def test_it_does_not_oscillate_at_rest_nor_where_it_decides(channels):
    table = anatomy.macaque(channels)
    drive = np.zeros(channels)
    drive[0] = 2.0
    for held in (np.zeros(channels), drive, drive + 1.0):
        assert stability.growth(table, held).real < 0


def test_endless_evidence_saturates_cortex_and_nothing_runs_away():
    evidence = Evidence(np.tile([4.0, -4.0], (1, 60, 1)), baseline=0.0, step_ms=50.0)
    model = BasalGanglia(anatomy.macaque(2), Population(noise=False), 0.55)
    trace = model.run_drive(model.drive(evidence), evidence.step_ms)  # too strong for ``activity``
    assert trace.rates_hz["ctx"].max() <= 0.8 + 16 * MOST_NATS + 1e-3
    assert trace.output_nats[0, -1].argmin() == 0


def test_each_channel_gets_its_own_evidence_and_the_control_takes_the_mean_off():
    evidence = separated_evidence(3, 5, 0.5, rng=np.random.default_rng(1), hypotheses=4)
    model = BasalGanglia(anatomy.macaque(4), "algebra", 0.5)
    raw = model.drive(evidence)
    other = evidence.log_likelihood.copy()
    other[..., 3] += 1
    changed = Evidence(other, baseline=0.0)
    np.testing.assert_array_equal(model.drive(changed)[..., :3], raw[..., :3])
    control = BasalGanglia(anatomy.macaque(4), "algebra", 0.5, centred=True).drive(evidence)
    np.testing.assert_allclose(control, raw - raw.mean(axis=2, keepdims=True), atol=1e-12)


def test_evidence_without_a_baseline_is_refused_with_what_it_could_be():
    evidence = Evidence(np.tile([-1.0, -3.0], (2, 4, 1)))
    with refused("baseline no baseline.*baseline=-2"):
        BasalGanglia(anatomy.macaque(2), "algebra", 0.5).drive(evidence)
    with_baseline = Evidence(evidence.log_likelihood, baseline=-2.0)
    drive = BasalGanglia(anatomy.macaque(2), "algebra", 0.5).drive(with_baseline)
    np.testing.assert_allclose(drive[:, -1], [[2.0, -2.0]] * 2)


@given(st.integers(0, 2**31), st.integers(2, 5), st.floats(-9, 9))
def test_what_channels_are_told_differs_by_the_evidence_between_them_alone(seed, channels, mean):
    """So that OUT can be -ln P whatever the readings say on the mean, and whichever is true."""
    rng = np.random.default_rng(seed)
    values = rng.normal(mean, 2, (3, 6, channels)) + rng.normal(0, 3, channels)
    evidence = Evidence(values, baseline=mean, prior=rng.dirichlet(np.full(channels, 3)))
    inputs, totals = evidence.own_totals, evidence.totals
    np.testing.assert_allclose(inputs - inputs[..., :1], totals - totals[..., :1], atol=1e-9)


@pytest.mark.parametrize("channels", [2, 4])
@pytest.mark.parametrize(
    ("make", "rises", "sigma", "hz"),
    [(anatomy.macaque, (2.1, 2.3), 6.4, 14.3), (anatomy.macaque_small, (1.5, 1.7), 5.14, 21)],
)
def test_the_loop_of_stn_and_gpe_alone_oscillates_above_some_sigma(
    make, rises, sigma, hz, channels
):
    """Why evidence can be too strong: the slow cells that inhibit cortex come too late for it."""
    calm, wild = stability_of_loop(make(channels), rises)
    assert sigma - 0.3 < calm[1] < sigma < wild[1] < sigma + 0.4
    assert calm[2] < 0 < wild[2]
    assert wild[3] == pytest.approx(hz, abs=0.5)


def test_a_loop_with_short_times_lets_a_circuit_follow_evidence_that_is_too_strong_for_it():
    table = anatomy.macaque_small(2)
    evidence = drawn(3.0, 2, 100)
    gain = table.default_gain
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        exact = decided(table, "algebra", evidence, gain, 0.82)
        circuits = {
            "small": table,
            "short": variants(table)["STN-GPe loop with times of 1 ms"],
            "default": anatomy.macaque(2),
        }
        shares = {
            name: late(decided(one, "rate", evidence, gain, 0.82), exact)
            for name, one in circuits.items()
        }
    assert shares["small"] > 0.1
    assert shares["short"] == shares["default"] == 0


@pytest.mark.parametrize("make", [anatomy.macaque, anatomy.macaque_small])
@pytest.mark.parametrize("channels", range(2, 9))
def test_out_is_minus_ln_p_where_it_is_read(make, channels):
    circuit = make(channels)
    assert failures(circuit) == []
    assert np.abs(off_nats(circuit)).max() <= (0.001 if make is anatomy.macaque else 0.0012)
    rest = out(circuit, np.zeros(channels))
    assert rest == pytest.approx(np.log(channels), abs=1e-9)


def test_an_acute_loss_of_stn_acts_as_the_theorem_says():
    circuit = anatomy.macaque(4)
    for lost in (0.1, 0.3, 0.5):
        shift = shift_nats(circuit.lesion("STN", lost), circuit)
        assert shift == pytest.approx(np.log1p(-lost), abs=1e-4)


def test_interneurons_take_from_d1_what_cortex_adds():
    """Without them, and with the weight that they restore, the circuit computes the same."""
    circuit = anatomy.macaque(2)
    weight, taken = circuit["ctx->D1"].weight, -circuit["FSI->D1"].weight
    without = circuit.scale("FSI", "D1", 0).scale("ctx", "D1", (weight - taken) / weight)
    d1 = without.population("D1")
    without = without.with_population("D1", bias_nats=d1.bias_nats + taken * circuit.rest_drive)
    for drive in ([1.0, -0.5], [0.0, 0.3]):
        np.testing.assert_allclose(out(circuit, drive), out(without, drive), atol=1e-9)


@pytest.mark.parametrize("make", [anatomy.macaque, anatomy.macaque_small])
def test_it_states_a_lead_for_every_number_of_alternatives_that_it_takes(make):
    most = make(2).most_channels
    leads = [make(channels).max_lead_nats for channels in range(2, most + 1)]
    assert np.isfinite(leads).all()
    assert np.diff(leads[2:]).max() < 0
