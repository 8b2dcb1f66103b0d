"""The table of spiking cells that computes the MSPRT: what its own text says of its rates."""

import numpy as np
import pytest

from circuits import anatomy
from circuits.engines import run


def held(channels, lead):
    """Return a circuit's activity while one channel leads, with zero mean over channels."""
    drive = np.zeros((1, 1, channels))
    drive[0, 0, 0] = lead
    return run(anatomy.spiking_msprt(channels), drive - drive.mean(), engine="algebra", step_ms=1.0)


@pytest.mark.parametrize("channels", [2, 4, 8])
def test_without_evidence_every_channel_has_the_same_room_and_striatum_is_quiet(channels):
    """Sigma rests at 2.2 whatever N, and so does y; STN shares it between channels."""
    activity = held(channels, 0.0)
    assert activity.decoded_nats("ctx") == pytest.approx(2.2, abs=0.05)
    gain = anatomy.spiking_msprt(channels).population("STN").gain_hz_per_nat
    assert activity.rates_hz["STN"].sum() / gain == pytest.approx(2.2, abs=0.05)
    assert not activity.rates_hz["D1"].any()
    assert activity.rates_hz["D2"].max() < 5


@pytest.mark.parametrize("channels", [2, 4, 8])
def test_losers_fall_silent_at_once_a_second_and_the_winner_disinhibits(channels):
    rates_hz = held(channels, 5.0).rates_hz
    assert rates_hz["ctx"][0, 0, 1:].max() <= 1
    assert rates_hz["D1"][0, 0, 1:].max() == 0
    assert rates_hz["SNr"][0, 0, 0] < rates_hz["SNr"][0, 0, 1:].min() / 4
