"""The table: edits return new circuits, and what makes no sense is refused in one sentence."""

from dataclasses import replace

import numpy as np
import pytest

from circuits import anatomy
from circuits.anatomy import CIRCUITS
from circuits.anatomy import load_circuit as named
from circuits.cells import Lif, Rate
from circuits.circuit import Circuit
from circuits.declaration.rows import Population, Projection
from circuits.declaration.table_writer import digest
from circuits.dynamics.fixed_point import rest_rates, wired
from circuits.dynamics.wiring import wire
from circuits.errors import EditWarning
from tests.circuits.helpers import run_algebra
from tests.helpers import refused, unwarned
from tests.strategies.edits import WRONG

EDITS = {
    "lesion": lambda c: c.lesion("STN", 0.3),
    "clamped lesion": lambda c: c.clamp("GPe"),
    "weight": lambda c: c.scale("STN->GPe", 0.5),
    "axons": lambda c: c.cut("STN->GPe", 0.5),
    "axons of one channel": lambda c: c.cut("D1->SNr", 0.5, channel=1),
    "one channel": lambda c: c.scale("D1->SNr", 0.5, channel=1),
    "lesion in one channel": lambda c: c.lesion("STN", 0.3, channel=1),
    "dopamine": lambda c: c.dopamine(0.8),
    "delay": lambda c: c.with_projection("STN->GPe", delay_ms=7),
    "time constant": lambda c: (
        c.with_cell("STN", tau_ms=7)
        if c.population("STN").cell.hears == "nats"  # the membrane filters
        else c.with_population("STN", tau_ms=7)
    ),
    "neurons": lambda c: c.with_population("STN", neurons=7),
    "channels": lambda c: c.with_channels(5),
    "row": lambda c: c.with_rows(Population("TRN", c.population("STN").cell)),
}


@pytest.mark.parametrize("edit", EDITS.values(), ids=list(EDITS))
def test_an_edit_returns_a_new_circuit_and_leaves_the_old(circuit, edit):
    before = repr(circuit)
    edited = edit(circuit)
    assert edited != circuit
    assert repr(circuit) == before
    assert edit(circuit) == edited


def test_a_circuit_is_one_line_that_tells_two_apart():
    one = anatomy.spiking_msprt()
    line = repr(one)
    assert line.startswith("Circuit(spiking_msprt: 2 channels in nats, 7 populations, 10 pathways")
    assert f"1800 cells per channel, sha256 {digest(one)[:8]})" in line
    assert len(line) < 150
    assert repr(one.lesion("STN", 0.1)) != line
    assert "0 cells per channel" in repr(anatomy.bogacz_gurney())


def test_edits_that_change_nothing_return_the_circuit(circuit):
    assert circuit.lesion("STN", 0) is circuit
    assert circuit.scale("STN->GPe", 1) is circuit
    assert circuit.cut("STN->GPe", 0) is circuit
    assert circuit.cut("STN->GPe", 0, channel=0) is circuit
    assert circuit.scale("STN->GPe", 1, channel=0) is circuit
    assert circuit.dopamine(1) is circuit
    assert circuit.with_channels(circuit.channels).about == circuit.about


def test_fields_of_a_cell_are_edited_like_those_of_its_row():
    circuit = anatomy.spiking_msprt()
    edited = circuit.with_cell("STN", cv=0.1).with_population("STN", neurons=40)
    assert (edited.population("STN").cell.cv, edited.population("STN").neurons) == (0.1, 40)
    assert circuit.with_cell("GPe", tau_ms=20).population("GPe").cell.tau_ms == 20
    small = circuit.with_neurons(7).with_heterogeneity(0.1).with_connections(0.25)
    assert {row.neurons for row in small.populations if row.spiking} == {7}
    assert {row.heterogeneity for row in small.populations} == {0.1, 0.0}
    assert {p.probability for p in small.projections} == {0.25, 1.0}


