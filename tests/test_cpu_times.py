"""The list of slow tests: made from CPU times, and of tests that are there."""

import re
from pathlib import Path

from tests.cpu_times import LEAST_S, listed, named, slow

ROOT = Path(__file__).parents[1]


def test_the_slow_tests_are_those_of_seconds():
    times = [("a.py::x", LEAST_S), ("a.py::y", LEAST_S - 0.1), ("a.py::z[1]", 9.0)]
    assert slow(times) == ["a.py::x", "a.py::z[1]"]


def test_blocks_of_a_page_are_slow_together_and_those_of_the_readme_never():
    page = "p.py::b[few trials-docs/a.md line {}]"
    times = [(page.format(4), 0.1), (page.format(90), 3.0), ("p.py::b[README.md line 7]", 9.0)]
    assert slow(times) == [named(page.format(12))]


def test_every_listed_test_is_there():
    for name in listed():
        path, _, function = name.partition("::")
        text = (ROOT / path).read_text(encoding="utf-8")
        assert re.search(rf"^def {re.escape(function.partition('[')[0])}\(", text, re.M), name
