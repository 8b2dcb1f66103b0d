"""Networks have the layers that are stated."""

from importlib.util import find_spec

import numpy as np
import pytest

from bgmodel.tactile.networks import EdgeNetwork, GratingNetwork

# PyTorch is imported where it is used: every process of a run of tests reads all files.
pytestmark = pytest.mark.skipif(find_spec("torch") is None, reason="networks need PyTorch")


def layers(network):
    """Return the widths of layers with weights, and the shares that are dropped."""
    import torch

    with_weights = (torch.nn.Conv2d, torch.nn.Linear)
    widths = [m.weight.shape[0] for m in network.modules() if isinstance(m, with_weights)]
    return widths, [m.p for m in network.modules() if isinstance(m, torch.nn.Dropout)]


def test_the_network_for_gratings_has_the_layers_of_pestell_2022():
    """At full width and dropout; three outputs in place of one."""
    widths, dropped = layers(GratingNetwork.build((19, 19), 1.0, 1.0))
    assert widths == [64, 128, 128, 32, 16, 3]
    assert dropped == pytest.approx([0.4, 0.2, 0.2])
    assert layers(GratingNetwork.build((19, 19), 0.25, 0.5))[1] == pytest.approx([0.2, 0.1, 0.1])


def test_the_network_for_edges_has_two_hidden_layers_and_drops_a_tenth_after_each():
    widths, dropped = layers(EdgeNetwork.build((662,), 1.0, 1.0))
    assert widths == [256, 256, 2]
    assert dropped == pytest.approx([0.1, 0.1])
    assert layers(EdgeNetwork.build((662,), 0.5, 2.0)) == ([128, 128, 2], pytest.approx([0.2, 0.2]))


def test_normalisation_brings_a_variance_of_a_thousandth_to_a_half():
    """The least variance that is taken for signal, in each normalisation of the network."""
    import torch

    network = GratingNetwork.build((19, 19), 0.1, 0.0).train()
    norms = [m for m in network if isinstance(m, torch.nn.BatchNorm1d | torch.nn.BatchNorm2d)]
    assert len(norms) == 6
    for norm in norms:
        shape = (8, norm.num_features, *(4, 4)[: 2 * isinstance(norm, torch.nn.BatchNorm2d)])
        signs = torch.ones(shape)
        signs[::2] = -1
        out = norm(1e-3**0.5 * signs)
        assert float(out.detach().var(correction=0)) == pytest.approx(0.5, rel=1e-3)


def test_targets_of_a_network_for_gratings_read_back_as_the_yaw():
    """A label of 0 to 1 over half a turn, and cos and sin of twice the yaw (Pestell 2022)."""
    targets = GratingNetwork.targets(np.array([-90.0, -45.0, 0.0, 45.0, 90.0]))
    np.testing.assert_allclose(targets[:, 0], [0, 0.25, 0.5, 0.75, 1])
    np.testing.assert_allclose(targets[:, 1], [-1, 0, 1, 0, -1], atol=1e-12)
    np.testing.assert_allclose(targets[:, 2], [0, -1, 0, 1, 0], atol=1e-12)
    yaw = np.linspace(-89, 89, 30)
    read = GratingNetwork.read(GratingNetwork.targets(yaw))
    np.testing.assert_allclose(read["psi_deg"], yaw)
    np.testing.assert_allclose(read["orientation_deg"], yaw)
    np.testing.assert_allclose(read["strength"], 1)
    beyond = GratingNetwork.read(np.array([[-0.1, 3.0, 4.0], [1.1, 0.0, -2.0]]))
    assert beyond["psi_deg"].tolist() == [-90, 90]
    assert beyond["strength"].tolist() == [5, 2]
    assert beyond["orientation_deg"] == pytest.approx([np.degrees(np.arctan2(4, 3)) / 2, -45])


def test_targets_of_a_network_for_edges_read_back_as_the_direction():
    targets = EdgeNetwork.targets(np.array([0.0, 90.0, 180.0]))
    assert targets == pytest.approx(np.array([[1, 0], [0, 1], [-1, 0]]))
    yaw = np.linspace(-179, 179, 30)
    read = EdgeNetwork.read(3 * EdgeNetwork.targets(yaw))
    np.testing.assert_allclose(read["edge_deg"], yaw)
    np.testing.assert_allclose(read["strength"], 3)
