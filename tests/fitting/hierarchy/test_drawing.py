"""The figure of a group."""

from tests.fitting.conftest import PEOPLE


def test_there_is_a_panel_for_each_parameter_with_everyone_in_it(group):
    figure = group.plot()
    assert [ax.get_title(loc="left") for ax in figure.axes] == group.parameters
    for ax in figure.axes:
        assert {label.get_text() for label in ax.get_yticklabels()} == set(PEOPLE)
    assert "4 people, 240 trials" in figure.get_suptitle()
