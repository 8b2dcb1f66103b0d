"""Cell types: each runs alike in all engines, and says what it lacks."""

from dataclasses import dataclass, replace

import numpy as np
import numpy.testing as npt
import pytest

from circuits import anatomy, single
from circuits.anatomy import CIRCUITS
from circuits.anatomy import circuit as circuit_named
from circuits.cells import CELLS, AdEx, Cell, Lif, Phase, Rate, register
from circuits.engines import ENGINES, run
from circuits.engines.ensemble import cells as compiled_cells
from circuits.laws.stability import growth
from circuits.spec import PATTERNS, Circuit, Population, Projection
from circuits.transfer import TRANSFERS

SPIKING = ("ensemble", "brian2", "plain")
NAMES = ("ctx", "D1", "STN", "GPe", "SNr")
BASE = anatomy.spiking_msprt(2).with_neurons(40)
# Brette & Gerstner 2005, table 1, over a leak of 30 nS; current and noise so that it fires as GPe.
ADEX = AdEx(
    tau_ms=9.37,
    noise_mv=4,
    knee_mv=-50.4,
    sharpness_mv=2,
    peak_mv=20,
    reset_mv=-70.6,
    refractory_ms=1,
    rest_mv=-52,
    mv_per_nat=13.56,
    tau_w_ms=144,
    adaptation=4 / 30,
    jump_mv=80.5 / 30,
    leak_mv=-70.6,
)
DRIVE = np.zeros((2, 3, 2))
DRIVE[0, :, 0] = DRIVE[1, :, 1] = np.array([0, 0.7, 1.4])
DRIVE -= DRIVE.mean(axis=2, keepdims=True)
GIVEN = {"step_ms": 40.0, "seed": 3, "settle_ms": 20.0}


@pytest.fixture(autouse=True)
def registry():
    """Cell types that a test registers go with it."""
    kept, loops = dict(CELLS), dict(compiled_cells._LOOPS)
    yield
    for known, before in ((CELLS, kept), (compiled_cells._LOOPS, loops)):
        known.clear()
        known.update(before)


def with_cell(circuit, name, cell):
    """Return a circuit where a population has another cell."""
    rows = (replace(p, cell=cell) if p.name == name else p for p in circuit.populations)
    return replace(circuit, populations=tuple(rows))


def spikes_of(circuit, engine, names=NAMES):
    found = run(circuit, DRIVE, engine=engine, spikes=names, **GIVEN)
    return {
        (name, *row)
        for name, table in found.spikes.items()
        for row in np.rint(table[["trial", "channel", "neuron", "time_ms"]] * 10)
        .astype(int)
        .itertuples(index=False)
    }


WITH_ADEX = with_cell(BASE, "GPe", ADEX)


# ---- the adaptive exponential cell


def test_an_adex_without_upstroke_and_adaptation_is_the_exact_linear_membrane():
    cell = replace(ADEX, sharpness_mv=1e-3, knee_mv=1000, peak_mv=2000, adaptation=0, jump_mv=0)
    c = cell.constants(np.ones(3), 0.1)
    _, v, w, _ = cell.tick(
        np.float64(0.3), single.single(4), *map(single.single, (5, 0, 0)), *c.values()
    )
    mean = cell.rest_mv + 0.3 * cell.mv_per_nat - cell.reset_mv
    assert v == pytest.approx(mean + (5 - mean) * np.exp(-0.1 / cell.tau_ms), rel=1e-6)
    assert w == 0


def test_adaptation_settles_where_it_follows_the_membrane():
    """With V held, W goes to a (V - E_L) with its own time constant."""
    cell = replace(ADEX, leak_mv=-75.0)
    c = cell.constants(np.ones(3), 0.1)
    v, w, held = 10.0, single.single(0), single.single(1e9)
    for _ in range(1440):
        _, _, w, _ = cell.tick(
            np.float64(0), single.single(4), single.single(v), w, held, *c.values()
        )
    settled = cell.adaptation * (v + cell.reset_mv - cell.leak_mv)
    assert w == pytest.approx(settled * (1 - np.exp(-1)), rel=1e-4)


