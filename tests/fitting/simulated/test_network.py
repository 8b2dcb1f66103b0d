"""The network of the circuit's likelihood: what its graph must obey, and how near it is."""

import subprocess
import sys

import numpy as np
import pytest

from bgmodel import stream
from bgmodel.fitting.responses import BIN_S, Grid, responded
from bgmodel.fitting.simulated.circuit_model import CircuitModel
from bgmodel.fitting.simulated.crossings import DRIFTS
from bgmodel.fitting.simulated.error import decided
from bgmodel.fitting.simulated.network import INPUTS, PARAMETERS, LikelihoodNetwork, read_network
from circuits.anatomy import DEFAULT, load_circuit
from circuits.declaration.table_writer import identity
from figures.data import measure_hssm_check as hssm_check
from tests.helpers import refused

pytest.importorskip("onnx")

RT = Grid(500).middles_s
SEED = 24_601


@pytest.fixture(scope="module")
def network():
    return read_network()


@pytest.fixture(scope="module")
def graph(network):
    """Return the graph as a function of trials, evaluated by ONNX's own reference."""
    from onnx.reference import ReferenceEvaluator

    run = ReferenceEvaluator(network.model)
    return lambda trials: np.array(
        [run.run(None, {"trial": np.asarray(each, np.float32)})[0][0] for each in trials]
    )


def drawn(network, count=40):
    rng = stream(SEED, "trials")
    parameters = [rng.uniform(*network.bounds[name], count) for name in PARAMETERS]
    rt = parameters[2] + rng.uniform(-0.1, 3.0, count)
    return np.stack([*parameters, rt, rng.choice([-1.0, 1.0], count)], axis=1)


def test_the_graph_computes_what_the_layers_do(network, graph):
    trials = drawn(network)
    assert graph(trials) == pytest.approx(network.log_density(*trials.T), abs=2e-3)


def test_the_graph_takes_one_trial_of_concrete_dimensions(network):
    from onnx import TensorProto

    (source,), (out,) = network.model.graph.input, network.model.graph.output
    kinds = {each.type.tensor_type.elem_type for each in (source, out)}
    kinds |= {each.data_type for each in network.model.graph.initializer}
    assert kinds == {TensorProto.FLOAT}
    shapes = [[dim.dim_value for dim in each.type.tensor_type.shape.dim] for each in (source, out)]
    assert shapes == [[len(INPUTS)], [1]]


def test_the_other_response_is_as_likely_at_the_opposite_drift_and_t0_moves_times(network, graph):
    trials = drawn(network)
    known = graph(trials)
    assert graph(trials * [-1, 1, 1, 1, -1]) == pytest.approx(known, abs=1e-6)
    assert graph(np.add(trials, [0, 0, 0.5, 0.5, 0])) == pytest.approx(known, abs=2e-3)


@pytest.mark.parametrize("v", [0.0, 2.0, -6.0, 14.0])
@pytest.mark.parametrize("threshold", [0.1, 0.25, 0.5])
def test_responses_of_both_kinds_at_all_times_sum_to_one(network, v, threshold):
    density = np.exp([network.log_density(v, threshold, 0.3, RT, r) for r in (-1, 1)])
    assert density.sum() * BIN_S == pytest.approx(1, abs=0.01)


def test_the_network_is_near_the_circuit_that_is_simulated_anew(network):
    """On few trials; the score has a million."""
    model = CircuitModel(load_circuit(DEFAULT, 2), trials=1500, seconds=4.0, seed=SEED)
    grid, shape = Grid(400), (0.3, network.about["t0_sd_s"], 0.0)
    t0_s, t0_sd_s, lapse = (np.full(2, value) for value in shape)
    for threshold in (0.12, 0.3):
        mass = decided([(model.stored(()), 1.0)], threshold, [1.0, 5.0], grid)
        density = responded(mass, grid, t0_s=t0_s, t0_sd_s=t0_sd_s, lapse=lapse)
        for v, exact in zip((1.0, 5.0), density, strict=True):
            learned = [network.log_density(v, threshold, 0.3, grid.middles_s, r) for r in (-1, 1)]
            off = np.abs(learned - np.log(np.maximum(exact, 1e-6)))
            # Of that a simulation of so few trials leaves about 0.03.
            assert (exact * off).sum() / exact.sum() < 0.06


def test_the_network_is_of_todays_circuit_and_has_the_bounds_of_a_fit(network):
    """Where this fails, ``python -m benchmarks.likelihood_network`` makes it anew.

    A user who goes from a fit to HSSM finds the same noise and spread of t0 too.
    """
    model = CircuitModel(load_circuit(DEFAULT, 2))
    assert network.about["circuit"] == identity(model.circuit)
    moved = {each.name: each for each in model.parameters}
    for name, parameter in (("threshold", "threshold_nats"), ("t0", "t0_s")):
        assert network.bounds[name] == pytest.approx((moved[parameter].low, moved[parameter].high))
    assert network.bounds["v"] == (-max(DRIFTS), max(DRIFTS))
    assert network.about["noise_nats"] == model.noise_nats
    assert network.about["t0_sd_s"] == moved["t0_sd_s"].start
    assert network.about["engine"] == model.engine


def test_a_network_that_is_written_is_read_back(network, tmp_path):
    path = network.write(tmp_path / "one.onnx")
    again = read_network(path)
    assert again.checksum == network.checksum
    assert again.about == network.about
    assert again.write(tmp_path / "two.onnx").read_bytes() == path.read_bytes()
    path.write_bytes(b"no network")
    for wrong in (path, tmp_path / "absent.onnx"):
        with refused("path"):
            read_network(wrong)


def test_hssm_is_told_the_networks_own_parameters_and_bounds(network, tmp_path):
    arguments = network.for_hssm()
    assert read_network(arguments["loglik"]).checksum == network.checksum
    assert arguments["model_config"]["list_params"] == list(PARAMETERS)
    assert arguments["model_config"]["bounds"] == network.bounds
    assert network.for_hssm(tmp_path / "x.onnx")["loglik"] == str(tmp_path / "x.onnx")


def test_a_network_of_ones_own_layers_needs_no_file():
    layers = ((np.eye(3), np.zeros(3)), (np.ones((3, 1)), np.full(1, 2.0)))
    bare = LikelihoodNetwork(layers, {})
    at = np.tanh([2.0, np.log(np.expm1(0.5)), 0.4]).sum() + 2
    assert bare.log_density(-2.0, 0.5, 0.3, [0.7], -1) == pytest.approx([at])


def test_reading_a_network_needs_no_torch():
    code = "import sys; from bgmodel.fitting.simulated.network import read_network; read_network()"
    code += "; assert 'torch' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_trials_for_hssm_are_likeliest_near_the_parameters_they_were_made_with(
    network, monkeypatch
):
    monkeypatch.setattr(hssm_check, "TRIALS", 200)
    # No data set of the check has this number.
    known, table = hssm_check.truth(1000), hssm_check.simulated(1000, network)
    assert set(table["response"]) == set(network.for_hssm()["choices"]) == {-1, 1}

    def fits(sensitivity=1.0, nats=0.0, later_s=0.0):
        v = sensitivity * known["sensitivity"] * table["strength"]
        threshold, t0 = known["threshold"] + nats, known["t0"] + later_s
        return network.log_density(v, threshold, t0, table["rt"], table["response"]).sum()

    others = ((-1, 0, 0), (0.5, 0, 0), (2, 0, 0), (1, 0.15, 0), (1, 0, 0.2), (1, 0, -0.1))
    assert all(fits() > fits(*other) for other in others)
