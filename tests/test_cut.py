"""Axons that are cut: the target lacks what they signal and their tone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from circuits import anatomy
from circuits.dynamics.fixed_point import resting_hz, solve, wired
from circuits.engines import run
from tests.circuits.helpers import run_algebra

LESIONED = ("D1", "D2", "STN", "GPe")
SPIKES = {"step_ms": 20.0, "seed": 3, "settle_ms": 20.0}


def state(circuit, drive):
    wiring = wired(circuit)
    return wiring.rates(solve(wiring, drive))


def paths_of(circuit, name):
    return [p for p in circuit.projections if p.source == name]


@settings(max_examples=40)
@given(
    st.sampled_from(["macaque", "spiking_msprt", "appendix_b", "gpr"]),
    st.sampled_from(LESIONED),
    st.floats(0, 0.5),
    st.sampled_from([None, 1]),
)
def test_a_nucleus_whose_axons_are_all_cut_by_a_fraction_is_lesioned_by_it(
    name, nucleus, fraction, channel
):
    """In one channel of the source where its pathways stay within channels."""
    table = anatomy.load_circuit(name, 3)
    drive = np.array([[0.0, 0.0, 0.0], [0.6, 0.2, -0.3]])
    by_channel = all(p.pattern == "channel" for p in paths_of(table, nucleus))
    channel = channel if by_channel and not table.population(nucleus).pooled else None
    cut = table
    for p in paths_of(table, nucleus):
        cut = cut.cut(p.pair, fraction, channel)
    lesioned = table.lesion(nucleus, fraction, channel=channel)
    np.testing.assert_allclose(state(cut, drive), state(lesioned, drive), atol=1e-6)


def test_half_of_the_axons_take_the_tone_and_half_the_weight_leaves_it():
    table = anatomy.macaque(2)
    scaled, cut = table.scale("GPe->STN", 0.5), table.cut("GPe->STN", 0.5)
    before = resting_hz(table)
    assert resting_hz(scaled) == pytest.approx(before, abs=1e-9)
    weight, tone = table.projection("GPe->STN").weight, 58 / 20
    by_hand = table.scale("GPe->STN", 0.5).with_population(
        "STN", bias_nats=table.population("STN").bias_nats - 0.5 * weight * tone
    )
    assert resting_hz(cut) == pytest.approx(resting_hz(by_hand), abs=1e-9)
    assert resting_hz(cut)["SNr"] != pytest.approx(before["SNr"], abs=1)
    assert resting_hz(cut.compensate()) == pytest.approx(before, abs=1e-6)


def test_cuts_add_up_are_undone_as_lesions_are_and_leave_a_circuit_that_was_exact():
    table = anatomy.bogacz_gurney(3)
    cut = table.cut("GPe->STN", 0.5).cut("GPe->STN", 0.5, channel=1)
    np.testing.assert_allclose(cut.axons_of(cut.projection("GPe->STN")), [0.5, 0.25, 0.5])
    assert cut.unlesioned.projections == table.projections
    assert table.exact
    assert not cut.exact
    assert table.cut("GPe->STN", 0.0) is table


@pytest.mark.parametrize("sparse", [False, True])
def test_engines_cut_the_same_axons_in_one_channel(sparse):
    table = anatomy.macaque(2).with_neurons(20)
    table = table.with_connections(0.5) if sparse else table
    for path in ("GPe->STN", "STN->GPe", "D1->SNr"):
        table = table.cut(path, 0.2, channel=1)
    drive = np.array([[[0.0, 0.0], [1.0, -0.5]]])
    plain, compiled = (run(table, drive, engine=e, **SPIKES) for e in ("plain", "spikes"))
    for name in ("STN", "GPe", "SNr"):
        np.testing.assert_allclose(plain.rates_hz[name], compiled.rates_hz[name], atol=0.02)


def test_populations_and_rates_settle_where_the_fixed_point_of_a_cut_is():
    table = anatomy.macaque(2).cut("GPe->STN", 0.2).cut("STN->GPe", 0.1, channel=0)
    drive = np.repeat([[[0.4, -0.2]]], 80, axis=1)
    held = run(table, drive[:, :1], engine="algebra", step_ms=50.0).output_nats[0, 0]
    for engine, more in (("rate", {}), ("population", {"noise": False, "laws": "lines"})):
        settled = run(table, drive, engine=engine, step_ms=50.0, **more).output_nats[0, -1]
        np.testing.assert_allclose(settled, held, atol=0.01)


@pytest.mark.parametrize("engine", ["algebra", "rate", "spikes"])
def test_activity_of_a_silenced_channel_is_0_and_of_all_others_that_without_its_axons(engine):
    """Decisions are the same to the last bit; the nucleus itself shows neither rates nor spikes."""
    table = anatomy.spiking_msprt(2).with_neurons_times(0.1)
    drive = np.array([[[0.0, 0.0], [0.4, -0.4]]])
    more = {"step_ms": 20.0} if engine == "algebra" else SPIKES
    more = {**more, "spikes": ("GPe", "STN")} if engine == "spikes" else more
    cut = table
    for p in paths_of(table, "GPe"):
        cut = cut.cut(p.pair, 1.0)
    tables = cut, table.lesion("GPe", 1.0), table.lesion("STN", 1.0, channel=1)
    by_axons, silenced, half = (run(each, drive, engine=engine, **more) for each in tables)
    np.testing.assert_array_equal(silenced.output_nats, by_axons.output_nats)
    np.testing.assert_array_equal(silenced.rates_hz["STN"], by_axons.rates_hz["STN"])
    assert by_axons.rates_hz["GPe"].any()
    assert not silenced.rates_hz["GPe"].any()
    assert not half.rates_hz["STN"][..., 1].any()
    assert half.rates_hz["STN"][..., 0].any()
    assert half.rates_hz["STN"].dtype == by_axons.rates_hz["STN"].dtype
    if engine == "spikes":
        assert len(by_axons.spikes["GPe"]) > len(silenced.spikes["GPe"]) == 0
        assert set(half.spikes["STN"]["channel"]) == {0}


def test_a_clamped_nucleus_is_shown_at_its_resting_rate():
    table = anatomy.spiking_msprt(2)
    drive = np.array([[[1.0, -1.0]]])
    both = (run_algebra(each, drive) for each in (table, table.clamp("STN")))
    free, held = (activity.rates_hz["STN"] for activity in both)
    np.testing.assert_allclose(held, resting_hz(table)["STN"])
    assert np.ptp(free) > 1
