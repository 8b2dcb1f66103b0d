"""The compiled engine: the spikes of the plain scheme, whatever runs beside them."""

from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest

from circuits import anatomy, noise
from circuits.engines import plain as plain_engine
from circuits.engines.ensemble import kernel, lanes
from circuits.engines.ensemble import run as ensemble
from circuits.spec import Projection
from circuits.ticks import cell_factors, spike_hz

NAMES = ("ctx", "D1", "D2", "STN", "GPe", "SNr")
BASE = anatomy.spiking_msprt(2).with_neurons(40)


def ramp(trials, steps, channels=2, top=1.4):
    """Evidence that grows for a channel in turn, (trials, steps, channels)."""
    drive = np.zeros((trials, steps, channels))
    drive[np.arange(trials), :, np.arange(trials) % channels] = np.linspace(0, top, steps)
    return drive - drive.mean(axis=2, keepdims=True)


def spike_set(table):
    ticks = np.rint(table["time_ms"] / 0.1).astype(int)
    return set(zip(table["trial"], table["channel"], table["neuron"], ticks, strict=True))


def both(circuit, drive, **options):
    given = {"step_ms": 40, "seed": 7, "settle_ms": 60, "spikes": NAMES} | options
    return ensemble.run(circuit, drive, **given), plain_engine.run(circuit, drive, **given)


@pytest.mark.parametrize(
    "circuit",
    [
        BASE,
        BASE.without("GPe", 0.5, replaced=True),
        BASE.scaled("STN", "GPe", 0.5),
        BASE.with_spread(0.1),
        BASE.with_spread(0.3),
    ],
    ids=["plain", "lesion", "scaled", "spread", "wide spread"],
)
def test_cells_spike_as_in_the_plain_scheme(circuit):
    fast, plain = both(circuit, ramp(4, 2), settle_ms=0)
    npt.assert_allclose(fast.output_nats, plain.output_nats, atol=1e-9)
    for name in NAMES:
        assert spike_set(fast.spikes[name]) == spike_set(plain.spikes[name])
        npt.assert_allclose(fast.rates_hz[name], plain.rates_hz[name], atol=1e-3)


@pytest.mark.parametrize(
    "circuit",
    [
        BASE.with_connections(0.25),
        BASE.with_connections(0.25).scaled("ctx", "D1", 0.9, 0).scaled("STN", "GPe", 0, 1),
        BASE.with_spread(0.1).with_connections(0.25),
    ],
    ids=["sparse", "one channel", "both"],
)
def test_sparse_inputs_make_cells_spike_so_up_to_single_precision(circuit):
    fast, plain = both(circuit, ramp(2, 3))
    for name in NAMES:
        a, b = spike_set(fast.spikes[name]), spike_set(plain.spikes[name])
        # A potential within a rounding of the threshold fires a tick early or late, and takes
        # with it the later spikes of its cell.
        assert len(a ^ b) <= 0.03 * len(b)
    npt.assert_allclose(fast.output_nats, plain.output_nats, atol=0.03)


def test_another_seed_or_trial_has_other_spikes():
    one = ensemble.run(BASE, ramp(1, 2), step_ms=40, seed=7, spikes=("STN",)).spikes["STN"]
    two = ensemble.run(BASE, ramp(1, 2), step_ms=40, seed=8, spikes=("STN",)).spikes["STN"]
    third = ensemble.run(BASE, ramp(1, 2), step_ms=40, seed=7, first_trial=1, spikes=("STN",))
    for other in (two, third.spikes["STN"]):
        assert len(spike_set(one) & spike_set(other)) < 0.1 * len(one)


@pytest.mark.parametrize("wiring_seed", [0, 1])
def test_cells_differ_channels_do_not(wiring_seed):
    """Without the mean of 1 the favoured channel's OUT lay .024 and .027 nats off the other's."""
    table = replace(anatomy.spiking_msprt(2).with_spread(0.1), wiring_seed=wiring_seed)
    for name in NAMES:
        factors = cell_factors(table, name, 1)
        npt.assert_allclose(factors.mean(axis=1), 1, rtol=1e-12)
        npt.assert_allclose(factors.std(axis=1), 0.1, rtol=0.2)
    drive = np.array([[[0.85, -0.85]], [[-0.85, 0.85]]]).repeat(8, axis=0)
    found = ensemble.run(table, drive, step_ms=1500, seed=9, rates=False, sample_ms=5.0)
    mean = found.output_nats[:, 100:].mean(axis=1)
    assert abs(mean[:8, 0].mean() - mean[8:, 1].mean()) < 0.012


