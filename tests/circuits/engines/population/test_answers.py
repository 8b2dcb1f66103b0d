"""Tables of what cells answer: their ranges, their errors, and when a warning says so."""

import numpy as np
import pytest

from circuits import anatomy
from circuits.cells import Phase
from circuits.declaration import transfer
from circuits.engines.population import answers as module
from circuits.engines.population.answers import Mixture, answers, looked_up
from circuits.store import Entry

GPE = anatomy.spiking_msprt().population("GPe")
LIF = Mixture(GPE.cell, "linear", GPE.baseline_hz, GPE.gain_hz_per_nat)


@pytest.mark.parametrize(
    ("mixture", "top_hz"),
    [(Mixture(Phase(0.3), "linear", 40.0, 10.0), 1000.0), (LIF, 0.95 * 500)],
)
def test_filters_follow_rates_of_1_mhz_to_400_hz_and_the_law_up_to_its_limit(mixture, top_hz):
    """A cell with a refractory period of 2 ms stays below 500 Hz; its law is tabulated to 95 %."""
    table = answers(mixture, 0.1)
    ends = mixture.rate_hz(np.array([table.lowest, table.highest, table.top]))
    np.testing.assert_allclose(ends, [1e-3, 400, top_hz], rtol=0.02)
    np.testing.assert_allclose(table.hz[[0, -1]], ends[[0, 2]], rtol=1e-9)


def test_a_law_that_ends_is_followed_to_a_thousandth_of_its_ends():
    """A ramp of 34 Hz between 0 and 1 nat."""
    table = answers(Mixture(Phase(0.3), "ramp", 0.0, 34.0), 0.1)
    np.testing.assert_allclose(table.lowest * 34, 1e-3, rtol=0.05)
    np.testing.assert_allclose([table.highest, table.top], [0.999, 0.95], rtol=1e-5)


@pytest.mark.parametrize("share", [0.95, 1.05])
def test_a_law_is_looked_up_if_it_bends_by_less_than_a_five_hundredth_between_points(
    share, monkeypatch
):
    """A sine of height 1 rises above a chord by 1 - cos(half a step); 8191 steps span 128 nats."""
    turn = 2 * np.arccos(1 - share * 2e-3) / (128 / 8191)
    wave = transfer.Transfer(lambda x: np.sin(turn * x), np.cos, np.sin, "sin({x})", "a wave")
    name = f"wave {share}"
    monkeypatch.setitem(transfer.TRANSFERS, name, wave)
    if share > 1:
        with pytest.raises(ValueError, match="too curved for that"):
            looked_up(name)
    else:
        low, high, values = looked_up(name)
        np.testing.assert_array_equal(values, np.sin(turn * np.linspace(low, high, len(values))))


def test_fits_are_kept_only_if_all_code_is_included(monkeypatch):
    """The cache is keyed by the sources of the package, which have no transfer of a user."""
    kept = []
    nowhere = Entry(None, "", "", dict, dict)
    monkeypatch.setattr(module, "cached", lambda *_: kept.append(1) or nowhere)
    monkeypatch.setattr(module, "_fit", lambda _: None)
    monkeypatch.setitem(transfer.TRANSFERS, "mine", transfer.TRANSFERS["linear"])
    for name, count in (("linear", 1), ("mine", 1), ("exp", 2)):
        module._fitted(Mixture(Phase(0.3), name, 10.0, 5.0))
        assert len(kept) == count
