"""Several receptors of one pathway: the same circuit if they are alike, in every engine and law."""

from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from circuits import anatomy, show, table_reader
from circuits.anatomy import load_circuit
from circuits.cells import Rate
from circuits.circuit import Circuit
from circuits.declaration import table_writer
from circuits.declaration.edits import Edits
from circuits.declaration.rows import Population, Projection
from circuits.differences import differences
from circuits.dynamics.fixed_point import resting_state
from circuits.engines import ENGINES, run
from circuits.laws.controls import linear_stn, perturbed, shuffled_stn
from circuits.laws.fluctuation import out_variance, rate_spectrum
from circuits.laws.homeostasis import biases
from circuits.laws.stability import ringing
from tests.helpers import refusing

SEED = 5
MACAQUE = load_circuit("macaque", 2)
SMALL = anatomy.spiking_msprt(2).with_neurons(20)
DRIVE = np.array([[[0.4, -0.4], [1.2, -1.2]]])
SHARES = st.floats(0.05, 0.95)
PATHS = [("STN", "SNr"), ("GPe", "STN"), ("D1", "SNr"), ("ctx", "STN"), ("STN", "GPe")]
KINDS = {"GPe": ("GABA-A", "GABA-B"), "D1": ("GABA-A", "GABA-B")}


def split(circuit, source, target, share, **fields):
    """Return the circuit with a pathway through two receptors, the second with other fields."""
    row = circuit.projection(f"{source}->{target}")
    first, second = KINDS.get(source, ("AMPA", "NMDA"))
    one = replace(row, synapse=first, weight=row.weight * share)
    other = replace(row, synapse=second, weight=row.weight * (1 - share), **fields)
    rows = (two for p in circuit.projections for two in ((one, other) if p == row else (p,)))
    return replace(circuit, projections=tuple(rows))


def ran(circuit, engine, **options):
    timing = {"settle_ms": 20, "step_ms": 20} if ENGINES[engine].timed else {"step_ms": 20}
    return run(circuit, DRIVE, engine=engine, seed=SEED, **timing | options)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_pathway_in_two_rows_that_are_alike_is_the_same_circuit(engine):
    options = {"spikes": ("GPe", "SNr")} if ENGINES[engine].spiking else {}
    table = SMALL.with_heterogeneity(0.1)
    one, two = (ran(t, engine, **options) for t in (table, split(table, "STN", "SNr", 0.25)))
    single = not (ENGINES[engine].spiking or engine == "algebra")
    npt.assert_allclose(two.output_nats, one.output_nats, rtol=0, atol=2e-4 if single else 1e-9)
    for name in options.get("spikes", ()):
        assert len(one.spikes[name]) > 20
        assert two.spikes[name].equals(one.spikes[name])


@pytest.mark.parametrize("engine", ["plain", "brian2", "spikes"])
def test_both_receptors_of_sparse_connections_get_the_same_spikes(engine):
    table = SMALL.with_connections(0.25)
    one, two = (ran(t, engine, spikes=("SNr",)) for t in (table, split(table, "STN", "SNr", 0.5)))
    assert len(one.spikes["SNr"]) > 20
    assert two.spikes["SNr"].equals(one.spikes["SNr"])


@given(SHARES, st.sampled_from(PATHS), st.floats(0, 200), st.floats(0, 50))
@settings(max_examples=20)
def test_rest_depends_on_the_sum_of_the_weights_alone(share, path, tau_ms, delay_ms):
    two = split(MACAQUE, *path, share, tau_ms=tau_ms, delay_ms=delay_ms)
    for mine, theirs in zip(resting_state(two), resting_state(MACAQUE), strict=True):
        npt.assert_allclose(mine, theirs, rtol=1e-9, atol=1e-9)


@given(SHARES, st.sampled_from(PATHS))
@settings(max_examples=5, deadline=None)
def test_every_law_of_a_circuit_is_that_of_the_sum(share, path):
    two = split(MACAQUE, *path, share)
    assert ringing(two) == pytest.approx(ringing(MACAQUE), rel=1e-6)
    npt.assert_allclose(*(rate_spectrum(table, "SNr", [1.0, 20.0]) for table in (two, MACAQUE)))
    for name, variance in out_variance(two).items():
        npt.assert_allclose(variance, out_variance(MACAQUE)[name], rtol=1e-6)