def test_one_channel_is_scaled_and_no_other(circuit):
    """At the fixed point: each channel in turn is the whole, and factors multiply."""
    drive = np.array([[[0.4, 0.1, -0.5]]])
    three = circuit.with_channels(3)
    each = three
    for channel in range(3):
        each = each.scale("D1->SNr", 0.5, channel).scale("D1->SNr", 1.8, channel)
    assert each.projection("D1->SNr").factors == (0.9, 0.9, 0.9)
    out = {
        name: run_algebra(c, drive).output_nats[0, 0]
        for name, c in {
            "unedited": three,
            "one": three.scale("D1->SNr", 0.9, channel=1),
            "each": each,
            "all": three.scale("D1->SNr", 0.9),
        }.items()
    }
    np.testing.assert_allclose(out["each"], out["all"], rtol=0, atol=1e-12)
    np.testing.assert_allclose(out["one"][[0, 2]], out["unedited"][[0, 2]], rtol=0, atol=1e-12)
    assert out["one"][1] == pytest.approx(out["all"][1], abs=1e-12)
    assert not three.scale("D1->SNr", 0.9, channel=1).exact


def test_lesions_multiply_and_can_be_undone(circuit):
    twice = circuit.lesion("STN", 0.5).lesion("STN", 0.5)
    assert twice.population("STN").intact == 0.25
    assert twice.unlesioned.populations == circuit.populations


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
    np.testing.assert_allclose(
        wire(each).deliver, wire(table.lesion("GPe", 0.25)).deliver, rtol=1e-12
    )


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


EXACT, SPIKING, MACAQUE = anatomy.bogacz_gurney(), anatomy.spiking_msprt(), anatomy.macaque()


@pytest.mark.parametrize(
    ("wanted", "edit"),
    [
        ("channel ctx_inh is pooled", lambda: MACAQUE.lesion("ctx_inh", 0.5, channel=0)),
        ("nucleus SNr is the read-out", lambda: MACAQUE.lesion("SNr", 0.5, channel=0)),
        ("nucleus GPe is already", lambda: SPIKING.clamp("GPe", channel=0).lesion("GPe", 0.5)),
        ("intact_by_channel 4 channels, got 2$",
         lambda: MACAQUE.lesion("GPe", 0.5, channel=0).with_channels(4)),
        ("intact_by_channel each of 2 channels, got 1$",
         lambda: MACAQUE.edited("set GPe.intact_by_channel=0.5")),
        ("intact_by_channel 0..1", lambda: MACAQUE.edited("set GPe.intact_by_channel=0.5,2")),
        ("factors", lambda: SPIKING.scale("ctx->D1", 0.5, channel=0).with_channels(4)),
        ("transfer STN->GPe", lambda: EXACT.scale("STN->GPe", 0.5, channel=0)),
        ("transfer must be linear", lambda: EXACT.with_projection("STN->GPe", probability=0.5)),
        ("tau_ms STN: tau_ms is that of the Lif cell",
         lambda: replace(EXACT.population("STN"), cell=Lif(10, 3, 15, 5, 2, 0, 1))),
        ("cv", lambda: SPIKING.with_cell("STN", cv=1.5)),
        ("noise_mv", lambda: SPIKING.with_cell("GPe", noise_mv=-1)),
        ("refractory_ms must be >= 0", lambda: SPIKING.with_cell("GPe", refractory_ms=-1)),
        ("reset_mv", lambda: SPIKING.with_cell("GPe", reset_mv=20)),
        ("tau_ms", lambda: SPIKING.with_cell("GPe", tau_ms=0)),
        ("slope", lambda: anatomy.linear_gpe(slope=0)),
        ("baseline_hz", lambda: named("appendix_b").with_population("SNr", baseline_hz=-20)),
        # What cuts the input from the read-out.
        ("readout", lambda: EXACT.lesion("STN").lesion("D1")),
        ("readout", lambda: EXACT.lesion("STN").scale("D1->SNr", 0)),
        ("readout", lambda: EXACT.lesion("D1").scale("ctx->STN", 0)),
        ("readout",
         lambda: EXACT.scale("D1->SNr", 0, 0).scale("D1->SNr", 0, 1).lesion("STN")),
    ],
)  # fmt: skip
def test_an_edit_that_a_table_cannot_have_is_refused(wanted, edit):
    with refused(wanted):
        edit()
    # With all pathways one is left, through D2 and GPe; only a difference may be negative.
    assert anatomy.appendix_b().lesion("STN").lesion("D1").population("D2").intact == 1
    assert named("appendix_b").with_population("GPe", baseline_hz=-20)["GPe"].baseline_hz == -20


