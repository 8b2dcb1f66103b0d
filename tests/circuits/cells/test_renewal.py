"""Renewal cells: the law of their intervals, at any course of their rate, in every engine."""

from dataclasses import dataclass

import numpy as np
import numpy.testing as npt
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.stats import gamma, invgauss, kstest

from circuits.cells import Cell, Phase, Rate, register
from circuits.cells.renewal import BINS, first_spikes, intervals, wait
from circuits.circuit import Circuit
from circuits.declaration.rows import Population, Projection
from circuits.dynamics import noise
from circuits.engines import run
from tests.circuits.spiking import BASE, SPIKING, kind_of, spikes_of
from tests.helpers import refused

CVS = (0.01, 0.1, 0.3, 0.5, 1.0)
ANY_WORDS = np.random.default_rng(5).integers(0, 2**32, 400_000, dtype=np.uint32)


@dataclass(frozen=True)
class Gamma(Cell):
    """Intervals of a gamma distribution: in Phase's place, any other law of a mean of 1."""

    shape: float

    def interval_quantiles(self, probability):
        return gamma.ppf(probability, self.shape, scale=1 / self.shape)


@pytest.fixture(autouse=True)
def known():
    register(Gamma)


def source(cell, hz, neurons=400, **about):
    """Return cells that fire at a rate, 20 Hz per nat, between an input and a read-out."""
    unit = Population("input", Rate(signed=True), 0.0, 20.0)
    cells = Population("ctx", cell, hz, 20.0, neurons=neurons, **about)
    read = Population("SNr", Rate(), hz, 20.0)
    paths = Projection("input", "ctx", 1.0), Projection("ctx", "SNr", 1.0)
    rows = unit, cells, read
    return Circuit("source", rows, paths, 2, input="input", reference_nats=np.log(2))


def fired(circuit, drive, engine="spikes", **options):
    """Return the spikes of a source, 50 ms a reading, from the first ms on."""
    settings = {"step_ms": 50, "seed": 4, "settle_ms": 0, "spikes": ("ctx",)} | options
    return run(circuit, np.asarray(drive, dtype=float), engine=engine, **settings).spikes["ctx"]


def trains(table):
    """Return the spike times of each cell, ms, by its channel and number."""
    by_cell = table.sort_values("time_ms").groupby(["trial", "channel", "neuron"])["time_ms"]
    return {cell: times.to_numpy() for cell, times in by_cell}


@pytest.mark.parametrize("cv", CVS)
def test_intervals_are_inverse_gaussian_of_mean_1(cv):
    law = invgauss(cv**2, scale=cv**-2)
    ends = intervals(Phase(cv))
    mean, width = (ends[1:] + ends[:-1]) / 2, np.diff(ends)
    assert mean.mean() == pytest.approx(1, abs=1e-6)
    assert np.sqrt(np.mean(mean**2 + width**2 / 12) - 1) == pytest.approx(cv, rel=5e-4)
    inner = ends[1:-1]
    npt.assert_allclose(law.cdf(inner), np.arange(1, BINS) / BINS, atol=2e-5)
    assert kstest(wait(ends, ANY_WORDS), law.cdf).pvalue > 1e-3


@pytest.mark.parametrize("cv", [0.0, 5e-324, 1e-160, 1e-12])
def test_without_irregularity_every_interval_is_the_mean(cv):
    assert (wait(intervals(Phase(cv)), ANY_WORDS) == 1).all()
    npt.assert_allclose(wait(first_spikes(Phase(cv)), ANY_WORDS).mean(), 0.5, atol=2e-3)


@pytest.mark.parametrize("cell", [*map(Phase, CVS), Gamma(3.0)], ids=repr)
def test_the_first_spike_comes_as_in_a_train_without_beginning(cell):
    """Its distribution is the integral of the probability of longer intervals."""
    x = np.linspace(0, 40, 400_001)
    law = invgauss(cell.cv**2, scale=cell.cv**-2) if isinstance(cell, Phase) else None
    longer = law.sf(x) if law else gamma.sf(x, 3, scale=1 / 3)
    share = cumulative_trapezoid(longer, x, initial=0)
    inner = first_spikes(cell)[1:-1]
    npt.assert_allclose(np.interp(inner, x, share), np.arange(1, BINS) / BINS, atol=2e-4)