@pytest.mark.parametrize("circuit", [BASE, BASE.with_spread(0.1).with_connections(0.25)])
def test_the_same_bytes_for_any_batch_order_and_number_of_workers(circuit):
    drive = ramp(20, 3)
    given = {"step_ms": 20, "seed": 3, "settle_ms": 20}
    whole = ensemble.run(circuit, drive, **given)
    threads = ensemble.run(circuit, drive, workers=2, **given)
    parts = [ensemble.run(circuit, drive[i : i + 7], first_trial=i, **given) for i in (14, 0, 7)]
    batches = np.concatenate([parts[1].output_nats, parts[2].output_nats, parts[0].output_nats])
    assert whole.output_nats.tobytes() == threads.output_nats.tobytes() == batches.tobytes()
    for name in NAMES:
        assert whole.rates_hz[name].tobytes() == threads.rates_hz[name].tobytes()


@pytest.mark.parametrize(
    "circuit", [BASE, BASE.with_spread(0.1), BASE.with_spread(0.1).with_connections(0.25)]
)
def test_neither_windows_nor_recording_change_a_spike(circuit, monkeypatch):
    given = {"step_ms": 20.1, "sample_ms": 0.3, "seed": 3, "settle_ms": 20.3}
    whole = ensemble.run(circuit, ramp(2, 3), spikes=NAMES, **given)
    unrecorded = ensemble.run(circuit, ramp(2, 3), **given)
    monkeypatch.setattr(kernel, "WINDOW", 1)
    one = ensemble.run(circuit, ramp(2, 3), spikes=NAMES, **given)
    for other in (unrecorded, one):
        assert other.output_nats.tobytes() == whole.output_nats.tobytes()
    for name in NAMES:
        assert one.spikes[name].equals(whole.spikes[name])


def test_what_lies_downstream_never_changes_what_lies_upstream():
    drive = ramp(2, 2)
    given = {"step_ms": 40, "seed": 3, "spikes": ("ctx", "D1", "STN", "GPe")}
    whole = ensemble.run(BASE, drive, **given).spikes
    edits = [
        BASE.with_population("SNr", neurons=10).with_cell("SNr", noise_mv=1.0),
        BASE.without("D1", 0.5),
        BASE.scaled("STN", "SNr", 0.2),
    ]
    for edited in edits:
        for name, table in ensemble.run(edited, drive, **given).spikes.items():
            assert spike_set(table) == spike_set(whole[name])


def test_more_spikes_than_room_are_all_there(monkeypatch):
    plenty = ensemble.run(BASE, ramp(1, 2), step_ms=40, seed=7, spikes=NAMES).spikes
    monkeypatch.setattr(ensemble, "FIRST_CAPACITY", 5)
    little = ensemble.run(BASE, ramp(1, 2), step_ms=40, seed=7, spikes=NAMES).spikes
    for name in NAMES:
        assert spike_set(little[name]) == spike_set(plenty[name])


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: ensemble.run(BASE, ramp(1, 2), step_ms=40, seed=-1), "seed must be"),
        (lambda: ensemble.run(BASE, ramp(1, 2), step_ms=0.25, seed=1), "no multiple of dt_ms"),
        (lambda: ensemble.run(BASE, ramp(1, 2, 3), step_ms=40, seed=1), "3 hypotheses"),
        (lambda: ensemble.run(BASE, ramp(1, 2), step_ms=40, seed=1, spikes=("X",)), "no nucleus"),
        (
            lambda: ensemble.run(BASE, ramp(1, 2), step_ms=40, seed=1, spikes=("common",)),
            "no cells that spike",
        ),
        (lambda: ensemble.run(BASE, ramp(1, 2), step_ms=40, seed=1, workers=0), "workers must be"),
    ],
)
def test_bad_input_gets_one_clear_sentence(call, says):
    with pytest.raises(ValueError, match=says):
        call()


def test_drive_beyond_the_range_warns_once_with_the_number():
    with pytest.warns(UserWarning, match=r"S runs from .* to 2\d\.\d\d nats") as caught:
        ensemble.run(BASE, ramp(3, 2, top=40.0), step_ms=20, seed=1)
    assert len(caught) == 1


# ---- the loops, against plain NumPy


def filled(cells, value=0.0):
    return np.full(cells, value, np.float32)


def whole_key(stream, tick):
    high, low = noise.tick_key(stream, tick)
    return np.uint64(high << 32 | low)


def four(*values):
    return tuple(np.float32(value) for value in values)


def test_words_are_those_of_noise():
    stream = noise.stream_key(7, 3, "GPe")
    counts = np.zeros(128, np.uint32)
    lanes.refresh(counts, 0, 128, whole_key(stream, 5))
    npt.assert_array_equal(counts, noise.byte_counts(noise.words(stream, 5, 128)))
    v = filled(128)
    lanes.begin(v, 0, 100, 128, whole_key(stream, 5), np.float32(0), np.float32(1))
    npt.assert_allclose(v[:100], noise.uniform(stream, 5, 100), atol=1e-7)
    assert (v[100:] == -np.inf).all()


def test_exp32_is_the_exponential():
    @lanes.numba.njit
    def table(x):
        return np.array([lanes.exp32(value) for value in x])

    x = np.linspace(-20, 20, 4001).astype(np.float32)
    npt.assert_allclose(table(x), np.exp(x.astype(float)), rtol=4e-7)


