"""Pages of results: every number from a table, every table from today's circuits or said so."""

import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import pandas as pd
import pytest

from bgmodel.support.files import read_table
from figures import __main__ as runner
from figures import pages, pieces
from figures.pieces import Piece, Score
from figures.rooms import origin, rooms, write
from tests.helpers import ROOT

TEMPLATES = [pytest.param(path, id=pages.page_of(path).name) for path in pages.templates()]
PROSE = [ROOT / "README.md", *sorted((ROOT / "docs" / "guides").glob("*.md"))]
QUESTIONS = [pytest.param(room.page, id=room.name) for room in rooms() if room.page.is_file()]
"""Templates of pages that answer a question."""
MOST_LINES, MOST_COLUMNS = 150, 8
FENCED = r"```.*?```|`[^`]*`"
CIRCUITS = {"2": {"name": "spiking_msprt", "sha256": "0" * 64}}


@pytest.mark.parametrize("template", TEMPLATES)
def test_a_page_is_what_its_template_makes_of_the_tables(template):
    page = pages.page_of(template)
    same = page.read_text() == pages.rendered(template)
    assert same, f"{page.name} is not what its tables make: run python -m figures page"


@pytest.mark.parametrize("template", QUESTIONS)
def test_a_page_ends_with_its_tables_and_the_meaning_of_their_columns(template):
    assert "{{ tables(" in template.read_text().splitlines()[-1]
    assert "What each column means: [" in pages.page_of(template).read_text()


@pytest.mark.parametrize("template", QUESTIONS)
def test_a_page_is_short_and_its_tables_are_narrow(template):
    lines = pages.page_of(template).read_text().splitlines()
    assert len(lines) <= MOST_LINES
    assert max(line.count("|") - 1 for line in lines if line.startswith("|")) <= MOST_COLUMNS


@pytest.mark.parametrize("template", TEMPLATES)
def test_a_template_states_no_number_that_was_measured(template):
    assert pages.written_numbers(template.read_text()) == []


@pytest.mark.parametrize("page", [pytest.param(path, id=path.name) for path in PROSE])
def test_prose_states_no_interval(page):
    prose = re.sub(FENCED, "", page.read_text(), flags=re.DOTALL)
    assert [number for number in pages.written_numbers(prose) if "[" in number] == []


def test_a_decimal_or_an_interval_outside_a_placeholder_is_seen():
    text = "r is .93, not {{ 0.5 }} or {% if 0.1 %} 1.5, later 4 ms [-3, 12], [a, b], [x](y)"
    assert pages.written_numbers(text) == [".93", "1.5", "[-3, 12]"]


STORED = [pytest.param(p, id=p.stem) for room in rooms() for p in room.tables()]


@pytest.mark.parametrize("path", STORED)
def test_a_table_says_what_it_was_made_from(path):
    assert set(origin(path)) == {"parameters", "seed", "versions"}
    assert {"trials", "circuits"} <= set(origin(path)["parameters"])


@pytest.mark.parametrize("path", STORED)
def test_a_table_is_written_by_a_score_of_its_room_and_named_by_a_page(path):
    [room] = [room for room in rooms() if room.folder == path.parents[1]]
    assert path.stem.split("_")[0] in {score.name for score in runner.scores([room])}
    text = "".join(page.read_text() for page in pages.RESULTS.glob("*.md"))
    assert pages.link(path) in text


def test_a_table_of_another_circuit_says_so():
    behind = {"parameters": {"circuits": CIRCUITS}, "seed": 1, "versions": {"bgmodel": "0"}}
    assert "another circuit than today's**: spiking_msprt, N = 2 (00000000)" in pages.said(behind)
    behind["parameters"]["circuits"] = {}  # no circuit decides in it
    assert "circuit" not in pages.said(behind)
    del behind["parameters"]["circuits"]
    assert "with what circuit is not known" in pages.said(behind)


@pytest.fixture
def place(tmp_path):
    """Return where tables of a page under test are."""
    (tmp_path / "tables").mkdir()
    return lambda name: tmp_path / "tables" / f"{name}.csv"


