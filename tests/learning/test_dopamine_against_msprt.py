"""Levels of dopamine compared with tests at equal time."""

import numpy as np
import pandas as pd
import pytest

from bgmodel import Msprt, stream
from bgmodel.deciding.tradeoff import Tradeoff, tradeoff
from bgmodel.learning import dopamine as levels
from bgmodel.learning.dopamine import level_table
from tests.helpers import ROOT
from tests.levels import GAIN, MODEL, SEED


def test_the_gap_in_equal_time_sees_a_slower_decider(level_evidence):
    """The MSPRT itself has none; with times half as long again, or 100 ms late, it loses."""
    test = tradeoff(Msprt(GAIN).run(level_evidence), level_evidence)
    keep = np.searchsorted(test.posterior.mean(axis=1), [0.7, 0.75, 0.8, 0.85, 0.9])
    names = ("choice", "forced", "premature", "posterior")
    fields = {n: getattr(test, n)[keep] for n in names}
    gaps = {}
    for factor, late in ((1.0, 0.0), (1.5, 0.0), (1.0, 100.0)):
        slow = Tradeoff(
            np.linspace(1.6, 0.9, 5), time_ms=factor * test.time_ms[keep] + late, **fields
        )
        options = {"circuit": MODEL.circuit, "gain": GAIN, "rng": stream(SEED, "boot")}
        table = level_table(slow, {"MSPRT": test}, latency_ms=0.0, **options)
        rows = table[table["measure"] == "accuracy_gap"]
        gaps[factor, late] = rows["value"].to_numpy()
    assert np.abs(gaps[1.0, 0.0]).max() < 0.005
    assert gaps[1.5, 0.0].max() < -0.01
    assert gaps[1.0, 100.0].max() < -0.005


@pytest.mark.parametrize("channels", levels.LATENCY_MS)
def test_the_latency_is_what_was_measured_on_raw_evidence(channels):
    """The time that the default circuit takes more than its test, in a table of the results."""
    table = pd.read_csv(ROOT / "figures/decisions/tables/raw_decisions.csv")
    table = table[table["evidence"].eq(f"Gaussian, d' 1, N = {channels}")]
    table = table[table["engine"].eq("population") & table["given"].eq("raw")]
    extra_ms = table[table["accuracy"].isin([0.9, 0.95])]["extra_ms"]
    assert len(extra_ms) == 2
    assert levels.LATENCY_MS[channels] == pytest.approx(extra_ms.mean(), abs=1)
