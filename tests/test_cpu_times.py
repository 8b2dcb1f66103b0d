"""The lists of slow and of long tests: made from CPU times, and of tests that are there."""

import re
from pathlib import Path

import pytest

from tests.cpu_times import LONG, LONG_S, SLOW, SLOW_S, listed, named, sorted_out

ROOT = Path(__file__).parents[1]


def test_a_test_is_slow_by_its_longest_run_and_long_by_its_shortest():
    first = [("a.py::x", SLOW_S), ("a.py::y", SLOW_S - 0.1), ("a.py::z[1]", LONG_S)]
    second = [("a.py::x", LONG_S + 1), ("a.py::y", 0.0), ("a.py::z[1]", LONG_S + 1)]
    assert sorted_out([first, second]) == (["a.py::x"], ["a.py::z[1]"])


def test_a_test_that_one_run_left_out_is_judged_by_the_others():
    assert sorted_out([[("a.py::x", LONG_S)], []]) == ([], ["a.py::x"])


def test_blocks_of_a_page_are_slow_together_and_those_of_the_readme_never():
    page = "p.py::b[few trials-docs/a.md line {}]"
    times = [(page.format(4), 0.1), (page.format(90), 3.0), ("p.py::b[README.md line 7]", 9.0)]
    assert sorted_out([times]) == ([named(page.format(12))], [])


@pytest.mark.parametrize("path", [SLOW, LONG], ids=lambda path: path.stem)
def test_every_listed_test_is_there(path):
    for name in listed(path):
        file, _, function = name.partition("::")
        text = (ROOT / file).read_text(encoding="utf-8")
        assert re.search(rf"^def {re.escape(function.partition('[')[0])}\(", text, re.M), name


def test_no_test_is_in_both_lists():
    assert not listed(SLOW) & listed(LONG)
