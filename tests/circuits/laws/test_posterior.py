"""How far OUT lies off -ln P: by nothing in exact tables, by the bias of a biased read-out."""

import re
from dataclasses import replace

import numpy as np
import pytest

from circuits import anatomy
from circuits.laws.posterior import off_nats
from tests.circuits.helpers import run_algebra


@pytest.mark.parametrize("make", [anatomy.bogacz_gurney, anatomy.appendix_b])
@pytest.mark.parametrize(
    ("channels", "competitors"), [(2, None), (2, 1), (5, None), (5, 1), (5, 3)]
)
def test_out_of_an_exact_table_is_off_by_nothing(make, channels, competitors):
    for circuit in (make(channels), replace(make(channels), centred=True, max_deficit_nats=40.0)):
        assert off_nats(circuit, competitors) == pytest.approx((0, 0), abs=1e-8)


@pytest.mark.parametrize("nats", [0.05, 0.2])
def test_out_is_off_by_as_much_as_the_read_out_is_biased(nats):
    table = anatomy.bogacz_gurney(3)
    bias = table.population("SNr").bias_nats + nats
    offsets = off_nats(table.with_population("SNr", bias_nats=bias))
    assert offsets == pytest.approx((nats, nats), abs=1e-8)


def test_competitors_beyond_the_reach_of_a_centred_drive_are_cut_there():
    """One competitor is level with the leader: OUT is ln 2. The third counts as 2 nats behind."""
    table = replace(anatomy.bogacz_gurney(3), centred=True, max_deficit_nats=2.0)
    table = replace(table, readable_nats=(np.log(2) - 1e-9, np.log(2)))
    offsets = off_nats(table, 1)
    drive = np.array([0.0, 0.0, -2.0])
    out = run_algebra(table, (drive - drive.mean())[None, None]).output_nats[0, 0, 0]
    assert offsets == pytest.approx((out - np.log(2),) * 2, abs=1e-6)
    assert offsets[0] == pytest.approx(np.log(2 + np.exp(-2)) - np.log(2), abs=1e-6)


@pytest.mark.parametrize("competitors", [0, 3])
def test_as_many_competitors_as_channels_or_no_competitor_are_refused(competitors):
    with pytest.raises(
        ValueError, match=re.escape(f"competitors must be within 1..2, got {competitors}")
    ):
        off_nats(anatomy.bogacz_gurney(3), competitors)


def test_a_circuit_in_saliences_has_no_distance_from_a_posterior():
    with pytest.raises(ValueError, match="not nats: OUT as -ln P has no meaning there"):
        off_nats(anatomy.gpr(3))
