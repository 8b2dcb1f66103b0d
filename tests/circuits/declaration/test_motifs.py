"""Motifs: courses that are added by one name, with sources, and what they do."""

import numpy as np
import pytest

from bgmodel.integrators.basal_ganglia import BasalGanglia
from circuits import anatomy
from circuits.declaration.motifs import MOTIFS
from circuits.show import ASSUMED


@pytest.mark.parametrize("name", list(MOTIFS))
def test_a_motif_is_added_by_its_name_as_by_its_rows(name):
    table = anatomy.macaque_small(2)
    added = table.add(name)
    assert added == table.with_rows(*MOTIFS[name](table))
    assert added == table.edited(f"add {name}")
    assert added != table
    assert all(row.cite not in ("", ASSUMED) for row in added.courses)
    with pytest.raises(ValueError, match=name):
        anatomy.gpr(2).add(name)


@pytest.mark.parametrize("name", ["macaque", "spiking_msprt", "bogacz_gurney"])
def test_urgency_lowers_out_of_all_channels_by_half_a_nat_in_the_end(name):
    table = anatomy.load_circuit(name)
    rows = BasalGanglia(table, "rate").run_drive(np.zeros((1, 100, 2)), 50.0).output_nats[0]
    urgent = table.edited("add urgency")
    lower = BasalGanglia(urgent, "rate").run_drive(np.zeros((1, 100, 2)), 50.0).output_nats[0]
    falls = -0.5 * (1 - np.exp(-5.0))  # after 5 s, with a time constant of 1 s
    floor = -rows[-1]  # a rate does not fall below 0
    assert lower[-1] - rows[-1] == pytest.approx(np.maximum(falls, floor), abs=0.02)


def test_the_onset_transient_raises_cortex_and_leaves_out_in_the_end():
    table = anatomy.macaque(2)
    models = (BasalGanglia(each, "rate") for each in (table, table.add("onset_transient")))
    quiet, burst = (model.run_drive(np.zeros((1, 40, 2)), 50.0) for model in models)
    cortex = burst.rates_hz["ctx"][0] - quiet.rates_hz["ctx"][0]
    assert cortex.max() > 3
    assert np.abs(cortex[-1]).max() < 0.3
    assert np.abs(burst.output_nats[0, -1] - quiet.output_nats[0, -1]).max() < 0.02
