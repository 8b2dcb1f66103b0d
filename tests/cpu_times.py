"""CPU seconds of each test, and from them the lists of slow and of long tests.

Tests that take at least ``SLOW_S`` in one of several runs are listed in ``slow.txt``: ``make test``
leaves them out, and ``make slow`` runs them. Those that take at least ``LONG_S`` in each run are
listed in ``long.txt``, and only ``make validate`` runs them. To list them anew, measure two runs of
all tests with empty caches::

    CPU_TIMES=first.txt make test slow validate PYTEST_ADDOPTS="-p tests.cpu_times"
    CPU_TIMES=second.txt make test slow validate PYTEST_ADDOPTS="-p tests.cpu_times"
    python -m tests.cpu_times first.txt second.txt

Two, because the first test that needs a compiled loop also pays for its compilation, and that may
be another one each time.

Blocks of the README are never slow. Blocks of another page are slow together, because the numbers
of their lines change with the page.
"""

from __future__ import annotations

import os
import re
import sys
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

import pytest

SLOW, LONG = (Path(__file__).parent / name for name in ("slow.txt", "long.txt"))
SLOW_S, LONG_S = 1.0, 5.0
"""CPU seconds from which on a test is slow, or long."""
NEVER_LONG = "tests/explorer/test_explorer.py::test_random_sequences"
"""Random edits in the explorer: long, but every change is tested with them."""


def named(nodeid: str) -> str:
    """Return the name of a test without the number of a line of a page."""
    return re.sub(r" line \d+(?=\])", "", nodeid)


def listed(path: Path) -> set[str]:
    """Return the names in a list."""
    return set(path.read_text(encoding="utf-8").splitlines())


def sorted_out(runs: Iterable[Iterable[tuple[str, float]]]) -> tuple[list[str], list[str]]:
    """Return the names of slow and of long tests, from names and CPU seconds of each run."""
    measured: dict[str, list[float]] = defaultdict(list)
    for times in runs:
        most: dict[str, float] = defaultdict(float)
        for name, seconds in times:
            most[named(name)] = max(most[named(name)], seconds)
        for name, seconds in most.items():
            measured[name].append(seconds)
    apart = {name for name in measured if "README" in name}
    long = {n for n, each in measured.items() if min(each) >= LONG_S} - apart - {NEVER_LONG}
    slow = {n for n, each in measured.items() if max(each) >= SLOW_S} - apart - long
    return sorted(slow), sorted(long)


def _used_s() -> float:
    """Return CPU seconds of this process and of those that it waited for."""
    return sum(os.times()[:4])


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item, nextitem):
    before = _used_s()
    result = yield
    with Path(os.environ["CPU_TIMES"]).open("a", encoding="utf-8") as file:
        file.write(f"{_used_s() - before:.3f}\t{item.nodeid}\n")
    return result


def read(path: str) -> list[tuple[str, float]]:
    """Return names and CPU seconds of one run."""
    lines = Path(path).read_text(encoding="utf-8").splitlines()
    pairs = (line.split("\t", 1) for line in lines)
    return [(name, float(seconds)) for seconds, name in pairs]


if __name__ == "__main__":
    for file, names in zip((SLOW, LONG), sorted_out(map(read, sys.argv[1:])), strict=True):
        file.write_text("\n".join(names) + "\n", encoding="utf-8")
