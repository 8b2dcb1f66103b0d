"""Random sequences of a user's steps in the explorer, and a live notebook: make validate."""

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from tests.explorer.helpers import STEPS
from tests.explorer.test_explorer import follow

pytestmark = pytest.mark.validate


@pytest.mark.timeout(7200)
@pytest.mark.filterwarnings("ignore::UserWarning")
@given(steps=st.lists(STEPS, max_size=15))
@settings(max_examples=300, phases=[Phase.generate], suppress_health_check=[*HealthCheck])
def test_three_hundred_random_sequences(steps, tmp_path, capsys, monkeypatch):
    follow(steps, tmp_path, capsys, monkeypatch, drawn=True)