def test_lif_loop_against_numpy():
    rng = np.random.default_rng(1)
    v = rng.uniform(-5, 11, 128).astype(np.float32)
    v[3], v[4], v[5] = -lanes.WAIT, -2 * lanes.WAIT, -np.inf
    counts = rng.integers(0, 9, (128, 4)).astype(np.uint8).view(np.uint32).ravel()
    mean_step, noise_step = (0.2, 0.1, 0.4, 0.3), np.float32(0.3)
    expected, marks, spikes = v.copy(), np.zeros(128, np.uint8), np.zeros((4, 128), bool)
    for t in range(4):
        waiting = expected < lanes.WAITING
        moved = 0.99 * expected + mean_step[t] + 0.3 * (counts >> 8 * t & 15)
        expected = np.where(waiting, expected + lanes.WAIT, moved)
        spikes[t] = expected >= 11
        expected[spikes[t]] = -20 * lanes.WAIT
    constants = (
        np.float32(0.99),
        four(*mean_step),
        noise_step,
        np.float32(11),
        np.float32(-20 * lanes.WAIT),
    )
    again = v.copy()
    fired = lanes.lif_identical(v, counts, 0, 128, lanes.FOUR, *constants, None)
    lanes.lif_identical(again, counts, 0, 128, lanes.FOUR, *constants, marks)
    assert fired == tuple(spikes.sum(axis=1))
    assert min(fired) > 0
    npt.assert_array_equal(marks, spikes.T @ [1, 2, 4, 8])
    npt.assert_array_equal(again, v)
    npt.assert_allclose(v, expected, rtol=1e-5, atol=1e-5)
    assert v[3] < 11


def test_a_tick_of_a_lif_is_the_exact_solution_of_its_equation():
    cell = BASE.population("GPe").cell
    factors = np.random.default_rng(3).uniform(0.7, 1.3, (3, 50))
    tau, slope, top = factors
    c = cell.constants(factors, 0.1)
    npt.assert_allclose(
        c["threshold"] / c["unit"], cell.sampled_threshold_mv(0.1, tau, top) - 3, rtol=1e-6
    )
    alpha = np.exp(-0.1 / (cell.tau_ms * tau))
    for v, nats, ones in ((3.0, -0.5, 4), (9.0, 0.3, 0), (14.0, 0.0, 7)):
        mean = cell.rest_mv + cell.mv_per_nat * slope * nats
        step = cell.noise_mv * np.sqrt(1 - alpha**2)
        exact = mean + (v - mean) * alpha + step * (ones - 4) / np.sqrt(2)
        kept = c["decay"] * c["unit"] * (v - cell.reset_mv)
        moved = kept + (c["rest"] + c["slope"] * nats + c["noise_step"] * ones)
        npt.assert_allclose(cell.reset_mv + moved / c["unit"], exact, rtol=1e-6)


@pytest.mark.parametrize("neurons", [1, 12, 300, 7000])
def test_the_rate_of_a_tick_is_exact_in_whatever_order_spikes_are_added(neurons):
    each = spike_hz(neurons, 0.1)
    npt.assert_allclose(each, 1e4 / neurons, rtol=1e-12)
    one_by_one = np.cumsum(np.full(neurons, each))
    npt.assert_array_equal(one_by_one, each * np.arange(1, neurons + 1))


def test_phase_loop_against_numpy():
    rng = np.random.default_rng(2)
    v = rng.uniform(0, 1.05, 128).astype(np.float32)
    counts = rng.integers(0, 9, 128).astype(np.uint32)
    expected = v - (v >= 1) + 0.01 + 0.02 * counts
    mean_step, noise_step = four(0.01, 0, 0, 0), four(0.02, 0, 0, 0)
    for marks in (None, np.zeros(128, np.uint8)):
        x = v.copy()
        fired = lanes.phase_identical(x, counts, 0, 128, lanes.SINGLE, mean_step, noise_step, marks)
        npt.assert_allclose(x, expected, rtol=1e-5)
        assert (fired[0] if marks is None else marks.sum()) == (expected >= 1).sum() > 0


def test_compiled_code_is_kept_under_a_hash_of_all_sources():
    from circuits.engines.ensemble import compiling

    for function in (kernel.trial, lanes.lif_identical):
        assert compiling.STATE in function.stats.cache_path


def test_strong_inhibition_is_not_taken_for_a_refractory_period():
    fast, plain = both(BASE.scaled("D1", "SNr", 60), ramp(2, 3, top=3.0))
    assert spike_set(fast.spikes["SNr"]) == spike_set(plain.spikes["SNr"])


def test_an_edit_without_a_state_of_rest_warns():
    runaway = BASE.with_rows(Projection("STN", "STN", 0.5, "diffuse")).without("common")
    with pytest.warns(UserWarning, match="as edited has no state of rest"):
        ensemble.run(runaway, ramp(1, 1), step_ms=20, seed=1, settle_ms=10)
