"""Edits that turn one circuit into another, and those that an engine does not use."""

from dataclasses import replace

import pytest

from circuits.anatomy import load_circuit
from circuits.declaration.edits import Edits
from circuits.differences import check_edits, differences


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
