"""One table, all engines: the same answer where the theory gives one, the same spikes where not."""

from dataclasses import replace
from functools import cache

import numpy as np
import numpy.testing as npt
import pytest
from scipy.special import log_softmax, logsumexp

from circuits import anatomy
from circuits.cells import Phase, Rate
from circuits.declaration.rows import Projection
from circuits.dynamics.fixed_point import wired
from circuits.dynamics.ticks import Clock
from circuits.engines import ENGINES, engine_of, run
from tests.circuits.spiking import spike_set
from tests.helpers import refusing

SEED = 11
NOISY = [name for name, kind in ENGINES.items() if kind().noisy]
SPIKING = [name for name, kind in ENGINES.items() if kind.spiking]
DROPPING = [name for name, kind in ENGINES.items() if kind.threaded]
TIMED = [name for name, kind in ENGINES.items() if kind.timed]
NO_STEP = "50", 0, -1, np.nan, np.inf, None
CLOSE = {engine: 2e-5 if engine in ("rate", "population") else 1e-6 for engine in ENGINES}
"""Single and double precision, nats."""
TABLE = anatomy.spiking_msprt(3).with_neurons(20)
CENTRED = np.array([[1.1, -0.3, -0.8], [0.0, 0.0, 0.0], [-0.5, 1.5, -1.0]])
EXACT = -log_softmax(CENTRED, axis=1)


def all_of(circuit, drive, engine, **options):
    settings = {"step_ms": 100, "seed": SEED} | options
    return run(circuit, drive, engine=engine, **settings)


def held(circuit, engine):
    """Return the run of a drive that stays for 350 ms, 35 of the longest time constants."""
    settings = {"settle_ms": 0} if engine in TIMED else {}
    return all_of(circuit, CENTRED[:, None, :], engine, step_ms=350, **settings)


@pytest.mark.parametrize("name", TIMED)
def test_default_times_are_the_same_in_every_engine(name):
    """A sample per ms, 0.3 s to settle, and the longest tick that times and cells allow."""
    engine, clock = engine_of(name), Clock(1, 50)
    assert (engine.sample_ms, engine.settle_ms) == (clock.sample_ms, clock.settle_ms) == (1, 300)
    renewal, membranes = wired(anatomy.load_circuit("macaque", 2)), wired(TABLE)
    late = wired(renewal.circuit.with_projection("STN->GPe", delay_ms=3.3))
    ticks = [engine.clock(each, 1, 50).dt_ms for each in (renewal, membranes, late)]
    assert ticks == ([0.25, 0.1, 0.1] if engine.spiking else [0.5, 0.5, 0.1])
    assert replace(engine, dt_ms=0.1).clock(renewal, 1, 50).dt_ms == 0.1


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("circuit", [anatomy.bogacz_gurney(3), anatomy.appendix_b(3)])
def test_exact_tables_settle_at_the_log_posterior(engine, circuit):
    activity = held(circuit, engine)
    npt.assert_allclose(activity.output_nats[:, -1], EXACT, atol=CLOSE[engine], rtol=0)
    assert activity.engine == engine
    assert set(activity.rates_hz) == {row.name for row in circuit.populations}
    for rates in activity.rates_hz.values():
        assert rates.shape[:2] == (3, len(activity.time_ms))


def growing(trials, steps):
    """Evidence that grows for one channel in turn, at a different rate in each trial."""
    drive = np.zeros((trials, steps, 3))
    drive[np.arange(trials), :, np.arange(trials) % 3] = np.linspace(0, 4, steps)
    drive *= np.array([1, 0.3, 0.8, 0.2, 0.6, 0.4])[:trials, None, None]
    return drive - drive.mean(axis=2, keepdims=True)


COURSES = (
    "add dopamine amount=0.4 from_ms=20.05 to_ms=80 rise_ms=15 decay_ms=30",
    "add STN amount=-0.2 from_ms=5 to_ms=60",
    "add D1 amount=0.2 rise_ms=20",
)


@pytest.mark.parametrize(
    ("circuit", "level"), [(TABLE, 0.3), (TABLE.edited(*COURSES), 0.1)], ids=["unedited", "courses"]
)
@pytest.mark.parametrize("engine", DROPPING)
def test_a_dropped_trial_is_the_whole_one_cut_short(engine, circuit, level):
    drive = growing(6, 5)
    full_run = all_of(circuit, drive, engine)
    cut = all_of(circuit, drive, engine, drop_below=level)
    ends = []
    for full, short in zip(full_run.output_nats, cut.output_nats, strict=True):
        over = np.flatnonzero(full.min(axis=1) < level)
        ends.append(over[0] + 1 if len(over) else len(full))
        npt.assert_array_equal(short[: ends[-1]], full[: ends[-1]])
        assert np.isnan(short[ends[-1] :]).all()
    assert len(set(ends)) > 2
    assert len(full_run.time_ms) in ends
    for name, rates in cut.rates_hz.items():
        for end, full, short in zip(ends, full_run.rates_hz[name], rates, strict=True):
            npt.assert_array_equal(short[:end], full[:end])
            assert np.isnan(short[end:]).all()


