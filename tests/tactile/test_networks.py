"""Networks have the layers that are stated."""

import numpy as np
import pytest

from bgmodel.tactile.decoder import EDGE
from bgmodel.tactile.networks import EdgeNetwork, GratingNetwork, wrapped

torch = pytest.importorskip("torch")


def layers(network):
    """Return the widths of layers with weights, and the shares that are dropped."""
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


def test_edges_are_read_by_the_whole_perceptron():
    built = EdgeNetwork.build((662,), EDGE.width, EDGE.dropout)
    assert layers(built) == layers(EdgeNetwork.build((662,), 1.0, 1.0))


def test_a_feature_with_a_variance_of_a_thousandth_counts_half_after_normalisation():
    """The least variance that is taken for signal, in each normalisation of the network."""
    network = GratingNetwork.build((19, 19), 0.1, 0.0).train()
    norms = [m for m in network if isinstance(m, torch.nn.BatchNorm1d | torch.nn.BatchNorm2d)]
    assert len(norms) == 6
    for norm in norms:
        shape = (8, norm.num_features, *(4, 4)[: 2 * isinstance(norm, torch.nn.BatchNorm2d)])
        signs = torch.ones(shape)
        signs[::2] = -1
        out = norm(1e-3**0.5 * signs)
        assert float(out.detach().var(correction=0)) == pytest.approx(0.5, rel=1e-3)


def test_angles_are_wrapped_to_half_a_period_about_zero():
    turned = wrapped(np.array([-100.0, -90.0, 0.0, 89.0, 90.0, 190.0]), 180.0)
    np.testing.assert_allclose(turned, [80.0, -90.0, 0.0, 89.0, -90.0, 10.0])