def test_unknown_names_list_the_valid_ones(circuit):
    nuclei = ", ".join(row.name for row in circuit.populations)
    paths = ", ".join(p.name for p in circuit.projections)
    with refused(f"nucleus {nuclei}"):
        circuit.lesion("GPi")
    with refused(f"pathway {paths}"):
        circuit.scale("STN->GPi", 2)
    with refused("circuit one of bogacz_gurney, appendix_b.*got 'gprx'"):
        anatomy.load_circuit("gprx")


@pytest.mark.parametrize("name", ["appendix_b", "spiking_msprt"])
def test_dopamine_raises_d1_and_lowers_d2(name):
    circuit = anatomy.load_circuit(name)
    for level in (0.9, 1.2):
        changed = circuit.dopamine(level)
        for p, old in zip(changed.projections, circuit.projections, strict=True):
            factor = {"ctx->D1": level, "ctx->D2": 2 - level}.get(p.name, 1)
            assert p.weight == pytest.approx(factor * old.weight, rel=1e-15), p.name


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
    for same in (
        exact.with_channels(7),
        exact.with_population("STN", tau_ms=3, neurons=2),
        exact.with_projection("STN->GPe", delay_ms=3, tau_ms=2),
        exact.dopamine(1),
    ):
        assert same.exact
    for other in (
        exact.lesion("STN", 0.1),
        exact.scale("STN->GPe", 0.5),
        exact.dopamine(1.1),
        exact.with_population("STN", transfer="linear"),
        exact.with_projection("STN->SNr", pattern="channel"),
        exact.with_rows(Population("TRN", exact.population("STN").cell)),
        anatomy.linear_gpe(),
    ):
        assert not other.exact
    assert not anatomy.spiking_msprt().exact


def test_a_table_of_ones_own_takes_a_thousand_alternatives():
    rows = Population("ctx", Rate()), Population("SNr", Rate(), transmitter="GABA")
    table = Circuit("mine", rows, (Projection("ctx", "SNr", 1.0),), 1000)
    with refused("channels"):
        table.with_channels(1001)


@pytest.mark.parametrize(("factor", "neurons"), [(0.5, 150), (2, 600), (1.004, 301), (1e-6, 1)])
def test_a_multiple_of_the_cells_is_rounded_and_at_least_one(factor, neurons):
    circuit = anatomy.spiking_msprt().with_neurons_times(factor)
    assert {row.neurons for row in circuit.populations if row.spiking} == {neurons}


def test_the_largest_lead_is_kept_by_edits_that_leave_times_as_they_are_and_cleared_by_others():
    table = anatomy.macaque(2)
    most = table.max_lead_nats
    assert np.isfinite(most)
    kept = [
        table.lesion("GPe", 0.1),
        table.scale("ctx->D1", 1.1),
        table.dopamine(0.9),
        table.edited("set STN.bias_nats=-2"),
        table.add("D1->GPe", weight=-0.1),
        table.with_neurons_times(2),
        table.with_channels(2),
    ]
    assert {edited.max_lead_nats for edited in kept} == {most}
    cleared = [
        table.edited("set STN->GPe.delay_ms=4"),
        table.edited("set GPe->STN.tau_ms=3"),
        table.edited("set GPe_ctx.tau_ms=500"),
        table.with_channels(4),
    ]
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


def test_a_circuit_is_equal_to_no_plain_mapping():
    table = anatomy.load_circuit("macaque")
    assert table == replace(table)
    assert table != dict(table)
    assert hash(table) == hash(replace(table))


@pytest.mark.parametrize(
    "edit",
    [
        "set STN.tau_ms 0.02",
        "set STN->GPe.tau_ms 0.003",
        "set STN->GPe.delay_ms 0.004",
        "set GPe.cell.tau_ms 0.01",
        "set STN->GPe.tau_ms 20000",
        "set STN.baseline_hz 500",
    ],
)
def test_numbers_far_outside_physiology_are_warned_of(edit):
    name = edit.split(" ")[1].split(".", 1)[1].replace(".", "_")
    with pytest.warns(EditWarning, match=name):
        named("spiking_msprt").edited(edit)


def test_no_shipped_table_is_outside_physiology():
    with unwarned():
        for name in CIRCUITS:
            named(name, 3)