@given(SHARES)
@settings(max_examples=5, deadline=None)
def test_edits_of_the_pair_act_on_all_of_its_receptors(share):
    def same(edit, path=("STN", "SNr")):
        two, one = edit(split(MACAQUE, *path, share)), edit(MACAQUE)
        npt.assert_allclose(resting_state(two)[1], resting_state(one)[1], rtol=1e-7)
        assert [p.pair for p in two.projections if p.synapse not in ("AMPA", "GABA-A")] == [
            p.pair for p in one.projections
        ]

    same(lambda c: c.scale("STN->SNr", 0.8))
    same(lambda c: c.scale("STN->SNr", 0.8, channel=1))
    same(lambda c: c.cut("STN->SNr", 0.1))
    same(lambda c: c.edited("cut STN->SNr[0] 10%"))
    same(lambda c: c.edited("cut STN->SNr 10%", "lesion STN 5%", "compensate"))
    same(lambda c: c.dopamine(0.9), ("ctx", "STN"))
    same(shuffled_stn)
    same(linear_stn, ("GPe", "STN"))


def test_dopamine_within_a_trial_scales_every_receptor():
    course = "add dopamine amount=0.3 from_ms=20 to_ms=60"
    one, two = MACAQUE.edited(course), split(MACAQUE, "ctx", "D1", 0.3).edited(course)
    apart = ran(one, "rate").output_nats - ran(MACAQUE, "rate").output_nats
    assert np.abs(apart).max() > 1e-3
    npt.assert_allclose(ran(two, "rate").output_nats, ran(one, "rate").output_nats, atol=2e-4)


@given(st.sampled_from(PATHS), SHARES)
@settings(max_examples=10, deadline=None)
def test_a_blocked_receptor_is_a_missing_row_and_its_tone(path, share):
    source, target = path
    two = split(MACAQUE, source, target, share, tau_ms=80.0)
    second = two.pathways(f"{source}->{target}")[1]
    blocked = two.block(second.name)
    without = replace(two, projections=tuple(p for p in two.projections if p != second))
    tone = second.weight * MACAQUE.pattern(second)[0].sum()
    of = MACAQUE.population(source)
    bias = MACAQUE.population(target).bias_nats - tone * of.baseline_hz / of.gain_hz_per_nat
    rest = lambda table: resting_state(table)[1]  # noqa: E731
    if second.transfer == "linear":
        biased = without.with_population(target, bias_nats=bias)
        npt.assert_allclose(rest(replace(blocked, chronic=True)), rest(biased), rtol=1e-6)
    npt.assert_allclose(rest(two.scale(second.name, 0)), rest(without), rtol=1e-7)


@pytest.mark.parametrize("engine", ENGINES)
def test_without_tone_a_blocked_receptor_is_a_missing_row_in_every_engine(engine):
    table = split(SMALL, "ctx", "D1", 0.7, tau_ms=40.0).with_population("ctx", baseline_hz=0.0)
    without = replace(table, projections=tuple(p for p in table.projections if p.synapse != "NMDA"))
    blocked = replace(table.block("D1 NMDA"), chronic=True)
    out, wanted = (ran(t, engine).output_nats for t in (blocked, without))
    npt.assert_allclose(out, wanted, rtol=0, atol=2e-4)
    assert np.abs(wanted - ran(table, engine).output_nats).max() > 1e-2


def filters(*rows):
    """Return a circuit in which SNr hears cortex through several filters."""
    cells = (Population("ctx", Rate(signed=True)), Population("SNr", Rate(signed=True)))
    paths = tuple(Projection("ctx", "SNr", weight, synapse=name, tau_ms=tau)
                  for name, weight, tau in rows)  # fmt: skip
    return Circuit("filters", cells, paths, 2, reference_nats=np.log(2))


