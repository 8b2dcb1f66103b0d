"""Noise about the fixed point of circuits with pathways that bend.

Held to tangents, to closed forms of one loop, and to the population engine with many cells and few.
"""

from dataclasses import replace

import numpy as np
import pytest

from circuits import anatomy
from circuits.cells import Phase, Rate
from circuits.circuit import Circuit
from circuits.declaration import transfer
from circuits.declaration.rows import Population, Projection
from circuits.dynamics import fixed_point
from circuits.engines import run
from circuits.laws.fluctuation import linear, out_variance, rate_spectrum, swept
from circuits.laws.mean_field import own_rates, settled
from circuits.laws.stability import ringing
from tests.circuits.helpers import onset, run_algebra

S0 = 2.2
LAW = transfer.named("s_minus_log_s")
MANY = 10**9
REST, FAVOURED = (0.0, 0.0), (0.85, -0.85)


def spiking(channels=2, neurons=300):
    """Return the spiking table with S - ln S itself on the way to GPe, not its tangent."""
    table = anatomy.spiking_msprt(channels).with_neurons(neurons)
    table = table.with_projection("STN->GPe", weight=1.0, transfer="s_minus_log_s")
    return table.with_population("GPe", bias_nats=-float(LAW(S0)))


def uncommon(neurons=300):
    """Return the same without the common mode, so that S goes where the evidence takes it."""
    table = spiking(neurons=neurons).with_projection("STN->common", weight=0.0)
    return table.edited("set common.bias_nats=0", "set ctx.bias_nats=0")


def loop(neurons, *, delay_ms=0.0, rests_at=3.0):
    """Return one loop per channel of irregular STN, a synapse of 6 ms and a GPe of rate, 14 ms."""
    rest = float(LAW(rests_at))
    rows = (
        Population("STN", Phase(1.0), 0.0, 20.0, neurons=neurons, transfer="exp",
                   bias_nats=np.log(rests_at) + rest),
        Population("GPe", Rate(), 0.0, 50.0, "GABA", tau_ms=14.0),
    )  # fmt: skip
    paths = (
        Projection("STN", "GPe", 1.0, delay_ms=delay_ms, tau_ms=6.0, transfer="s_minus_log_s"),
        Projection("GPe", "STN", -1.0, delay_ms=delay_ms),
    )
    return Circuit("loop", rows, paths, 2, input="STN", readout="GPe", reference_nats=np.log(2))


def at_point(table, drive):
    """Return the wiring, the state and the units' activity at a held drive, cells' own laws."""
    wiring, held = fixed_point.wired(table), np.array([drive])
    x = settled(wiring, held, fixed_point.solve(wiring, held))
    return wiring, x, own_rates(wiring, x) @ wiring.deliver.T + wiring.constant


def straightened(table, drive):
    """Return the circuit with the tangent of what bends on the way to GPe."""
    wiring, _, activity = at_point(table, drive)
    path = table.projection("STN->GPe")
    unit = next(u for u in range(wiring.units) if wiring.projections[u] == path)
    s = activity[0, unit]
    slope = float(LAW.slope(s))
    bias = table.population("GPe").bias_nats + float(LAW(s)) - slope * s
    table = table.with_projection("STN->GPe", weight=slope, transfer="linear")
    return table.with_population("GPe", bias_nats=bias)


# ---- tangents


@pytest.mark.parametrize("drive", [REST, FAVOURED, (2.0, -2.0), (1.5, 0.3)])
@pytest.mark.parametrize("make", [spiking, uncommon])
def test_a_pathway_that_bends_fluctuates_as_its_tangent(make, drive):
    table, frequency = make(), np.geomspace(0.01, 500, 40)
    twin = straightened(table, drive)
    wiring, x, _ = at_point(table, drive)
    np.testing.assert_allclose(at_point(twin, drive)[1], x, atol=1e-9)
    for bent, straight in zip(
        linear(wiring, x, frequency), linear(fixed_point.wired(twin), x, frequency), strict=True
    ):
        np.testing.assert_allclose(bent, straight, rtol=1e-12, atol=1e-15)


# ---- one loop, in closed form


def modes():
    """Return rates of decay, 1/s, and what a spike puts into each mode of (STN's sum, GPe), nats.

    Without delays a loop of s = STN's activity, u = its filtered sum and y = GPe's is
    ``6 ms du/dt = s exp(-dy) - u``, ``14 ms dy/dt = u - ln u - y``, about s = u = 3.
    """
    s, slope = 3.0, 1 - 1 / 3.0
    matrix = np.array([[-1, -s], [0, 0]]) / 0.006 + np.array([[0, 0], [slope, -1]]) / 0.014
    decay, vectors = np.linalg.eig(matrix.astype(complex))
    into = np.linalg.solve(vectors, np.array([1 / 0.006 / 20.0, 0], complex))
    return -decay, vectors * into