def isi_ms(cell, nats, count=12):
    """Return the intervals of a noiseless cell under a constant input, by the tick."""
    c = list(replace(cell, noise_mv=1e-6).constants(np.ones(3), 0.01).values())
    state, times = tuple(map(single.single, (0, 0, 0))), []
    for k in range(400_000):
        fired, *state = cell.tick(np.float64(nats), single.single(4), *state, *c)
        if fired:
            times.append(k * 0.01)
        if len(times) > count:
            break
    return np.diff(times)


def solved_isi_ms(cell, nats, count=12):
    """Return the same intervals from the equations, by an adaptive solver."""
    from scipy.integrate import solve_ivp

    def flow(_, y):
        v, w = y
        upstroke = cell.sharpness_mv * np.exp((v - cell.knee_mv) / cell.sharpness_mv)
        mean = cell.rest_mv + cell.mv_per_nat * nats
        return [
            (mean - v + upstroke - w) / cell.tau_ms,
            (cell.adaptation * (v - cell.leak_mv) - w) / cell.tau_w_ms,
        ]

    def peak(_, y):
        return y[0] - cell.peak_mv

    peak.terminal = True
    t, y, times = 0.0, [cell.reset_mv, 0.0], []
    while len(times) <= count:
        found = solve_ivp(flow, (t, t + 1000), y, events=peak, rtol=1e-8, atol=1e-8)
        t = found.t[-1] + cell.refractory_ms
        times.append(found.t[-1])
        w_leak = cell.adaptation * (cell.reset_mv - cell.leak_mv)
        w = found.y[1, -1] + cell.jump_mv
        w = w_leak + (w - w_leak) * np.exp(-cell.refractory_ms / cell.tau_w_ms)
        y = [cell.reset_mv, w]
    return np.diff(times)


def test_intervals_of_a_noiseless_adex_are_those_of_its_equations():
    cell = replace(ADEX, rest_mv=-40.0)
    found, solved = isi_ms(cell, 0.5), solved_isi_ms(cell, 0.5)
    print(np.round(found, 2), np.round(solved, 2))
    npt.assert_allclose(found, solved, rtol=0.01)
    assert found[-1] > 1.5 * found[0]  # it adapts


# ---- all engines alike


@pytest.mark.parametrize(
    "circuit",
    [WITH_ADEX, with_cell(BASE.with_spread(0.1), "GPe", ADEX), with_cell(BASE, "D1", ADEX)],
    ids=["GPe", "spread", "D1"],
)
def test_adex_cells_spike_alike_in_all_engines(circuit):
    found = [spikes_of(circuit, engine) for engine in SPIKING]
    assert found[0] == found[1] == found[2]
    assert len(found[0]) > 1000


def test_adex_cells_with_sparse_connections_spike_alike_up_to_single_precision():
    circuit = with_cell(BASE.with_connections(0.25), "GPe", ADEX)
    fast, brian, plain = (spikes_of(circuit, engine) for engine in SPIKING)
    assert brian == plain
    assert len(fast ^ plain) <= 0.03 * len(plain)


def own(circuit):
    """Return a circuit whose cell types are registered anew, alike in all but their name."""

    @register
    @dataclass(frozen=True)
    class OwnLif(Lif):
        pass

    @register
    @dataclass(frozen=True)
    class OwnPhase(Phase):
        pass

    twin = {Lif: OwnLif, Phase: OwnPhase, Rate: Rate}
    rows = (replace(p, cell=twin[type(p.cell)](**vars(p.cell))) for p in circuit.populations)
    return replace(circuit, populations=tuple(rows))


@pytest.mark.parametrize("spread", [0.0, 0.1])
def test_loops_of_their_own_give_the_spikes_of_the_tick_as_it_stands(spread):
    """The compiled engine's fast loops against its general one: the same type by another name."""
    circuit = BASE.with_spread(spread)
    twin = own(circuit)
    assert compiled_cells.entry(twin.population("GPe").cell) is compiled_cells.GENERAL
    assert compiled_cells.entry(circuit.population("GPe").cell) is not compiled_cells.GENERAL
    assert spikes_of(circuit, "ensemble") == spikes_of(twin, "ensemble")


def test_types_of_ones_own_with_sparse_connections_spike_as_in_the_plain_engine():
    twin = own(BASE.with_connections(0.25).with_spread(0.1))
    fast, plain = spikes_of(twin, "ensemble"), spikes_of(twin, "plain")
    assert len(fast ^ plain) <= 0.03 * len(plain)


