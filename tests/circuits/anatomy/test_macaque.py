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
from circuits.dynamics.fixed_point import off_nats
from circuits.engines import Population, run
from circuits.laws import stability
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
    """Delays: Lienard & Girard 2014. Times: AMPA and GABA 4 ms, but for what is tuned."""
    delays = {"ctx->D1": 7, "ctx->D2": 7, "ctx->STN": 3, "D1->SNr": 11, "D2->GPe": 7}
    delays |= {"STN->GPe": 3, "STN->SNr": 3, "GPe->STN": 10, "GPe->SNr": 3}
    tuned = {"D1->SNr": 6, "STN->GPe": 3, "STN->SNr": 19}
    for channels in ALTERNATIVES:
        rows = {p.name: p for p in anatomy.macaque(channels).projections if p.name in delays}
        assert {name: p.delay_ms for name, p in rows.items()} == delays
        assert {name: p.tau_ms for name, p in rows.items()} == dict.fromkeys(delays, 4) | tuned


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
    assert moved[later].min() > -0.08
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


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("ctx", 5, 25 + 1e-9),
        ("D1", 2, 6.1),
        ("D2", 2, 6),
        ("STN", 10, 25),
        ("GPe", 40, 75),
        ("SNr", 30, 80),
    ],
)
@pytest.mark.parametrize("channels", [2, 4])
def test_rates_at_rest_are_those_of_the_animal(channels, name, low, high):
    rest = run(anatomy.macaque(channels), np.zeros((1, 1, channels)), engine="algebra", step_ms=1)
    assert low <= rest.rates_hz[name][0, 0].min() <= rest.rates_hz[name].max() <= high


@pytest.mark.parametrize("channels", [2, 4])
def test_rates_where_a_decision_falls_are_those_of_the_animal(channels):
    drive = np.zeros((1, 1, channels))
    drive[0, 0, 0] = 2.0 + np.log(channels - 1)
    rates_hz = run(anatomy.macaque(channels), drive, engine="algebra", step_ms=1).rates_hz
    winner, losers = (lambda name: rates_hz[name][0, 0, 0]), (lambda name: rates_hz[name][0, 0, 1:])
    assert winner("ctx") < 60
    assert winner("D1") < 30
    assert losers("SNr").max() < 110
    assert losers("ctx").min() > 1.5
    assert winner("SNr") < rates_hz["SNr"][0, 0, 1] / 2


@pytest.mark.parametrize("channels", ALTERNATIVES)
def test_it_does_not_oscillate_at_rest_nor_where_it_decides(channels):
    table = anatomy.macaque(channels)
    drive = np.zeros(channels)
    drive[0] = 2.0
    for held in (np.zeros(channels), drive, drive + 1.0):
        assert stability.is_stable(table, held)


def test_endless_evidence_saturates_cortex_and_nothing_runs_away():
    evidence = Evidence(np.tile([4.0, -4.0], (1, 60, 1)), baseline=0.0, step_ms=50.0)
    model = BasalGanglia(anatomy.macaque(2), Population(noise=False), 0.55)
    trace = model.run_drive(model.drive(evidence), evidence.step_ms)  # too strong for ``activity``
    assert trace.rates_hz["ctx"].max() <= 0.8 + 11 * MOST_NATS + 1e-3
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
def test_the_loop_of_stn_and_gpe_alone_oscillates_above_a_sigma_of_5_1(channels):
    """Why evidence can be too strong: the slow cells that inhibit cortex come too late for it."""
    table = anatomy.macaque(channels)
    calm, wild = stability_of_loop(table, (1.5, 1.7))
    assert 4.9 < calm[1] < 5.144 < wild[1] < 5.5
    assert calm[2] < 0 < wild[2]
    assert wild[3] == pytest.approx(21, abs=0.5)


def test_a_loop_with_short_times_lets_the_circuit_follow_evidence_that_is_too_strong_for_it():
    table = anatomy.macaque(2)
    evidence = drawn(3.0, 2, 100)
    gain = table.default_gain
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        exact = decided(table, "algebra", evidence, gain, 0.82)
        shares = {
            name: late(decided(one, "rate", evidence, gain, 0.82), exact)
            for name, one in variants(table).items()
            if name in ("unedited", "STN-GPe loop with times of 1 ms")
        }
    assert shares["unedited"] > 0.1
    assert shares["STN-GPe loop with times of 1 ms"] == 0
