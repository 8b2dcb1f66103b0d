"""The figure of a group."""

import pandas as pd

from bgmodel.fitting.hierarchy.labels import draw_group
from tests.fitting.conftest import PEOPLE


def test_conditions_share_their_axis_and_order_and_coefficients_do_not():
    names = ["bound[speed=no]", "bound[speed=yes]", "drift[Intercept]", "drift[speed]"]
    rows = [(who, n, m) for n, ms in zip(names, ([1, 2], [5, 4], [9, 8], [0, 1]), strict=True)
            for who, m in zip("ab", ms, strict=True)]  # fmt: skip
    people = pd.DataFrame(rows, columns=["participant", "parameter", "median"])
    people = people.assign(low=people["median"] - 0.5, high=people["median"] + 0.5)
    group = people.groupby("parameter", sort=False)[["median", "low", "high"]].mean()
    axes = draw_group(people, group, 10).axes
    orders = [[label.get_text() for label in ax.get_yticklabels()] for ax in axes]
    assert orders == [["a", "b"], ["a", "b"], ["b", "a"], ["a", "b"]]
    assert axes[0].get_xlim() == axes[1].get_xlim()
    assert axes[2].get_xlim() != axes[3].get_xlim()
    assert [ax.get_title(loc="left") for ax in axes[:2]] == ["speed=no", "speed=yes"]


def test_there_is_a_panel_for_each_parameter_with_everyone_in_it(group):
    figure = group.plot()
    labels = [ax.get_xlabel() for ax in figure.axes]
    assert len(labels) == len(group.parameters)
    assert all(label.startswith(p) for label, p in zip(labels, group.parameters, strict=True))
    for ax in figure.axes:
        assert {label.get_text() for label in ax.get_yticklabels()} == set(PEOPLE)
    assert "4 people, 240 trials" in figure.get_suptitle()