def test_another_window_or_recording_changes_no_spike_of_a_type_of_ones_own(monkeypatch):
    from circuits.engines.ensemble import kernel

    given = GIVEN | {"step_ms": 20.1, "sample_ms": 0.3, "settle_ms": 20.3}
    whole = run(WITH_ADEX, DRIVE, engine="ensemble", spikes=NAMES, **given)
    unrecorded = run(WITH_ADEX, DRIVE, engine="ensemble", **given)
    monkeypatch.setattr(kernel, "WINDOW", 1)
    one = run(WITH_ADEX, DRIVE, engine="ensemble", spikes=NAMES, **given)
    for other in (unrecorded, one):
        assert other.output_nats.tobytes() == whole.output_nats.tobytes()


# ---- what is lacking is said


def lacking(engine="ensemble", **options):
    def call(circuit):
        given = GIVEN if engine in SPIKING else {"step_ms": 40.0}
        return run(circuit, DRIVE, engine=engine, **given | options)

    return call


@pytest.mark.parametrize(
    ("call", "answer", "user"),
    [
        (lacking("algebra", laws="cells"), "rate_hz", 'laws="cells"'),
        (lacking("algebra", laws="finite"), "rate_hz", 'laws="cells"'),
        (lacking("rate"), "membrane_ms", "rates with time constants and stability"),
        (growth, "membrane_ms", "rates with time constants and stability"),
    ],
)
def test_an_adex_without_laws_says_so(call, answer, user):
    with pytest.raises(ValueError, match="have it") as error:
        call(WITH_ADEX)
    said = str(error.value)
    assert said == f"{user} needs AdEx.{answer}, and AdEx cells do not have it"


def test_a_law_of_the_mean_alone_is_not_taken_for_the_law_of_fluctuations():
    @register
    @dataclass(frozen=True)
    class Half(AdEx):
        def rate_hz(self, x, line_hz):
            return line_hz

    circuit = with_cell(BASE, "GPe", Half(**vars(ADEX)))
    lacking("algebra", laws="cells")(circuit)
    with pytest.raises(ValueError, match=r'laws="finite" needs Half\.response, and Half cells'):
        lacking("algebra", laws="finite")(circuit)


def test_a_type_that_only_names_its_state_lacks_every_step():
    @register
    @dataclass(frozen=True)
    class Bare(Cell):
        state = ("v",)

    circuit = with_cell(BASE, "GPe", Bare())
    for engine in SPIKING:
        with pytest.raises(ValueError, match=r"needs Bare\.\w+, and Bare cells do not have it"):
            lacking(engine)(circuit)


def test_a_type_without_a_text_is_refused_by_brian2_alone():
    @register
    @dataclass(frozen=True)
    class Mute(Phase):
        brian = None

    circuit = with_cell(BASE, "STN", Mute(0.3))
    with pytest.raises(ValueError, match=r"the brian2 engine needs Mute\.brian"):
        lacking("brian2")(circuit)
    assert spikes_of(circuit, "ensemble") == spikes_of(circuit, "plain")


@pytest.mark.parametrize(
    ("tick", "says"),
    [
        (lambda heard, ones, v: (v > single.ONE, v), r"tick must take .* constants"),
        (
            lambda heard, ones, phi, noise_step, factor: (
                phi > single.ONE,
                single.fused(heard, phi, phi),
            ),
            "on numbers in single precision",
        ),
        (
            lambda heard, ones, phi, noise_step, factor: (phi > single.ONE, phi + 0.5),
            "on numbers in single precision",
        ),
    ],
    ids=["names", "double into fused", "a literal"],
)
def test_a_tick_that_would_round_otherwise_when_compiled_is_refused(tick, says):
    function = tick

    @register
    @dataclass(frozen=True)
    class Wrong(Phase):
        tick = staticmethod(function)

    with pytest.raises(ValueError, match=says):
        lacking("ensemble")(with_cell(BASE, "STN", Wrong(0.3)))


# ---- every unknown name gets one sentence


def one_sentence(call, *parts):
    with pytest.raises(ValueError, match=r".") as error:
        call()
    said = str(error.value)
    assert "\n" not in said
    for part in parts:
        assert part in said
    return said