@pytest.mark.parametrize("cell", [Phase(0.3), Phase(1.0), Gamma(4.0)], ids=repr)
@pytest.mark.parametrize("spread", [0.0, 0.3])
def test_rates_are_exact_and_counts_as_irregular_as_stated_from_the_first_tick(cell, spread):
    hz, cv = 40.0, cell.cv if isinstance(cell, Phase) else 0.5
    table = fired(source(cell, hz, heterogeneity=spread), np.zeros((40, 20, 2)))
    counts, _ = np.histogram(table["time_ms"], np.arange(0, 1001, 50))
    expected = 40 * 2 * 400 * hz * 0.05
    # In short windows counts vary more than over long ones: at most as those of a Poisson process.
    npt.assert_allclose(counts, expected, atol=4 * np.sqrt(expected))
    assert counts.sum() == pytest.approx(20 * expected, abs=4 * cv * np.sqrt(20 * expected))
    of_cell = table.groupby(["trial", "channel", "neuron"]).size()
    if not spread:
        # Over 40 intervals, the variance of a stationary renewal count is cv^2 n + 1/6 + ...
        rest = (1 - cv**2) ** 2 / 6
        assert of_cell.var() == pytest.approx(40 * cv**2 + rest, rel=0.12)


def test_a_cell_keeps_its_intervals_whatever_its_rate():
    """In expected spikes: the same train at 20 Hz, at 60 Hz, and on a changing rate."""
    steady = trains(fired(source(Phase(0.5), 20.0, 30), np.zeros((1, 60, 2))))
    fast = trains(fired(source(Phase(0.5), 60.0, 30), np.zeros((1, 20, 2))))
    step = np.concatenate([np.zeros((1, 20, 2)), np.full((1, 20, 2), 1.0)], axis=1)
    changed = trains(fired(source(Phase(0.5), 20.0, 30), step))
    for cell, times in steady.items():
        npt.assert_allclose(fast[cell], times / 3, atol=0.26)  # a tick
        clock = np.where(changed[cell] <= 1000, changed[cell], 1000 + 2 * (changed[cell] - 1000))
        npt.assert_allclose(clock, times[: len(clock)], atol=0.76)
    other = trains(fired(source(Phase(0.5), 20.0, 30), np.zeros((1, 60, 2)), seed=5))
    assert len(other[0, 0, 0]) != len(steady[0, 0, 0]) or (other[0, 0, 0] != steady[0, 0, 0]).any()


def test_a_silent_cell_waits_and_a_cell_fires_once_in_a_tick_at_most():
    off = np.concatenate([np.full((1, 4, 2), -5.0), np.zeros((1, 4, 2))], axis=1)
    times = fired(source(Phase(0.3), 40.0), off)["time_ms"]
    times = times[times > 0.25]  # the input takes a tick
    assert times.min() > 200
    assert len(times) == pytest.approx(2 * 400 * 40 * 0.2, rel=0.02)
    # Half as many spikes as ticks: some cells would fire twice in one, and no spike is lost.
    flat = fired(source(Gamma(0.5), 1000.0, 20), np.zeros((1, 4, 2)), dt_ms=0.5)
    assert not flat.duplicated(["channel", "neuron", "time_ms"]).any()
    assert len(flat) == pytest.approx(40 * 1000 * 0.2, rel=0.08)


@pytest.mark.parametrize("engine", [name for name in SPIKING if name != "plain"])
@pytest.mark.parametrize("hz", [3.0, 40.0, 900.0], ids=["rare", "usual", "twice a tick"])
def test_all_engines_draw_the_same_trains(engine, hz):
    drive = np.random.default_rng(1).normal(0, 0.4, (2, 3, 2)).cumsum(axis=1)
    circuit = source(Gamma(0.7), hz, 40, heterogeneity=0.2)
    circuit = circuit.with_population("ctx", gain_hz_per_nat=hz)
    options = {"dt_ms": 0.5}
    one, other = (trains(fired(circuit, drive, name, **options)) for name in (engine, "plain"))
    assert one.keys() == other.keys()
    for cell, times in one.items():
        npt.assert_allclose(times, other[cell], atol=1e-9)


