"""CPU seconds of each test, and from them the list of slow tests.

Tests that take more than ``LEAST_S`` are listed in ``slow.txt``: ``make test`` leaves them out, and
``make slow`` runs them. To list them anew, measure one run of all tests with empty caches::

    CPU_TIMES=times.txt make test slow PYTEST_ADDOPTS="-p tests.cpu_times"
    python -m tests.cpu_times times.txt

The first test that needs a compiled loop also pays for its compilation, and another one once that
test is slow: append the times of a second run to those of the first.

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

LIST = Path(__file__).parent / "slow.txt"
LEAST_S = 1.0
"""CPU seconds from which on a test is slow."""


def named(nodeid: str) -> str:
    """Return the name of a test without the number of a line of a page."""
    return re.sub(r" line \d+(?=\])", "", nodeid)


def listed() -> set[str]:
    """Return the names of all slow tests."""
    return set(LIST.read_text(encoding="utf-8").splitlines())


def slow(times: Iterable[tuple[str, float]]) -> list[str]:
    """Return the names of slow tests, sorted, from names and CPU seconds."""
    most: dict[str, float] = defaultdict(float)
    for name, seconds in times:
        most[named(name)] = max(most[named(name)], seconds)
    return sorted(n for n, seconds in most.items() if seconds >= LEAST_S and "README" not in n)


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


if __name__ == "__main__":
    lines = Path(sys.argv[1]).read_text(encoding="utf-8").splitlines()
    pairs = (line.split("\t", 1) for line in lines)
    names = slow((name, float(seconds)) for seconds, name in pairs)
    LIST.write_text("\n".join(names) + "\n", encoding="utf-8")