def test_tables_lists_what_a_page_read_and_what_it_names_by_their_origin(tmp_path, place):
    template = tmp_path / "x.md.j2"
    template.write_text('{{ rows("y")[0].a }} {{ rows("y")[0].a }}\n{{ tables("z", "w") }}')
    for name in ("y", "z"):
        write(pd.DataFrame({"a": [1]}), place(name), trials=5, circuits={})
    write(pd.DataFrame({"a": [1]}), place("w"), trials=7, circuits=CIRCUITS)
    same, other, _, key = pages.rendered(template, place).splitlines()[1:]
    assert same.startswith(f"- {pages.link(place('y'))}, {pages.link(place('z'))}: 5 trials")
    assert other.startswith(f"- {pages.link(place('w'))}: 7 trials")
    assert "**measured with another circuit than today's**" in other
    assert key.startswith(f"What each column means: [{tmp_path.name}]")


@pytest.fixture
def score(tmp_path, monkeypatch):
    """Return a score of two pieces, what it computed, and its folder; it is stopped once."""
    computed = []

    def make(name):
        computed.append(name)
        if computed == ["one", "two"]:
            raise KeyboardInterrupt
        return pd.DataFrame({"name": [name]})

    def those(fast, workers):
        trials = 10 if fast else 1000
        for name in ("one", "two"):
            yield Piece("kind", name, trials, 60, lambda name=name: make(name))

    monkeypatch.setattr(pieces, "OUT", tmp_path / "out")
    small = Score(
        "test", 1, (2,), those, lambda made: {"all": ("kind", made["kind"])}, room=tmp_path
    )
    return small, computed, tmp_path


@pytest.mark.parametrize(
    ("arguments", "again"), [({"size": 2}, True), ({"workers": 9}, False), ({}, False)]
)
def test_a_piece_is_made_again_where_its_arguments_changed(score, arguments, again):
    made = []

    def make(size, workers):
        made.append(size)
        return pd.DataFrame({"size": [size]})

    one, _, _ = score
    for given in ({}, arguments):
        of = partial(make, **{"size": 1, "workers": 2} | given)
        pieces.measure(replace(one, pieces=lambda *_, of=of: [Piece("kind", "one", 10, 1, of)]))
    assert len(made) == 1 + again


@pytest.mark.parametrize("of_circuit", [True, False])
def test_only_pieces_of_a_circuit_are_made_again_where_it_changes(score, of_circuit):
    one, _, _ = score
    piece = Piece("kind", "one", 10, 1, dict, of_circuit)
    both = (replace(one, circuit=name) for name in ("", pieces.TABLE))
    keys = [each.entry(piece, Path(), False).key for each in both]
    assert (keys[0] != keys[1]) == of_circuit


def test_a_score_goes_on_where_it_was_stopped(score, capsys):
    one, computed, folder = score
    with pytest.raises(KeyboardInterrupt):
        pieces.measure(one)
    assert capsys.readouterr().out.startswith("2 of 2 pieces are left: about 2 minutes of CPU.")
    assert not (folder / "tables").exists()
    pieces.measure(one)
    assert capsys.readouterr().out.startswith("1 of 2 pieces are left: about 1 minutes of CPU.")
    pieces.measure(one)
    assert computed == ["one", "two", "two"]
    assert read_table(folder / "tables" / "test_all.csv")["name"].tolist() == ["one", "two"]


def test_a_piece_of_another_circuit_or_seed_is_not_finished(score):
    one, computed, folder = score
    computed.append("before")
    pieces.measure(one)
    piece, place = next(iter(one.pieces(False, 1))), folder / "out"
    assert one.entry(piece, place, False).get() is not None
    for other in ({"seed": 2}, {"channels": (4,)}):
        assert replace(one, **other).entry(piece, place, False).get() is None


def test_every_piece_of_every_score_has_a_file_of_its_own():
    for fast in (False, True):
        every = [(s, p) for s in runner.scores(rooms()) for p in s.pieces(fast, 1)]
        paths = [score.entry(piece, pieces.OUT, fast).path for score, piece in every]
        assert len(set(paths)) == len(paths)
        assert all(piece.seconds > 0 for _, piece in every)
