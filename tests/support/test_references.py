"""Every source that is cited by author and year leads to one reference."""

import re
from itertools import pairwise
from pathlib import Path

import pytest

from bgmodel.exam.exam import Exam
from bgmodel.support.references import cited, plain, references
from circuits.anatomy import CIRCUITS, load_circuit

ROOT = Path(__file__).resolve().parents[2]
FILE = ROOT / "bgmodel" / "data" / "references.bib"
YEAR = r"\(?(?:18|19|20)\d\d\b(?!-)"
CITATION = re.compile(rf"([A-Z][\w'’-]+)(?: et al\.)?,? {YEAR}")
DATES = {"October", "November"}


def unknown(text):
    """Return the first words of citations that are left once those of references are gone."""
    text = plain(text)
    ends = [0, *(match.end() for match in re.finditer(YEAR, text))]
    near = (text[max(end - 200, before) : end] for before, end in pairwise(ends))
    text = "\n".join(near)  # most of a long text has no years
    for one in references():
        text = one.citation.sub("", text)
    return set(CITATION.findall(text)) - DATES


def test_every_number_of_the_exam_has_one_reference():
    numbers = Exam.shipped().numbers
    assert {one.source: len(cited([one.source])) for one in numbers} == dict.fromkeys(
        (one.source for one in numbers), 1
    )
    assert unknown("\n".join(one.how for one in numbers)) == set()


@pytest.mark.parametrize("name", CIRCUITS)
def test_every_source_of_a_circuit_has_a_reference(name):
    circuit = load_circuit(name, 2)
    rows = (*circuit.populations, *circuit.projections)
    text = "\n".join(f"{row.cite}; {row.cite_more}" for row in rows)
    assert unknown(text) == set()
    assert cited([text])


@pytest.mark.parametrize(
    "pattern",
    [
        "docs/**/*.md",
        "figures/*/page.md.j2",
        "bgmodel/experiments/shipped/*.toml",
        "bgmodel/**/*.py",
        "circuits/**/*.py",
        "figures/**/*.py",
    ],
)
def test_every_source_of_pages_experiments_and_code_has_a_reference(pattern):
    paths = [path for path in ROOT.glob(pattern) if not {"_build", "_modules"} & set(path.parts)]
    assert unknown("\n".join(path.read_text(encoding="utf-8") for path in paths)) == set()
    assert paths


def test_a_citation_names_the_authors_of_its_reference():
    known = (
        "Soares 2004",
        "Soares et al. (2004)",
        "(Branam, Gold & Ding 2024)",
        "Lienard & Girard (2014)",
        "Bogacz and\nGurney 2007",
        "Soares et al 2004",
        "Smith 2003 & Soares 2004",
        "Smith 2003 and Soares’s 2004",
    )
    assert [len(cited([text])) for text in known] == [1] * len(known)
    of_others = (
        "Smith & Soares 2004",
        "Smith and Soares 2004",
        "A, B, & Soares 2004",
        "X-Soares 2004",
    )
    for text in (
        *of_others,
        "",
        "[a-z",
        "Soares 2004b",
        "Bogacz & Smith 2007",
        "Huk & Shadlen 2005",
        "Soares 2005",
        "my own notes, 2024",
    ):
        assert cited([text]) == []


def test_a_first_author_and_a_year_mean_one_reference_and_a_link_one_paper():
    every = references()
    assert len(every) == FILE.read_text(encoding="utf-8").count("\n@") + 1
    assert len({(one.families[0], one.year) for one in every}) == len(every)
    links = [one.link for one in every if one.link]
    assert len(set(links)) == len(links)
    assert all(re.fullmatch(r"https://(doi\.org/10\.\d{4,5}/)?\S+", link) for link in links)


def test_the_paper_has_the_same_entries():
    paper = re.findall(r"^@.*?^\}", (ROOT / "paper" / "paper.bib").read_text("utf-8"), re.M | re.S)
    text = FILE.read_text(encoding="utf-8")
    assert paper
    assert [entry for entry in paper if entry not in text] == []


def test_the_list_of_the_exam_ends_with_its_sources():
    text, table = Exam.shipped().listed()
    reference = table.set_index("id")["reference"]["beta.stn"]
    assert reference.endswith("eLife 5:e16443. https://doi.org/10.7554/eLife.16443")
    assert f"\n  {reference}\n" in text.partition("\nSources\n")[2]
