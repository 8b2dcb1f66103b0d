"""The table: edits return new circuits, and what makes no sense is refused in one sentence."""

from dataclasses import replace

import numpy as np
import pytest

from circuits import anatomy
from circuits.anatomy import CIRCUITS, load_circuit
from circuits.declaration.edits import Edits
from circuits.differences import check_edits, differences
from circuits.dynamics.fixed_point import rest_rates, wired
from circuits.dynamics.wiring import wire
from circuits.errors import EditWarning
from tests.circuits.helpers import run_algebra
from tests.helpers import refused, unwarned
from tests.strategies.edits import WRONG

EDITS = (
    "lesion STN 30%", "clamp GPe", "scale STN->GPe 0.5", "cut STN->GPe 50%", "cut D1->SNr[1] 50%",
    "scale D1->SNr[1] 0.5", "lesion STN[1] 30%", "dopamine 0.8", "set STN->GPe.delay_ms 7",
    "set STN.neurons 7", "add TRN like=STN",
)  # fmt: skip


@pytest.mark.parametrize("edit", EDITS)
def test_an_edit_returns_a_new_circuit_and_leaves_the_old(circuit, edit):
    before = repr(circuit)
    edited = circuit.edited(edit)
    assert edited != circuit
    assert repr(circuit) == before
    assert circuit.edited(edit) == edited


def test_edits_that_change_nothing_return_the_circuit(circuit):
    assert circuit.lesion("STN", 0) is circuit
    assert circuit.scale("STN->GPe", 1) is circuit
    assert circuit.cut("STN->GPe", 0) is circuit
    assert circuit.cut("STN->GPe", 0, channel=0) is circuit
    assert circuit.scale("STN->GPe", 1, channel=0) is circuit
    assert circuit.dopamine(1) is circuit
    assert circuit.with_channels(circuit.channels).about == circuit.about


def test_cells_of_all_nuclei_and_pathways_between_them_are_edited_and_no_others():
    small = anatomy.spiking_msprt().with_neurons(7).with_heterogeneity(0.1).with_connections(0.25)
    rates = [row.name for row in small.populations if (row.neurons, row.heterogeneity) != (7, 0.1)]
    dense = [p.name for p in small.projections if p.probability != 0.25]
    assert (rates, dense) == (["common"], ["common->ctx", "STN->common"])


def test_factors_of_channels_multiply_and_all_alike_are_those_of_the_pathway(circuit):
    each, drive = circuit.with_channels(3), np.array([[[0.4, 0.1, -0.5]]])
    whole = each.scale("D1->SNr", 0.9)
    for channel in range(3):
        each = each.scale("D1->SNr", 0.5, channel).scale("D1->SNr", 1.8, channel)
        assert not each.exact
    assert each.projection("D1->SNr").factors == (0.9, 0.9, 0.9)
    one, other = (run_algebra(c, drive).output_nats for c in (each, whole))
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)


def test_a_lesion_in_one_channel_takes_the_tone_of_that_channel_alone():
    table = anatomy.macaque(3)
    lost = table.lesion("GPe", 0.25, channel=1).lesion("GPe", 0.5, channel=1)
    assert lost.intact_of("GPe").tolist() == [1, 0.375, 1]
    assert lost.lesion("GPe", 0.5).intact_of("GPe").tolist() == [0.5, 0.1875, 0.5]
    assert lost.unlesioned == table
    intact, part = wire(table), wire(lost)
    left = np.where(np.arange(intact.blocks) == intact.blocks_of("GPe")[1], 0.375, 1)
    np.testing.assert_allclose(part.deliver, intact.deliver * left, rtol=1e-12)
    np.testing.assert_array_equal(part.constant, intact.constant)
    each = table
    for channel in range(3):
        each = each.lesion("GPe", 0.25, channel=channel)
    whole = table.lesion("GPe", 0.25)
    np.testing.assert_allclose(wire(each).deliver, wire(whole).deliver, rtol=1e-12)


def test_a_replaced_lesion_in_one_channel_leaves_the_rest_and_takes_the_changes():
    table = anatomy.spiking_msprt(2)
    lost = table.clamp("GPe", channel=0)
    np.testing.assert_allclose(rest_rates(wired(lost)), rest_rates(wired(table)), atol=1e-9)
    assert lost.clamp("GPe", channel=1).unlesioned == table


@pytest.mark.parametrize(("field", "call", "values"), WRONG)
def test_what_makes_no_sense_is_refused_by_the_name_of_its_field(field, call, values):
    for value in values:
        with refused(field):
            call(anatomy.spiking_msprt(), value)


@pytest.mark.parametrize("level", [0.0, 0.5, 1.7])
def test_receptors_at_terminals_scale_their_pathway_and_keep_rest(level):
    """D1: times the level, D2: times 2 less it; the rates at rest stay, bent pathways too."""
    circuit = anatomy.macaque(3)
    assert {p.name for p, row in circuit.receptors() if row is p} == {"STN->GPe", "GPe->STN"}
    changed = circuit.dopamine(level)
    for p, old in zip(changed.projections, circuit.projections, strict=True):
        d2 = p.name in ("STN->GPe", "GPe->STN", "ctx->D2")
        factor = 2 - level if d2 else level if p.name == "ctx->D1" else 1
        assert p.weight == pytest.approx(factor * old.weight, rel=1e-14), p.name
    rest, moved = (run_algebra(table, np.zeros((1, 1, 3))) for table in (circuit, changed))
    for name, rates in rest.rates_hz.items():
        np.testing.assert_allclose(moved.rates_hz[name], rates, atol=1e-9, err_msg=name)