@pytest.mark.parametrize("engine", DROPPING)
def test_rates_can_be_left_out(engine):
    drive = growing(2, 2)
    without = all_of(TABLE, drive, engine, rates=False)
    assert without.rates_hz == {}
    npt.assert_array_equal(without.output_nats, all_of(TABLE, drive, engine).output_nats)


@pytest.mark.parametrize("engine", DROPPING)
def test_a_trial_with_courses_does_not_depend_on_those_beside_it(engine):
    """More trials than run side by side, some of them over early: others take their place."""
    circuit = TABLE.edited(*COURSES)
    drive = np.tile(growing(6, 2), (12, 1, 1))
    together = all_of(circuit, drive, engine, drop_below=0.9, settle_ms=50)
    for trial in (0, 65, 71):
        alone = all_of(circuit, drive[trial : trial + 1], engine, settle_ms=50, first_trial=trial)
        kept = np.isfinite(together.output_nats[trial])
        npt.assert_array_equal(together.output_nats[trial][kept], alone.output_nats[0][kept])


ONE = TABLE.scale("ctx->D1", 0.8, 1).scale("STN->SNr", 1.2, 0).scale("D2->GPe", 0, 2)
"""Weights of one channel, followed by lesions of one channel."""
LOST = ONE.lesion("GPe", 0.25, channel=0).lesion("D2", 1, channel=1).lesion("STN", 0.1)


Y = CENTRED + anatomy.bogacz_gurney(3).reference_nats - np.log(3)
# D1 subtracts its channel's y from OUT; Sigma is ln sum exp y over the surviving STN.
CLOSED_FORMS = {
    "lesion D1[1] 10%": EXACT + 0.1 * Y * [0, 1, 0],
    "scale D1->SNr[1] 0.9": EXACT + 0.1 * Y * [0, 1, 0],
    "lesion STN[0] 25%": logsumexp(Y, axis=1, b=[0.75, 1, 1], keepdims=True) - Y,
    "lesion STN 40%": EXACT + np.log(0.6),
}


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("edit", CLOSED_FORMS)
def test_an_edit_has_its_closed_form_on_every_engine(edit, engine):
    out = held(anatomy.bogacz_gurney(3).edited(edit), engine).output_nats[:, -1]
    npt.assert_allclose(out, np.maximum(CLOSED_FORMS[edit], 0), atol=CLOSE[engine], rtol=0)


SHORT = {"step_ms": 40, "settle_ms": 20, "spikes": ("ctx", "D1", "STN", "GPe", "SNr")}


@cache
def in_plain(circuit):
    """Return the run of the readable engine, the slowest of all, once for each circuit."""
    return all_of(circuit, CENTRED[:, None, :], "plain", **SHORT)


@pytest.mark.parametrize("engine", [name for name in SPIKING if name != "plain"])
@pytest.mark.parametrize(
    "circuit",
    [
        TABLE,
        LOST,
        anatomy.macaque(3).with_neurons(20).edited(*COURSES),
        TABLE.edited(*COURSES).clamp("GPe", 0.3).with_heterogeneity(0.1),
    ],
    ids=["unedited", "one channel", "courses at terminals", "courses and a lesion"],
)
def test_same_input_same_noise_same_spikes(engine, circuit):
    fast = all_of(circuit, CENTRED[:, None, :], engine, **SHORT)
    plain = in_plain(circuit)
    assert spike_set(fast) == spike_set(plain)
    npt.assert_allclose(fast.output_nats, plain.output_nats, atol=1e-9)


# ---- the two spiking engines, spike by spike: the built-in circuits unedited, eight trials each,
# because one spike in 1e5 falls within a rounding of its threshold.

FULL = anatomy.spiking_msprt(2)
LOOP = Projection("GPe", "D2", -0.1, delay_ms=5, tau_ms=6)


def edited(number):
    """Return a circuit with some edits, drawn with a seed."""
    rng = np.random.default_rng(number)
    circuit = anatomy.spiking_msprt(int(rng.integers(2, 5))).dopamine(rng.uniform(0.8, 1.3))
    for p in rng.choice(np.array(circuit.projections), 3, replace=False):
        circuit = circuit.scale(p.pair, rng.uniform(0.5, 1.5))
    stn = circuit.population("STN").bias_nats + rng.normal(0, 0.1)
    circuit = circuit.with_population("STN", bias_nats=stn)
    return [
        circuit.with_rows(Projection("GPe", "GPe", -0.1, delay_ms=0.1, tau_ms=5)),
        circuit.clamp("STN", 0.4),
        circuit.with_population("STN", cell=Phase(0.9)),
        circuit.with_heterogeneity(0.2),
    ][number % 4]


