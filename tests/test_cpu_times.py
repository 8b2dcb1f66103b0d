"""The lists of slow and of long tests: made from CPU times, and of tests that are there."""

import re
from pathlib import Path

import pytest

from tests.cpu_times import LONG, SLOW, listed

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("path", [SLOW, LONG], ids=lambda path: path.stem)
def test_every_listed_test_is_there(path):
    for name in listed(path):
        file, _, function = name.partition("::")
        text = (ROOT / file).read_text(encoding="utf-8")
        assert re.search(rf"^(def )?{re.escape(function.partition('[')[0])}\b", text, re.M), name


def test_no_test_is_in_both_lists():
    assert not listed(SLOW) & listed(LONG)
