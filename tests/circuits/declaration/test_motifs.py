"""Motifs: rows that are added by one name, with sources, and what they do."""

import numpy as np
import pytest

from bgmodel.integrators.basal_ganglia import BasalGanglia
from circuits import anatomy
from circuits.declaration.motifs import MOTIFS
from circuits.dynamics.fixed_point import resting_hz
from circuits.show import ASSUMED

CORTEX = ("ctx", "ctx_inh")
INTERNEURONS = "striatal_FSI"


@pytest.mark.parametrize("name", ["macaque_small", "spiking_msprt", "appendix_b"])
@pytest.mark.parametrize("channels", [2, 4])
def test_adding_striatal_interneurons_leaves_all_rates_resting_hz(name, channels):
    table = anatomy.load_circuit(name, channels)
    added = table.add(INTERNEURONS)
    before, after = resting_hz(table), resting_hz(added)
    assert {key: after[key] for key in before} == pytest.approx(before, abs=1e-6)
    low, high = added.population("FSI").published_hz
    assert low < after["FSI"] < high
    new = {row.name for row in added.populations + added.projections}
    new -= {row.name for row in table.populations + table.projections}
    assert new == {"FSI", "ctx->FSI", "FSI->D1", "FSI->D2"}
    for row in new:
        assert added.row(row).cite not in ("", ASSUMED)


def test_a_motif_is_added_by_its_name_as_by_its_rows():
    table = anatomy.macaque_small(2)
    added = table.add(INTERNEURONS)
    assert added == table.with_rows(*MOTIFS[INTERNEURONS](table))
    assert added == table.edited(f"add {INTERNEURONS}")
    assert added != table
    like = table.edited(f"add {INTERNEURONS}", "add other like=FSI", "add ctx->other like=ctx->FSI")
    assert like.population("other").baseline_hz == added.population("FSI").baseline_hz
    for wrong in (added, anatomy.macaque(2), anatomy.gpr(2)):
        with pytest.raises(ValueError, match=INTERNEURONS):
            wrong.add(INTERNEURONS)


def test_a_loss_of_half_of_them_frees_d1_and_d2_and_leaves_cortex():
    added = anatomy.macaque_small(2).add(INTERNEURONS)
    before, after = resting_hz(added), resting_hz(added.lesion("FSI", 0.5))
    assert after["D1"] > before["D1"] + 1
    assert after["D2"] > before["D2"] + 0.1
    for name in CORTEX:
        assert after[name] == pytest.approx(before[name], abs=0.05)


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