def covariance_of_one_cell():
    """Return that of (STN's sum, GPe), nats^2: renewal noise (Cox 1962) through the two modes."""
    hz, (decay, modes_) = 60.0, modes()

    def later(s):
        passed = np.exp(1 - np.sqrt(1 + 2 * s / hz))
        return passed / (1 - passed)

    a, b = decay[:, None], decay[None]
    between = hz / (a + b) * (1 + later(a) + later(b)) - hz**2 / (a * b)
    return (modes_ @ between @ modes_.T).real


def test_one_loop_has_the_variance_and_the_spectrum_of_its_two_modes():
    table, frequency = loop(MANY), np.array([0.5, 5.0, 20.0, 60.0, 200.0])
    known = covariance_of_one_cell()[1, 1]
    # Power is summed up to 1 000 Hz.
    assert out_variance(table)["STN"][0] * MANY == pytest.approx(known, rel=0.003)
    decay, modes_ = modes()
    answer = (modes_[1] / (2j * np.pi * frequency[:, None] + decay)).sum(axis=1)
    gap = np.exp(1 - np.sqrt(1 - 4j * np.pi * frequency / 60.0))
    spikes = 60.0 * (1 - np.abs(gap) ** 2) / np.abs(1 - gap) ** 2
    # One-sided, Hz, two channels averaged.
    power = 2 * np.abs(50.0 * answer) ** 2 * spikes / 2
    spectrum = rate_spectrum(table, "GPe", frequency) * MANY
    np.testing.assert_allclose(spectrum, power, rtol=1e-8)


def test_noise_moves_the_mean_of_a_loop_where_cells_and_pathways_bend():
    """Half of it is S - ln S's: ``dy (1 + f' s) = f' s var(y)/2 + f'' var(u)/2``."""
    cells, (s, slope, curvature) = 10**6, (3.0, 2 / 3, 1 / 9)
    sums, gpe = np.diag(covariance_of_one_cell())
    by_cells = slope * s * gpe / 2 / (1 + slope * s)
    known = by_cells + curvature * sums / 2 / (1 + slope * s)
    assert known > 1.9 * by_cells
    silence = np.zeros((1, 1, 2))
    both = (run_algebra(loop(cells), silence, laws=laws) for laws in ("finite", "table"))
    finite, table = (each.output_nats[0, 0, 0] for each in both)
    assert (finite - table) * cells == pytest.approx(known, rel=0.02)


# ---- measured


def measured(cells, *, trials=128):
    """Return variance and mean shift of a delayed loop's GPe, times cells, with standard errors."""
    table = loop(cells, delay_ms=2.0)
    out = run(table, np.zeros((trials, 20, 2)), engine="population", step_ms=1000.0, seed=5,
              sample_ms=20.0, settle_ms=500.0, rates=False).output_nats[:, 2:]  # fmt: skip
    parts = out.swapaxes(1, 2).reshape(2 * trials, -1)
    of = ((parts - out.mean()) ** 2).mean(axis=1), parts.mean(axis=1) - float(LAW(3.0))
    return [(cells * part.mean(), cells * part.std() / np.sqrt(len(parts))) for part in of]


@pytest.mark.filterwarnings("ignore:.*cells")
def test_linear_noise_of_a_loop_is_met_as_cells_grow():
    """Within the error of sampling from 300 cells on; with fewer it is off by 1/n."""
    off = {}
    for cells in (10, 30, 300, 30_000):
        (variance, error), (shift, shift_error) = measured(cells)
        table = loop(cells, delay_ms=2.0)
        known = cells * out_variance(table)["STN"][0]
        finite = run_algebra(table, np.zeros((1, 1, 2)), laws="finite").output_nats[0, 0, 0]
        moved = cells * (finite - float(LAW(3.0)))
        off[cells] = variance / known - 1
        if cells >= 300:
            assert abs(variance - known) < 3 * error
        if cells >= 30:
            assert abs(shift - moved) < 3 * shift_error + 0.05 * moved
    assert 2 < off[10] / off[30] < 6  # 3 if it goes as 1/n
    assert abs(off[30]) < 0.04


@pytest.mark.parametrize(("make", "drive"), [(spiking, FAVOURED), (uncommon, (1.5, 0.3))])
def test_out_of_30_000_cells_scatters_as_computed(make, drive):
    """The tangent at rest would not do where S moves: for the second, Sigma is 3.3, not 2.2."""
    table = make(neurons=30_000)
    held = np.tile(np.array(drive), (256, 6, 1))
    out = run(table, held, engine="population", step_ms=1000.0, seed=5, sample_ms=5.0,
              settle_ms=1500.0, rates=False).output_nats[:, 200::20, 0]  # fmt: skip
    parts = ((out - out.mean()) ** 2).mean(axis=1)
    error = parts.std() / np.sqrt(len(parts))
    known = sum(part[0] for part in out_variance(table, drive).values())
    assert abs(parts.mean() - known) < 3 * error
    assert error < 0.02 * known