@pytest.mark.parametrize(("fast_ms", "slow_ms"), [(5.0, 100.0), (2.0, 30.0)])
def test_a_step_through_two_receptors_is_the_sum_of_two_filters(fast_ms, slow_ms):
    table = filters(("AMPA", 0.75, fast_ms), ("NMDA", 0.25, slow_ms))
    step = run(table, np.array([[[1.0, 0.0]]]), engine="rate", step_ms=400, dt_ms=0.1, settle_ms=0)
    # Rates are interpolated from tick to tick, and a pathway takes at least one.
    late = step.time_ms - 0.15
    wanted = 0.75 * -np.expm1(-late / fast_ms) + 0.25 * -np.expm1(-late / slow_ms)
    npt.assert_allclose(step.output_nats[0, :, 0], wanted, atol=2e-2)
    npt.assert_allclose(step.output_nats[0, 20:, 0], wanted[20:], atol=2e-3)
    alone = run(filters(("", 1.0, fast_ms)), np.array([[[1.0, 0.0]]]), engine="rate", step_ms=400)
    assert np.abs(alone.output_nats[0, :, 0] - wanted).max() > 0.1


def test_receptors_are_kept_by_files_and_shown():
    two = split(MACAQUE, "STN", "SNr", 0.7, tau_ms=100.0)
    assert table_reader.parse(table_writer.text(two), "two.toml") == two
    assert table_writer.digest(two) != table_writer.digest(MACAQUE)
    lines = (line for line in show.text(two).splitlines() if "STN -> SNr" in line)
    assert " 100 " in next(line for line in lines if "NMDA" in line)


@pytest.mark.parametrize(
    ("lines", "by_hand"),
    [
        (["block STN->SNr NMDA"], lambda c: c.block("STN->SNr NMDA")),
        (["block SNr NMDA 30%"], lambda c: c.cut("STN->SNr NMDA", 0.3)),
        (["block STN -> SNr[1] NMDA 30 %"], lambda c: c.block("STN->SNr NMDA", 0.3, channel=1)),
        (["cut STN->SNr NMDA 30%"], lambda c: c.cut("STN->SNr NMDA", 0.3)),
        (["scale STN->SNr NMDA 0.5"], lambda c: c.scale("STN->SNr NMDA", 0.5)),
        (["scale STN->SNr[0] NMDA 0.5"], lambda c: c.scale("STN->SNr NMDA", 0.5, 0)),
        (["set STN->SNr NMDA.tau_ms 60"],
         lambda c: c.with_projection("STN->SNr NMDA", tau_ms=60)),
        (["set STN->SNr NMDA.tau_ms=60", "scale STN->SNr 0.5"],
         lambda c: c.set("STN->SNr NMDA.tau_ms", 60).scale("STN->SNr", 0.5)),
        (["add D1->GPe GABA-A weight=-0.1"],
         lambda c: c.with_rows(Projection("D1", "GPe", -0.1, synapse="GABA-A"))),
        (["add STN->GPe NMDA like=STN->GPe weight=0.1", "block GPe NMDA 50%"],
         lambda c: c.add("STN->GPe NMDA", like="STN->GPe", weight=0.1).block("GPe NMDA", 0.5)),
    ],
)  # fmt: skip
def test_edits_name_a_receptor_after_its_pathway(lines, by_hand):
    table = split(MACAQUE, "STN", "SNr", 0.7, tau_ms=100.0)
    assert table.edited(*lines) == by_hand(table) != table
    edited = table.edited(*differences(table, table.edited(*lines)))
    bare = lambda c: [replace(p, cite="") for p in c.projections]  # noqa: E731
    assert bare(edited) == bare(table.edited(*lines))


def test_a_row_is_known_by_its_pair_and_its_receptor():
    two = split(MACAQUE, "STN", "SNr", 0.7)
    assert two["STN->SNr NMDA"] == two.projection("STN->SNr NMDA")
    assert two["STN->GPe"].name == "STN->GPe"
    named = MACAQUE.edited("set STN->SNr.synapse AMPA")
    assert named["STN->SNr"] == named["STN->SNr AMPA"]
    assert named.max_lead_nats == MACAQUE.max_lead_nats
    assert resting_state(named)[1].tolist() == resting_state(MACAQUE)[1].tolist()
    beside = MACAQUE.edited("add STN->SNr NMDA like=STN->SNr weight=0.2")
    assert beside["STN->SNr"] == MACAQUE["STN->SNr"]
    assert beside["STN->SNr NMDA"].weight == 0.2


