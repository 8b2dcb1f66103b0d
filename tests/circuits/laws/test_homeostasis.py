"""Homeostasis: biases that bring each population back to its own rate at rest."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from circuits import anatomy
from circuits.dynamics.fixed_point import rest_rates, solve, wired
from circuits.engines import run
from circuits.laws.homeostasis import biases
from tests.circuits.helpers import CLOSE, evidence

RATE_CELLS = ("bogacz_gurney", "appendix_b", "linear_gpe", "macaque")
CHANNELS = (2, 4, 8)


def rest_hz(circuit):
    return rest_rates(wired(circuit))


def own_biases(circuit):
    return {row.name: row.bias_nats for row in circuit.populations}


def pace(circuit):
    """Return W of each block: the total weight of its afferents, at least 1."""
    wiring = wired(circuit)
    each = np.abs(wiring.weight) @ (np.abs(wiring.deliver) * wiring.gain_hz_per_nat)
    return np.maximum(1.0, each.sum(axis=1))


def settled(edited, circuit, pace, step=0.1, steps=600):
    """Run the rule as dynamics, in tenths of its time constant; None if rates do not settle."""
    wiring, hz, moved = wired(edited), rest_hz(circuit), 0.0
    for _ in range(steps):
        shifted = replace(wiring, bias=wiring.bias + moved)
        error = pace * (hz - rest_rates(shifted)) / wiring.gain_hz_per_nat
        if np.abs(error).max() < 1e-6:
            ends = zip(wiring.rows, moved, strict=True)
            return {row.name: row.bias_nats + nats for row, nats in ends}
        moved = moved + step * error
    return None


@pytest.mark.parametrize("channels", CHANNELS)
@pytest.mark.parametrize("name", sorted(anatomy.CIRCUITS))
def test_a_circuit_that_was_not_edited_is_left_as_it_is(name, channels):
    circuit = anatomy.load_circuit(name, channels)
    assert biases(circuit, circuit) == pytest.approx(own_biases(circuit), abs=1e-12)
    assert circuit.compensate(circuit) == circuit


@given(
    name=st.sampled_from(RATE_CELLS),
    channels=st.sampled_from(CHANNELS),
    lesion=st.floats(0, 0.99),
    row=st.integers(0, 100),
    factor=st.floats(0.8, 1.2),
    gain=st.floats(0.8, 1.2),
    level=st.floats(0.6, 1.4),
)
@settings(max_examples=60)
def test_rates_at_rest_are_those_of_the_reference_after_any_edit(
    name, channels, lesion, row, factor, gain, level
):
    circuit = anatomy.load_circuit(name, channels)
    path = circuit.projections[row % len(circuit.projections)]
    cells = circuit.populations[row % len(circuit.populations)]
    edited = circuit.lesion("STN", lesion).scale(path.pair, factor)
    edited = edited.with_population(cells.name, gain_hz_per_nat=cells.gain_hz_per_nat * gain)
    edited = edited.dopamine(level)
    np.testing.assert_allclose(rest_hz(edited.compensate(circuit)), rest_hz(circuit), atol=CLOSE)


@pytest.mark.parametrize("channels", CHANNELS)
@pytest.mark.parametrize("lost", [0.1, 0.5, 0.9])
def test_what_is_lost_of_stn_does_not_show_in_out_once_rates_have_recovered(lost, channels):
    """With s the part of Sigma that is left, SNr hears w s + (1 - w) ln s, which moves with S.

    The loop gives ``ln s + w (s - ln s) = S + constant``: at every S, whatever was lost. Where
    losers' D1 or cortex is silent something of the common mode, which moves otherwise, is left:
    up to 0.0031 nats of the winner's OUT in these drives.
    """
    circuit = anatomy.macaque(channels)
    recovered = circuit.lesion("STN", lost).compensate()
    for scale, off in ((0.1, CLOSE), (0.4, 4e-3)):
        drive = scale * evidence(channels)
        wirings = wired(circuit), wired(recovered)
        rates = [wiring.rates(solve(wiring, drive)) for wiring in wirings]
        fire = rates[0][:, wirings[0].blocks_of("D1")].min(axis=1) > 0
        assert scale > 0.1 or fire.mean() > 0.7
        out = [wirings[0].activity(hz[:, wirings[0].blocks_of("SNr")], "SNr") for hz in rates]
        np.testing.assert_allclose(out[1][fire], out[0][fire], rtol=0, atol=CLOSE)
        np.testing.assert_allclose(out[1].min(axis=1), out[0].min(axis=1), rtol=0, atol=off)


@pytest.mark.parametrize("channels", CHANNELS)
@pytest.mark.parametrize(("lost", "name"), [(0.5, "SNr"), (1.0, "SNr"), (0.5, "GPe")])
def test_a_rebound_lifts_one_population_by_so_many_nats_of_its_activity(lost, name, channels):
    """What others get from it is made good."""
    circuit = anatomy.macaque(channels)
    compensated = circuit.lesion("STN", lost).compensate(rebound_nats={name: 0.2})
    change = rest_hz(compensated) - rest_hz(circuit)
    expected = np.zeros_like(change)
    expected[wired(circuit).blocks_of(name)] = 0.2 * circuit.population(name).gain_hz_per_nat
    np.testing.assert_allclose(change, expected, atol=CLOSE)


@pytest.mark.parametrize("engine", ["rate", "population"])
@pytest.mark.parametrize("lost", [0.5, 1.0])
def test_a_chronic_lesion_starts_at_its_own_rest_and_stays_there(lost, engine):
    """The slow cells of GPe take seconds: from the intact rest they would be far off."""
    circuit = anatomy.macaque(4).lesion("STN", lost).compensate()
    options = {"noise": False, "seed": 1} if engine == "population" else {}
    silence = np.zeros((1, 4, 4))
    out = run(circuit, silence, engine=engine, step_ms=250.0, **options).output_nats
    np.testing.assert_allclose(out, np.log(4), atol=0.02)
    assert circuit.chronic
    assert not circuit.unlesioned.chronic


@pytest.mark.parametrize("channels", [2, pytest.param(4, marks=pytest.mark.validate), 8])
@pytest.mark.parametrize(
    ("name", "edit"),
    [
        ("bogacz_gurney", "lesion STN 30%"), ("bogacz_gurney", "scale ctx->STN 0.8"),
        ("macaque", "lesion STN 30%"), ("macaque", "scale ctx->D1 0.8"),
        ("macaque", "scale STN->SNr 1.2"), ("spiking_msprt", "scale STN->SNr 1.2"),
    ],
)  # fmt: skip
def test_the_rule_ends_where_the_closed_form_says(name, edit, channels):
    circuit = anatomy.load_circuit(name, channels)
    edited = circuit.edited(edit)
    end = settled(edited, circuit, pace(circuit))
    assert end == pytest.approx(biases(edited, circuit), abs=1e-4)


def test_channels_that_differ_have_no_closed_form():
    circuit = anatomy.macaque(2)
    edited = circuit.scale("ctx->D1", 1.1, channel=0)
    with pytest.raises(ValueError, match=r"^D1 has one bias but a different resting input in each"):
        edited.compensate(circuit)


def test_biases_that_all_move_at_one_speed_oscillate():
    """Cortex, STN and the slow cells of GPe are a loop of three with a gain above 8."""
    circuit = anatomy.macaque(4)
    edited = circuit.lesion("STN", 0.1)
    assert settled(edited, circuit, pace(circuit)) is not None
    assert settled(edited, circuit, np.ones_like(pace(circuit))) is None


def test_a_transfer_without_an_inverse_takes_the_input_of_the_reference():
    bent = "s_minus_log_s"
    circuit = anatomy.bogacz_gurney(2).with_population("GPe", transfer=bent)
    circuit = circuit.with_projection("STN->GPe", transfer="linear")
    edited = circuit.scale("STN->GPe", 0.9)
    np.testing.assert_allclose(rest_hz(edited.compensate(circuit)), rest_hz(circuit), atol=CLOSE)
    with pytest.raises(ValueError, match=f"no input to its transfer '{bent}' is known"):
        edited.compensate(circuit, rebound_nats={"GPe": 0.1})


@given(
    name=st.sampled_from(("spiking_msprt", "macaque")),
    channels=st.sampled_from(CHANNELS),
    bias=st.floats(-3, 1),
    weights=st.tuples(*[st.floats(0, 0.3)] * 3),
    lesion=st.floats(0, 0.3),
)
@settings(max_examples=30)
def test_rows_that_are_added_with_rest_kept_leave_the_rates_of_all_that_was_there(
    name, channels, bias, weights, lesion
):
    """The new nucleus itself rests where these take it, whatever it sends and hears."""
    table = anatomy.load_circuit(name, channels).lesion("STN", lesion)
    heard, sent, self_weight = weights
    rows = (
        f"TRN like=D2 bias_nats={bias} receptor='' baseline_hz=5",
        f"STN->TRN weight={heard}",
        f"TRN->GPe weight=-{sent}",
        f"TRN->TRN weight=-{self_weight} delay_ms=2",
        f"D2->SNr weight=-{sent}",
    )
    kept = table.edited(*(f"add {row}" for row in rows), "keep rest")
    before, after = rest_hz(table), rest_hz(kept)
    np.testing.assert_allclose(after[: len(before)], before, atol=CLOSE)
    assert kept.chronic == table.chronic
    assert kept.population("TRN").bias_nats == bias
    names = [row.name for row in table.populations]
    assert [row.name for row in kept.populations] == [*names, "TRN"]
