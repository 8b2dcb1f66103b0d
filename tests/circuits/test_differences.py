"""Edits that turn one circuit into another, and those that an engine does not use."""

from dataclasses import replace

import pytest

from circuits.anatomy import load_circuit
from circuits.declaration.edits import Edits
from circuits.differences import check_edits, differences
from tests.helpers import refused


@pytest.mark.parametrize(
    "lines",
    [
        (),
        ("set STN.bias_nats -1.9", "set D1->SNr.weight -0.9"),
        ("set STN.cell.cv 0.25", "set SNr.heterogeneity 0.1"),
        ("add D1->GPe weight=-0.1 delay_ms=4 tau_ms=3", "set ctx->D1.delay_ms 8"),
        ("add TRN like=STN bias_nats=-1", "add TRN->GPe weight=0.2"),
        ("scale STN->GPe 0.5", "lesion STN 10%"),
        ("set STN.cell Rate",),
        ("dopamine 0.9",),
        ("compensate", "lesion GPe 20%"),
    ],
)
def test_the_edits_that_are_found_do_what_was_done(lines):
    first = load_circuit("macaque", 3)
    second = first.edited(*lines)
    edited = first.edited(*differences(first, second))
    for one, other in ((edited.populations, second.populations),
                       (edited.projections, second.projections)):  # fmt: skip
        assert [replace(row, cite="") for row in one] == [replace(row, cite="") for row in other]
    assert bool(differences(first, second)) == bool(lines)


def test_what_no_edit_can_do_is_refused():
    first = load_circuit("macaque")
    for second in (
        load_circuit("macaque", 3),
        load_circuit("appendix_b"),
        load_circuit("gpr"),
        replace(first, readout_tau_ms=20.0),
        first.edited("add dopamine amount=0.2 to_ms=300"),
    ):
        with refused("second"):
            differences(first, second)


@pytest.mark.parametrize(
    ("engine", "line"),
    [
        ("algebra", "set STN->GPe.delay_ms 4"),
        ("algebra", "set STN.tau_ms 4"),
        ("algebra", "set GPe.cell.tau_ms 4"),
        ("rate", "set STN.cell.cv 0.1"),
        ("rate", "set STN.neurons 7"),
        ("rate", "set STN->GPe.probability 0.5"),
        ("rate", "neurons 7"),
        ("rate", "connections 0.5"),
        ("algebra", "heterogeneity 0.1"),
    ],
)
def test_an_edit_that_an_engine_does_not_feel_is_refused(engine, line):
    check_edits(Edits([line]), "ensemble")
    with refused("edits"):
        check_edits(Edits([line]), engine)


@pytest.mark.parametrize(
    "line",
    ["set STN->GPe.delay_ms 4", "set GPe.cell.tau_ms 12", "set STN.tau_ms 7", "lesion STN 1%"],
)
def test_rates_feel_times_and_lesions(line):
    check_edits(Edits([line]), "rate")