def test_an_unknown_cell_is_refused_wherever_one_is_named():
    @dataclass(frozen=True)
    class Unregistered(Phase):
        pass

    for cell in (Unregistered(0.3), "lif", None, Lif, 3):
        one_sentence(lambda c=cell: Population("X", c), "X: cell must be one of", "Lif")
        one_sentence(lambda c=cell: with_cell(BASE, "GPe", c), "GPe: cell must be one of")


def test_a_type_that_cannot_be_one_is_refused_at_registration():
    class Plain(Cell):
        pass

    @dataclass(frozen=True)
    class Deaf(Cell):
        hears = "mv"
        state = ("v",)

    @dataclass(frozen=True)
    class Stateless(Cell):
        pass

    one_sentence(lambda: register(int), "subclass of circuits.cells.Cell")
    one_sentence(lambda: register(Plain), "frozen=True")
    one_sentence(lambda: register(Deaf), "hears must be one of nats, hz")
    one_sentence(lambda: register(Stateless), "Stateless.state must name")
    twin = dataclass(frozen=True)(type("Lif", (Phase,), {"__module__": "elsewhere"}))
    one_sentence(lambda: register(twin), "there is a cell type Lif already")


@pytest.mark.parametrize("laws", ["lines", "", "Table", None])
@pytest.mark.parametrize("name", sorted(CIRCUITS))
def test_unknown_laws_are_refused_for_every_circuit(name, laws):
    circuit = circuit_named(name)
    silence = np.zeros((1, 1, circuit.channels))
    one_sentence(
        lambda: run(circuit, silence, engine="algebra", step_ms=1.0, laws=laws),
        "laws must be one of table, cells, finite",
    )


@pytest.mark.parametrize("engine", ["nest", "", "Algebra", "brian"])
def test_an_unknown_engine_is_refused(engine):
    one_sentence(
        lambda: run(BASE, DRIVE, engine=engine, step_ms=1.0), "engine must be one of", *ENGINES
    )


@pytest.mark.parametrize("name", ["tanh", "Linear", "average", ""])
def test_unknown_transfers_and_patterns_are_refused_wherever_they_are_named(name):
    for call in (
        lambda: Population("X", Rate(), transfer=name),
        lambda: Projection("ctx", "D1", 1, transfer=name),
    ):
        one_sentence(call, "transfer must be one of", *TRANSFERS)
    one_sentence(lambda: Projection("ctx", "D1", 1, pattern=name), "pattern must be", *PATTERNS)


def test_an_unknown_circuit_is_refused():
    one_sentence(lambda: circuit_named("gpr2"), "circuit must be one of", *CIRCUITS)


def test_a_transfer_that_an_engine_does_not_know_is_refused_by_it(monkeypatch):
    monkeypatch.setitem(TRANSFERS, "square", TRANSFERS["rectified"])
    rows = (replace(p, transfer="square") if p.name == "ctx" else p for p in BASE.populations)
    circuit = replace(BASE, populations=tuple(rows))
    one_sentence(lambda: lacking("ensemble")(circuit), "transfers", "square", "brian2")
    assert isinstance(circuit, Circuit)
    assert lacking("plain")(circuit).output_nats.shape == (2, 120, 2)


def test_every_registered_type_answers_or_raises_in_every_engine():
    """No engine and no law takes a cell type for another: each runs, or names type and answer."""
    made = {"Rate": Rate(), "Lif": BASE.population("GPe").cell, "Phase": Phase(0.3), "AdEx": ADEX}
    assert set(made) == set(CELLS)
    calls = [lacking(e) for e in SPIKING]
    calls = [
        *calls,
        lacking("rate"),
        *(lacking("algebra", laws=x) for x in ("table", "cells", "finite")),
    ]
    for name, cell in made.items():
        circuit = with_cell(BASE, "GPe", cell)
        for call in calls:
            try:
                right = np.isfinite(call(circuit).output_nats).all()
            except ValueError as error:
                right = f"{name} cells do not have it" in str(error)
            assert right


def test_the_exponential_of_all_engines_is_the_exponential():
    x = np.linspace(-40, 40, 4001).astype(np.float32)
    npt.assert_allclose(single.exponential(x), np.exp(x.astype(float)), rtol=5e-7)
    from circuits.engines.ensemble import lanes

    compiled = lanes.numba.njit(lambda values: [lanes.exp32(value) for value in values])(x)
    npt.assert_array_equal(np.array(compiled), single.exponential(x))