def test_receptors_of_a_pathway_go_before_those_of_the_cells_that_it_reaches():
    circuit = anatomy.macaque().with_projection("ctx->D1", receptor="D2")
    weight = circuit.projection("ctx->D1").weight
    assert circuit.dopamine(0.5).projection("ctx->D1").weight == 1.5 * weight


def test_an_edit_of_what_the_circuit_computes_takes_the_claim_to_exactness_away():
    exact = anatomy.bogacz_gurney()
    times = "set STN.tau_ms 3", "set STN.neurons 2", "set STN->GPe.delay_ms 3", "dopamine 1"
    assert exact.with_channels(7).edited(*times).exact
    for edit in (
        "lesion STN 10%", "scale STN->GPe 0.5", "dopamine 1.1", "set STN.transfer linear",
        "set STN->SNr.pattern channel", "add TRN like=STN",
    ):  # fmt: skip
        assert not exact.edited(edit).exact
    assert not anatomy.linear_gpe().exact
    assert not anatomy.spiking_msprt().exact


@pytest.mark.parametrize(("factor", "neurons"), [(0.5, 150), (2, 600), (1.004, 301), (1e-6, 1)])
def test_a_multiple_of_the_cells_is_rounded_and_at_least_one(factor, neurons):
    circuit = anatomy.spiking_msprt().with_neurons_times(factor)
    assert {row.neurons for row in circuit.populations if row.spiking} == {neurons}


def test_the_largest_lead_is_kept_by_edits_that_leave_times_as_they_are_and_cleared_by_others():
    table = anatomy.macaque(2)
    most = table.max_lead_nats
    assert np.isfinite(most)
    for kept in (
        "lesion GPe 10%", "scale ctx->D1 1.1", "dopamine 0.9", "set STN.bias_nats -2",
        "add D1->GPe weight=-0.1", "neurons 600",
    ):  # fmt: skip
        assert table.edited(kept).max_lead_nats == most
    assert table.with_channels(2).with_neurons_times(2).max_lead_nats == most
    times = "set STN->GPe.delay_ms 4", "set GPe->STN.tau_ms 3", "set GPe_ctx.tau_ms 500"
    cleared = [*(table.edited(edit) for edit in times), table.with_channels(4)]
    assert {edited.max_lead_nats for edited in cleared} == {np.inf}


def test_a_circuit_is_a_mapping_of_its_rows():
    table = anatomy.load_circuit("macaque")
    assert table["STN"] == table.population("STN")
    assert table["STN->GPe"] == table.projection("STN->GPe")
    assert [row.name for row in table.values()] == list(table)
    assert len(table) == len(table.populations) + len(table.projections)
    assert "STN" in table
    assert "STN->D1" not in table
    with pytest.raises(KeyError, match="GPe"):
        table["GPE"]
    assert table == replace(table) != dict(table)
    assert hash(table) == hash(replace(table))


@pytest.mark.parametrize(
    "edit",
    [
        "set STN.tau_ms 0.02", "set STN->GPe.tau_ms 0.003", "set STN->GPe.delay_ms 0.004",
        "set GPe.cell.tau_ms 0.01", "set STN->GPe.tau_ms 20000", "set STN.baseline_hz 500",
    ],
)  # fmt: skip
def test_numbers_far_outside_physiology_are_warned_of(edit):
    name = edit.split(" ")[1].split(".", 1)[1].replace(".", "_")
    with pytest.warns(EditWarning, match=name):
        load_circuit("spiking_msprt").edited(edit)


def test_no_shipped_table_is_outside_physiology():
    with unwarned():
        for name in CIRCUITS:
            load_circuit(name, 3)


@pytest.mark.parametrize(
    "lines",
    [
        (), ("set STN.bias_nats -1.9", "set D1->SNr.weight -0.9"), ("set STN.cell Rate",),
        ("set STN.cell.cv 0.25", "set SNr.heterogeneity 0.1"),
        ("scale STN->GPe 0.5", "dopamine 0.9"),
        ("add D1->GPe weight=-0.1 delay_ms=4 tau_ms=3", "set ctx->D1.delay_ms 8"),
        ("add TRN like=STN bias_nats=-1", "add TRN->GPe weight=0.2"),
        ("lesion STN 10%",), ("compensate", "lesion GPe 20%"),
    ],
)  # fmt: skip
def test_the_edits_that_are_found_do_what_was_done(lines):
    first = load_circuit("macaque", 3)
    second = first.edited(*lines)
    edited = first.edited(*differences(first, second))
    for one, other in ((edited.populations, second.populations),
                       (edited.projections, second.projections)):  # fmt: skip
        assert [replace(row, cite="") for row in one] == [replace(row, cite="") for row in other]
    assert bool(differences(first, second)) == bool(lines)


@pytest.mark.parametrize(
    "line",
    ["set STN->GPe.delay_ms 4", "set GPe.cell.tau_ms 12", "set STN.tau_ms 7", "lesion STN 1%"],
)
def test_rates_feel_times_and_lesions_and_spikes_every_number(line):
    check_edits(Edits([line]), "rate")
    check_edits(Edits([line, "set STN.cell.cv 0.1", "neurons 7", "connections 0.5"]), "spikes")
