"""References of sources that are cited by author and year, such as "Deffains 2016".

Tables, the exam and the pages cite their sources in this way; ``bgmodel/data/references.bib`` has
one entry per first author and year.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache, cached_property
from importlib import resources

ENTRY = re.compile(r"^@\w+\{\w+,\n(.*?)^\}", re.MULTILINE | re.DOTALL)
FIELD = re.compile(r"(\w+) = \{((?:[^{}]|\{[^{}]*\})*)\}")
NO_OTHER_FIRST = r"(?<![\w-])" + "".join(rf"(?<![^\W\d]{end} )" for end in (" &", ", &", " and"))
"""What does not come before a first author: part of a name, or an author and "&" or "and"."""
OTHERS = "others"
"""Last author of an entry that does not list all."""


@dataclass(frozen=True)
class Reference:
    """A reference: its authors ("Bogacz, R."), journal or book with pages, and DOI or address."""

    authors: tuple[str, ...]
    year: str
    title: str
    place: str
    link: str

    def __str__(self) -> str:
        """Return all of it as one line."""
        names = ", ".join(self.authors).replace(f", {OTHERS}", " et al.")
        parts = (f"{names} ({self.year})", self.title, self.place)
        return f"{'. '.join(filter(None, parts))}. {self.link}".replace("?.", "?").strip()

    @cached_property
    def families(self) -> list[str]:
        """Family names of the authors."""
        return [name.partition(",")[0] for name in self.authors]

    @property
    def short(self) -> str:
        """The first author, or both of two, and the year."""
        two = len(self.authors) == 2 and OTHERS not in self.authors
        return f"{' & '.join(self.families[: 1 + two])} {self.year}"

    @cached_property
    def citation(self) -> re.Pattern[str]:
        """Pattern of its citations: the first author, alone, with "et al." or with all others."""
        first, *others = (re.escape(plain(name)) for name in self.families)
        every = ", ".join(["", *others[:-1]]) + f" (?:&|and) {others[-1]}" if others else ""
        return re.compile(
            rf"{NO_OTHER_FIRST}{first}(?:['’]s| et al\.?|{every})?,? \(?{self.year}\b"
        )


@cache
def references() -> tuple[Reference, ...]:
    """Return all references, in the order of their first authors."""
    text = (resources.files("bgmodel") / "data" / "references.bib").read_text(encoding="utf-8")
    every = (_reference(dict(FIELD.findall(fields))) for fields in ENTRY.findall(text))
    return tuple(sorted(every, key=lambda one: (plain(one.authors[0]).lower(), one.year)))


def cited(texts: Iterable[str]) -> list[Reference]:
    """Return the references that texts cite; texts may cite others, or none."""
    text = plain("\n".join(texts))
    return [one for one in references() if one.citation.search(text)]


def sources_of(texts: Iterable[str]) -> str:
    """Return the references that texts cite as the last part of a text, if there are any."""
    every = "".join(f"\n  {one}" for one in cited(texts))
    return f"\n\nSources{every}" * bool(every)


def plain(text: str) -> str:
    """Return a text on one line, without accents."""
    return " ".join(re.sub(r"[\u0300-\u036f]", "", unicodedata.normalize("NFKD", text)).split())


def _reference(fields: dict[str, str]) -> Reference:
    of = {name: re.sub(r"[{}\\]", "", value) for name, value in fields.items()}
    place = of.get("journal") or of.get("booktitle") or of.get("publisher", "")
    volume = of.get("volume", "") + (f"({of['number']})" if "number" in of else "")
    place = ":".join(filter(None, (f"{place} {volume}".strip(), of.get("pages"))))
    link = f"https://doi.org/{of['doi']}" if "doi" in of else of.get("url", "")
    authors = tuple(of["author"].split(" and "))
    return Reference(authors, of["year"], of["title"], place.replace("--", "-"), link)