def test_a_block_onto_a_nucleus_takes_every_pathway_through_the_receptor():
    table = MACAQUE.edited("set STN->GPe.synapse AMPA", "set D2->GPe.synapse GABA-A")
    blocked = table.edited("block GPe AMPA 40%")
    assert {p.name: p.intact for p in blocked.projections if p.intact < 1} == {"STN->GPe AMPA": 0.6}
    both = table.edited("set GPe->SNr.synapse GABA-A", "set D1->SNr.synapse GABA-A",
                        "block SNr GABA-A")  # fmt: skip
    lost = {p.name for p in both.projections if not p.intact}
    assert lost == {"GPe->SNr GABA-A", "D1->SNr GABA-A"}


def read(circuit, old, new):
    """Return the circuit of a table's file with another text."""
    return table_reader.parse(table_writer.text(circuit).replace(old, new), "two.toml")


test_a_receptor_that_is_not_there_and_two_edits_of_one_row_are_refused = refusing(
    (lambda c: c.block("STN->SNr NMDA"), "synapse NMDA"),
    (lambda c: c.edited("block GPe GABA-A"), "synapse GPe"),
    (lambda c: c.scale("STN->GPe AMPA", 0.5), "synapse AMPA"),
    (lambda c: c.edited("add STN->SNr NDMA weight=1"), "synapse NDMA"),
    (lambda c: c.edited("add STN->SNr GABA-A weight=1"), "synapse GABA-A"),
    (lambda c: split(c, "STN", "SNr", 0.5).set("STN->SNr.weight", 1), "synapse"),
    (lambda c: c.with_rows(c.projection("STN->SNr")), "synapse"),
    (lambda c: c.edited("add STN->SNr weight=1"), "add STN->SNr"),
    (lambda c: c.block("GPi AMPA"), "nucleus"),
    (lambda c: c.block("SNr->STN AMPA"), "pathway"),
    (lambda c: split(c, "STN", "SNr", 0.5).block("SNr NMDA", channel=2), "channel"),
    (lambda c: split(c, "STN", "SNr", 0.5).block("SNr NMDA", 1.5), "fraction"),
    (lambda c: c.edited("block GPe 30%"), "edits"),
    (lambda c: c.edited("cut STN->SNr 10%", "block STN->SNr NMDA"), "edits"),
    (lambda c: c.edited("block SNr NMDA 10%", "block STN->SNr NMDA 10%"), "edits"),
    (lambda c: c.edited("block SNr NMDA 10%", "cut STN->SNr 10%"), "edits"),
    (lambda c: c.edited("scale STN->SNr 0.5", "set STN->SNr NMDA.weight 2"), "edits"),
    # Two rows of one receptor, at their line of a file.
    (lambda c: read(split(c, "STN", "SNr", 0.7), '"NMDA"', '"AMPA"'), "synapse line"),
    of=lambda edit: edit(MACAQUE),
)


def test_edits_of_two_receptors_or_of_a_nucleus_and_a_receptor_are_not_of_one_number():
    Edits(["scale STN->SNr NMDA 0.5", "scale STN->SNr AMPA 2"])
    Edits(["set STN->SNr.weight 0.5", "set STN->SNr NMDA.weight 2"])
    Edits(["add STN->SNr NMDA weight=0.3", "set STN->SNr.weight 0.5", "scale STN->SNr NMDA 2"])
    Edits(["lesion GPe 10%", "block GPe AMPA", "cut GPe->STN 10%", "block STN->SNr NMDA"])


def test_homeostasis_and_perturbations_reach_every_receptor():
    two = split(SMALL, "STN", "SNr", 0.7)
    assert {f"STN->SNr {name} weight +20%" for name in ("AMPA", "NMDA")} <= set(perturbed(two))
    exact = load_circuit("bogacz_gurney", 2)
    two = split(exact, "STN", "SNr", 0.7)
    one, both = (biases(c.lesion("STN", 0.05)) for c in (exact, two))
    assert both == pytest.approx(one, rel=1e-6)
