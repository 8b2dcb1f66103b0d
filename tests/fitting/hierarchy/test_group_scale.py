"""The scale on which people differ."""

import numpy as np
import pytest

from bgmodel.fitting.hierarchy.group import LOWEST, PARTS, Scale, log_uniform
from bgmodel.fitting.parameters import Parameter, freedom

SPACE = freedom([Parameter("bound", 0.1, 8.0, 0.7), Parameter("spread", 0.0, 5.0, 0.0)], {}, 1)
SCALE = Scale.of(SPACE)


def test_ends_of_the_range_are_finite_and_never_crossed():
    scaled = SCALE.to(np.array([[0.1, 0.0], [8.0, 5.0]]))
    assert scaled[0].tolist() == [LOWEST, LOWEST]
    back = SCALE.back(np.array([[-50.0, -50.0], [1e4, 1e4]]))
    assert (back[0] >= SPACE.low).all()
    assert back[1].tolist() == SPACE.high.tolist()


def test_slope_is_the_derivative():
    at = np.array([-2.3, 0.4])
    numeric = (SCALE.back(at + 1e-6) - SCALE.back(at - 1e-6)) / 2e-6
    assert SCALE.slope(at) == pytest.approx(numeric)


def test_a_uniform_distribution_has_the_density_of_the_slope():
    at = np.linspace(-4, 4, 9)
    assert np.exp(log_uniform(at)) == pytest.approx(
        (np.logaddexp(0, at + 1e-6) - np.logaddexp(0, at - 1e-6)) / 2e-6
    )


def test_coefficients_of_a_formula_have_the_unit_of_their_parameter():
    """Divided by their weight; far above the end of their range, the scale is linear in them."""
    bound = Parameter("bound", 0.1, 8.0, 0.7)
    columns = {"one": np.ones(2), "block": np.array([-2.0, 2.0])}
    space = freedom([bound], {}, 2, designs={"bound": columns})
    scale = Scale.of(space, np.array([1.2, 0.0]))
    assert scale.unit == pytest.approx([0.6 / PARTS, 0.3 / PARTS])
    natural = np.array([[1.2, -0.1], [0.9, 0.3]])
    assert scale.back(scale.to(natural)) == pytest.approx(natural)
    assert scale.slope(scale.to(natural))[:, 1] == pytest.approx(scale.unit[1])