@pytest.mark.parametrize("engine", SPIKING)
def test_without_bound_every_cell_fires_in_every_tick(engine):
    circuit = source(Phase(0.3), 10.0, 20, transfer="exp", tau_ms=2.0)
    table = fired(circuit, np.full((1, 1, 2), 55.0), engine, dt_ms=0.25)
    assert (table[table["time_ms"] > 25].groupby(["channel", "neuron"]).size() == 100).all()


def test_neurons_and_spikes_have_words_of_their_own():
    cells = np.repeat(np.arange(3000), 40)
    counts = np.tile(np.arange(40), 3000)
    key = noise.stream_key(1, 0, "GPe/0")
    words = noise.train_words(key, cells, counts)
    assert len(np.unique(words)) > len(words) - 10  # two of 120 000 fall together by chance
    assert kstest(words / 2**32, "uniform").pvalue > 1e-3
    pairs = words.reshape(3000, 40) / 2.0**32
    for one, other in ((pairs[:, :-1], pairs[:, 1:]), (pairs[:-1], pairs[1:])):
        assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 4 / np.sqrt(one.size)


@pytest.mark.parametrize(
    "quantiles",
    [
        lambda p: np.full_like(p, 1.5),
        lambda p: gamma.ppf(p, 2.0, scale=0.49),
        lambda p: 2 - 2 * p,
        lambda p: 2 * p - 0.1,
        lambda p: np.full_like(p, np.nan),
    ],
    ids=["mean above 1", "mean below 1", "falling", "negative", "nan"],
)
def test_quantiles_that_are_none_are_refused(quantiles):
    kind = register(kind_of(Gamma, "Wrong", interval_quantiles=lambda cell, p: quantiles(p)))
    for engine in SPIKING:
        circuit = BASE.with_population("STN", cell=kind(2.0))
        with refused("quantiles ^Wrong.interval_quantiles"):
            spikes_of(circuit, engine)


def test_a_type_without_spikes_transmits_its_line_whatever_it_derives_from():
    silent = register(kind_of(Phase, spikes=False))
    quiet, rate = (BASE.with_population("STN", cell=cell) for cell in (silent(0.3), Rate()))
    for engine in SPIKING:
        options = {"engine": engine, "step_ms": 10, "settle_ms": 5, "seed": 2}
        one, other = (run(circuit, np.ones((1, 2, 2)), **options) for circuit in (quiet, rate))
        npt.assert_array_equal(one.output_nats, other.output_nats)


def test_a_train_depends_neither_on_the_number_of_cells_nor_on_other_trials():
    few = trains(fired(source(Phase(0.5), 30.0, 20), np.zeros((2, 10, 2))))
    many = trains(fired(source(Phase(0.5), 30.0, 40), np.zeros((3, 10, 2))))
    assert 0 < len(few) < len(many)
    for cell, times in few.items():
        npt.assert_array_equal(times, many[cell])


@pytest.mark.parametrize("delay_ms", [0.25, 1.0], ids=["tick by tick", "four ticks"])
def test_clocks_may_leap_over_every_bucket(delay_ms):
    """Up to a hundred expected spikes in a tick."""
    drive = np.random.default_rng(2).uniform(0, 2e4, (8, 8, 2))
    circuit = source(Phase(0.3), 10.0, 20)
    for path in ("input->ctx", "ctx->SNr"):
        circuit = circuit.with_projection(path, delay_ms=delay_ms)
    both = (fired(circuit, drive, engine, step_ms=5) for engine in ("spikes", "plain"))
    one, other = map(trains, both)
    assert one.keys() == other.keys()
    for cell, times in one.items():
        npt.assert_allclose(times, other[cell], atol=1e-9)