# ---- where it does not hold


def test_noise_is_refused_from_the_onset_of_oscillation_on():
    """Of a loop of rates, whose onset is known: 2 % below it is given, 2 % above refused."""
    limit, _ = onset(lambda delay_ms: loop(300, delay_ms=delay_ms), 1, 20)
    below = out_variance(loop(MANY, delay_ms=0.98 * limit))["STN"][0]
    assert below > 3 * out_variance(loop(MANY, delay_ms=0.7 * limit))["STN"][0]
    with pytest.raises(ValueError, match="the fixed point of loop is unstable"):
        out_variance(loop(MANY, delay_ms=1.02 * limit))


def test_power_does_not_depend_on_the_other_frequencies_asked_for():
    table, asked = loop(300, delay_ms=4.0), np.array([60.0, 8.0, 30.0])
    every = rate_spectrum(table, "STN", asked)
    alone = [rate_spectrum(table, "STN", asked[[i]])[0] for i in range(3)]
    np.testing.assert_allclose(alone, every, rtol=1e-12)


def kinked(*, source_nats=0.0, target_nats=1.0, path="linear", row="linear", baseline_hz=40.0):
    """Return a source and a target of noisy cells, one pathway between them."""
    rows = (
        Population("source", Phase(1.0), baseline_hz, 20.0, neurons=100, bias_nats=source_nats),
        Population("target", Phase(0.5), 10.0, 10.0, transfer=row, bias_nats=target_nats),
    )
    link = Projection("source", "target", 1.0, tau_ms=4.0, transfer=path)
    table = Circuit("kinked", rows, (link,), 2, input="source", readout="target")
    return replace(table, reference_nats=np.log(2))


def test_out_is_the_read_outs_rate_averaged_and_filtered():
    """Of each frequency sinc^2(f T) / (1 + (2 pi f tau)^2) is left; half of two channels' mean."""
    table = replace(kinked(), readout_tau_ms=16.0)
    wiring, x, _ = at_point(table, REST)
    frequency, _ = swept(wiring, x)
    power = 2 * rate_spectrum(table, "target", frequency) / 10.0**2
    angle = np.pi * frequency * 0.03
    left = (np.sin(angle) / angle) ** 2 / (1 + (2 * np.pi * frequency * 0.016) ** 2)
    variance = sum(part[0] for part in out_variance(table, mean_ms=30.0).values())
    assert variance == pytest.approx(np.trapezoid(power * left, frequency), rel=1e-9)


@pytest.mark.parametrize(
    ("fields", "where"),
    [
        ({"path": "rectified"}, "source->target"),
        ({"path": "ramp", "source_nats": 1.0}, "source->target"),
        ({"path": "s_minus_log_s"}, "source->target"),
        ({"row": "rectified", "target_nats": 0.0}, "target"),
        # 10 Hz + 10 Hz/nat ends at -1 nat.
        ({"target_nats": -1.0}, "target"),
    ],
)
def test_noise_right_at_a_kink_is_refused(fields, where):
    with pytest.raises(ValueError, match=f"^{where} of kinked is right at a kink"):
        out_variance(kinked(**fields))
    beside = fields | {"source_nats": fields.get("source_nats", 0.0) + 0.01}
    assert np.isfinite(out_variance(kinked(**beside))["source"]).all()


def test_a_silent_source_passes_no_noise_and_no_kink_is_in_its_way():
    """Its activity is 0 exactly, where a rectified pathway and S - ln S begin."""
    for path in ("rectified", "s_minus_log_s"):
        table = kinked(path=path, baseline_hz=0.0, source_nats=-1.0)
        whose = out_variance(table)
        assert not whose["source"].any()
        assert (whose["target"] > 0).all()


def test_a_loop_amplifies_more_where_evidence_drives_it():
    table = loop(300, delay_ms=2.0)
    assert ringing(table, (0.5, 0.5))[0] > ringing(table)[0] > 1
    assert ringing(table, (0.0, 0.0)) == ringing(table)


def test_a_change_of_rates_moves_along_the_bend_of_a_pathway():
    """S - ln S has the slope 1/2 at 2 nats, and 2/3 at 3, where the source has 20 Hz more."""
    wiring, x, activity = at_point(kinked(path="s_minus_log_s", source_nats=2.0), REST)
    np.testing.assert_allclose(activity, 2.0)
    source, target = (wiring.blocks_of(name)[0] for name in ("source", "target"))
    more = np.zeros((1, wiring.blocks))
    more[0, wiring.blocks_of("source")] = 20.0
    there, here = (linear(wiring, x, [5.0], extra).into[0, 0, target, source]
                   for extra in (more, 0.0))  # fmt: skip
    assert there / here == pytest.approx((2 / 3) / (1 / 2), rel=1e-9)
