"""The prose avoids constructions that readers stumble over; CONTRIBUTING.md says what to write."""

import re
import tokenize

import pytest

from tests.helpers import ROOT, prose

PHRASES = (
    r"\bbeside\b",
    r"\b(?:held|hold|holds) to (?:the|its|a|it|those|what)\b",
    r"\b(?:stands?|lies?) (?:behind|for itself)\b",
    r"\b(?:came|comes|come|becomes?) of\b",
    r"\btaken off\b",
    r"\bas (?:it|they) (?:is|are)\b(?= *[,.;:)])",
    r"\bof (?:your|its|their|our|one's) own\b",
    r"\bso (?:many|much)\b(?! that)",
    r"\b(?:is|are) (?:told|said)\b",
    r"(?<![\w.\d/)\]:+])\.\d+\b",
)
PAGES = [
    ROOT / "README.md",
    ROOT / "CHANGELOG.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "SECURITY.md",
    ROOT / "paper" / "paper.md",
    *sorted((ROOT / "figures").glob("*/room.toml")),
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs" / "guides").glob("*.md")),
    *sorted((ROOT / "docs" / "results").glob("*.md")),
    *sorted((ROOT / "docs" / "tutorials").glob("*.md")),
    *sorted((ROOT / "docs" / "tutorials").glob("*.ipynb")),
]
MADE = {"gallery.md", "references.md", "changelog.md"}
PACKAGES = ("bgmodel", "circuits", "figures", "benchmarks")
IN_CODE = 8
"""Hits in docstrings, comments and messages, of which each was looked at."""


def hits(lines):
    """Return the phrases in lines of prose: number of the line, phrase, text."""
    return [
        (number, hit[0], line.strip())
        for number, line in lines
        for pattern in PHRASES
        if (hit := re.search(pattern, line, re.IGNORECASE))
    ]


def prose_of(page):
    """Yield the lines of a page with their numbers, without blocks of code and inline code."""
    code = False
    for number, line in enumerate(prose(page).splitlines(), 1):
        if line.lstrip().startswith(("```", "~~~")):
            code = not code
        elif not code and not line.startswith(("    ", "|")):
            yield number, re.sub(r"`[^`]*`|\{[{%].*?[}%]\}", "", line)


def prose_in(module):
    """Yield the lines of docstrings, comments and strings of a module with their numbers."""
    with module.open("rb") as source:
        for token in tokenize.tokenize(source.readline):
            if token.type in (tokenize.STRING, tokenize.COMMENT) and " " in token.string:
                for offset, line in enumerate(token.string.splitlines()):
                    yield token.start[0] + offset, re.sub(r"``?[^`]*``?", "", line)


@pytest.mark.parametrize("page", [p for p in PAGES if p.name not in MADE], ids=lambda p: p.name)
def test_a_page_has_none_of_the_phrases(page):
    assert hits(prose_of(page)) == []


def test_code_has_few_of_the_phrases():
    phrases = [
        (str(module.relative_to(ROOT)), *hit)
        for package in PACKAGES
        for module in sorted((ROOT / package).rglob("*.py"))
        for hit in hits(prose_in(module))
    ]
    assert len(phrases) <= IN_CODE, phrases


def test_the_phrases_are_found_where_they_are():
    lines = ["It stands behind the test.", "A scale of .5 is held to its table, as it is."]
    assert [number for number, _, _ in hits(enumerate(lines))] == [0, 1, 1, 1]
