"""Counts on pages of what the package holds are those of the code."""

import re

import pytest

from bgmodel.demo import NUCLEI
from bgmodel.exam.exam import Exam
from bgmodel.experiments.experiment import shipped_names
from bgmodel.tables.shipped import OTHERS, SETS
from circuits.engines import ENGINES
from tests.helpers import ROOT, prose

WORDS = ["zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten"]
WORDS += ["eleven", "twelve", "thirteen", "fourteen", "fifteen", "sixteen", "seventeen"]
WORDS += ["eighteen", "nineteen", "twenty"]
NUMBER = rf"\b(\d+|{'|'.join(WORDS)})"
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")),
    ROOT / "paper" / "paper.md",
    *sorted((ROOT / "figures").glob("*/room.toml")),
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs").glob("[gt]*/*.md")),
    *sorted((ROOT / "docs" / "tutorials").glob("*.ipynb")),
]


def lines_of(name, beginning):
    """Return how many lines of a file begin so."""
    text = (ROOT / name).read_text(encoding="utf-8")
    return len(re.findall(f"^{beginning}", text, re.MULTILINE))


def faults():
    text = (ROOT / "tests" / "validation" / "faults.py").read_text(encoding="utf-8")
    return int(re.search(r'"--count": (\d+)', text)[1])


COUNTS = {
    f"{NUMBER} included experiments": len(shipped_names()),
    f"{NUMBER} notebooks and a page": len(list((ROOT / "docs/tutorials").glob("*.ipynb"))),
    f"{NUMBER} engines simulate": len(ENGINES),
    f"{NUMBER} published numbers": len(Exam.shipped().numbers),
    f"{NUMBER} (?:single )?faults": faults(),
    f"spikes (?:of|in) {NUMBER} nuclei": len(NUCLEI),
    f"{NUMBER} recipes": lines_of("docs/extending.md", "## "),
    f"{NUMBER} data sets of choices": len(SETS),
    f"{NUMBER} published data sets": len(SETS) + len(OTHERS),
}


@pytest.mark.parametrize(("pattern", "count"), COUNTS.items())
def test_a_count_on_a_page_is_that_of_the_package(pattern, count):
    counts = [
        (path.name, match[1].lower())
        for path in PAGES
        for match in re.finditer(pattern, " ".join(prose(path).split()), re.IGNORECASE)
    ]
    assert counts
    allowed = {str(count), *WORDS[count : count + 1]}
    assert [each for each in counts if each[1] not in allowed] == []
