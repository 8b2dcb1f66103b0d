"""Edits that turn one circuit into another."""

from dataclasses import replace

import pytest

from circuits.anatomy import load_circuit
from circuits.differences import differences
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