@pytest.mark.parametrize(
    "circuit",
    [
        pytest.param(FULL, id="shipped"),
        pytest.param(FULL.with_rows(LOOP), id="GPe->D2", marks=pytest.mark.validate),
        pytest.param(FULL.dopamine(1.1), id="dopamine", marks=pytest.mark.validate),
        pytest.param(FULL.edited(*COURSES), id="courses", marks=pytest.mark.validate),
        # A delay of one tick, for which the compiled loop is compiled once more.
        pytest.param(edited(0), id="loop", marks=pytest.mark.validate),
        pytest.param(edited(1), id="lesion"),
        pytest.param(edited(2), id="irregular"),
        pytest.param(edited(3), id="spread"),
    ],
)
def test_an_edit_leaves_the_spiking_engines_with_the_same_spikes(circuit):
    walk = np.random.default_rng(2).normal(0, 0.4, (8, 2, circuit.channels)).cumsum(axis=1)
    names = circuit.spiking()
    options = {"step_ms": 30, "settle_ms": 0, "seed": 1, "spikes": names}
    fast = run(circuit, walk, engine="spikes", **options)
    plain = run(circuit, walk, engine="brian2", **options)
    assert spike_set(fast) == spike_set(plain)
    npt.assert_allclose(fast.output_nats, plain.output_nats, rtol=0, atol=1e-12)


def test_courses_act_through_connections_cell_by_cell_as_through_whole_blocks():
    """Sparse inputs are summed in another order by the compiled engine: now and then a spike."""
    sparse = TABLE.with_connections(0.5).edited(*COURSES)
    drive = np.repeat(CENTRED[:1, None], 1, axis=1)
    names = ("D1", "D2", "SNr")
    options = {"step_ms": 70, "settle_ms": 10, "spikes": names}
    engines = ("plain", "brian2", "spikes")
    plain, brian2, fast = (all_of(sparse, drive, engine, **options) for engine in engines)
    for name in names:
        one, two, three = (spike_set(ran, name) for ran in (plain, brian2, fast))
        assert one == two
        assert len(one ^ three) <= 0.02 * len(one)
    without = all_of(sparse.steady, drive, "plain", **options)
    assert len(plain.spikes["D1"]) > 1.1 * len(without.spikes["D1"])
    # Synapses each for itself add up to the blocks' sums.
    whole = TABLE.edited(*COURSES)
    both = (all_of(whole, drive, "brian2", explicit=each, **options) for each in (False, True))
    npt.assert_allclose(*(ran.output_nats for ran in both), atol=1e-9)


@pytest.mark.parametrize("circuit", [anatomy.bogacz_gurney(3), TABLE], ids=["exact", "spiking"])
def test_rates_under_courses_are_alike(circuit):
    circuit = circuit.add("STN", amount=-0.2, from_ms=20, to_ms=120, rise_ms=15, decay_ms=30)
    drive = np.repeat(CENTRED[:1, None], 3, axis=1)
    rows = tuple(replace(p, cell=Rate(signed=p.cell.lowest_hz < 0)) for p in circuit.populations)
    circuit = replace(circuit, populations=rows)
    out = all_of(circuit, drive, "rate", dt_ms=0.1).output_nats
    for engine in SPIKING:
        npt.assert_allclose(all_of(circuit, drive, engine).output_nats, out, atol=0.02)


test_an_option_that_does_not_fit_is_refused_before_the_run = refusing(
    *(({"engine": name, "drive": CENTRED[:, None, :2]}, "drive") for name in ENGINES),
    *(({"engine": name, "step_ms": x}, "step_ms") for name in ENGINES for x in NO_STEP),
    *(({"engine": name, "seed": -1}, "seed") for name in TIMED),
    *(({"engine": name, "seed": None}, "seed") for name in NOISY),
    *(({"engine": name, "settle_ms": 0.05}, "settle_ms") for name in ENGINES),
    *(({"engine": name, "workers": 0}, "workers") for name in ENGINES),
    *(({"engine": name, "step_ms": 0.25}, "step_ms") for name in SPIKING),
    *(({"engine": name, "spikes": ("X",)}, "nucleus") for name in SPIKING),
    *(({"engine": name, "spikes": ("common",)}, "common") for name in SPIKING),
    *(({"engine": name, "spikes": ("STN",)}, "spikes") for name in ENGINES if name not in SPIKING),
    of=lambda options: all_of(TABLE, **{"drive": CENTRED[:, None]} | options),
)
