"""The macaque's table: OUT is -ln P of raw evidence, what channels share is cancelled inside."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bgmodel.evidence import Evidence, minus_log_softmax
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.simulated_evidence import separated_evidence
from circuits import anatomy
from circuits.dynamics.fixed_point import off_nats, resting_hz
from circuits.engines import Populations, run
from circuits.laws.family import failures
from circuits.laws.fluctuation import rate_spectrum
from circuits.laws.stability import ringing
from tests.helpers import refused

ALTERNATIVES = (2, 4, 8)
LEADER_MS, STEP_MS = 500, 50.0


def out(table, drive):
    drive = np.asarray(drive)[None, None]
    return run(table, drive, engine="algebra", step_ms=1.0).output_nats[0, 0]


def stepped(table, lead, size):
    """OUT of the leader, ms by ms, less what it was before all channels rise by a size."""
    drive = np.zeros((1, 40, table.channels))
    drive[0, :, 0] = lead
    drive[0, 10:] += size
    model = BasalGanglia(table, Populations(noise=False), 1.0)
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
@pytest.mark.parametrize("lead", [0.0, 2.0])
@pytest.mark.parametrize("size", [-1.0, 1.0])
def test_a_step_of_all_channels_hardly_reaches_out(channels, lead, size):
    after_ms, moved = stepped(anatomy.macaque(channels), lead, size)
    later = after_ms >= 0
    assert moved[later].min() > -0.1
    assert moved[later].max() < 0.15
    assert (moved[later] > 0.03).sum() < 100
    assert np.abs(moved[after_ms >= LEADER_MS]).max() < 0.03


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


@pytest.mark.parametrize("channels", ALTERNATIVES)
def test_it_does_not_oscillate_at_rest_nor_where_it_decides(channels):
    table = anatomy.macaque(channels)
    drive = np.zeros(channels)
    drive[0] = 2.0
    for held in (np.zeros(channels), drive, drive + 1.0):
        assert np.isfinite(ringing(table, held)[0])


@pytest.mark.parametrize("make", [anatomy.macaque, anatomy.macaque_small])
@pytest.mark.parametrize("channels", range(2, 9))
def test_out_is_minus_ln_p_where_it_is_read(make, channels):
    circuit = make(channels)
    assert failures(circuit) == []
    assert np.abs(off_nats(circuit)).max() <= (0.001 if make is anatomy.macaque else 0.0012)
    rest = out(circuit, np.zeros(channels))
    assert rest == pytest.approx(np.log(channels), abs=1e-9)


def test_each_channel_gets_its_own_evidence():
    evidence = separated_evidence(3, 5, 0.5, rng=np.random.default_rng(1), hypotheses=4)
    model = BasalGanglia(anatomy.macaque(4), "algebra", 0.5)
    raw = model.drive(evidence)
    other = evidence.log_likelihood.copy()
    other[..., 3] += 1
    changed = Evidence(other, baseline=0.0)
    np.testing.assert_array_equal(model.drive(changed)[..., :3], raw[..., :3])


def test_evidence_without_a_baseline_is_refused_with_what_it_could_be():
    evidence = Evidence(np.tile([-1.0, -3.0], (2, 4, 1)))
    with refused("baseline no baseline.*baseline=-2"):
        BasalGanglia(anatomy.macaque(2), "algebra", 0.5).drive(evidence)
    with_baseline = Evidence(evidence.log_likelihood, baseline=-2.0)
    drive = BasalGanglia(anatomy.macaque(2), "algebra", 0.5).drive(with_baseline)
    np.testing.assert_allclose(drive[:, -1], [[2.0, -2.0]] * 2)
