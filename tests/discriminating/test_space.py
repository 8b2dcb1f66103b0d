"""Spaces of tasks are checked when they are read."""

import pytest

from bgmodel import InputError
from bgmodel.discriminating.space import Probe, Space, check_space


def test_the_shipped_space_is_read_and_tests_lack_its_nuclei():
    space = Space.shipped()
    assert check_space(None) == space
    assert len(space.edits) > 1
    assert space.stop_nats != (0.0,)
    assert space.of_tests().edits == ("",)
    assert space.of_tests().stop_nats == (0.0,)
    assert space.of_tests().channels == space.channels


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("channel = [2]", "channel"),
        ("channels = []", "channels"),
        ("channels = [1]", "channels"),
        ("conflict = [0.5, 0.5]", "conflict"),
        ("conflict = [1.0]", "conflict"),
        ("d_prime = [0.0]", "d_prime"),
        ("accuracy = [1.0]", "accuracy"),
        ("share = 1.0", "share"),
        ("deadline_ms = [1000.0]\nstop_delay_ms = 2000.0", "stop_delay_ms"),
        ("stop_nats = [3.0]", "stop_nats"),
    ],
)
def test_a_wrong_space_is_refused_in_one_sentence(text, field, tmp_path):
    path = tmp_path / "space.toml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        Space.from_toml(path)
    assert caught.value.field == field
    assert "\n" not in str(caught.value)


def test_an_edit_that_is_none_is_refused():
    with pytest.raises(InputError):
        Space(edits=("", "lesoin STN 10%"))
    with pytest.raises(InputError) as caught:
        check_space(3)
    assert caught.value.field == "space"


def test_a_probe_is_interleaved_with_plain_trials():
    probe = Probe(4, 0.5, 0.9, 0.5, "dopamine 0.9; lesion GPe 5%")
    assert probe.plain == Probe(4, 0.5)
    assert probe.plain.plain == probe.plain
    assert probe.lines == ("dopamine 0.9", "lesion GPe 5%")
    assert "conflict 0.9" in probe.text()
