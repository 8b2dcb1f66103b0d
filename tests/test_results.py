"""Pages of results: every number from a table, every table from today's circuits or said so."""

import json

import jinja2
import pytest

from benchmarks import pages
from bgmodel.files import provenance_path

TEMPLATES = [pytest.param(path, id=path.name) for path in pages.templates()]


def test_there_are_pages():
    assert TEMPLATES


@pytest.mark.parametrize("template", TEMPLATES)
def test_a_page_is_what_its_template_makes_of_the_tables(template):
    assert pages.page_of(template).read_text() == pages.rendered(template)


@pytest.mark.parametrize("template", TEMPLATES)
def test_a_template_states_no_decimal_number_itself(template):
    assert pages.written_numbers(template.read_text()) == []


def test_a_decimal_outside_a_placeholder_is_seen():
    assert pages.written_numbers("r is .93, not {{ 0.5 }} or {% if 0.1 %} 1.5") == [".93", "1.5"]


@pytest.mark.parametrize("path", [pytest.param(p, id=p.name) for p in pages.RESULTS.glob("*.csv")])
def test_a_table_says_what_it_was_made_from(path):
    behind = json.loads(provenance_path(path).read_text())
    assert set(behind) == {"parameters", "seed", "versions"}
    assert {"trials", "circuits"} <= set(behind["parameters"])


def test_a_table_of_another_circuit_says_so():
    circuits = {"2": {"name": "spiking_msprt", "sha256": "0" * 64}}
    behind = {"parameters": {"circuits": circuits}, "seed": 1, "versions": {"bgmodel": "0"}}
    assert "another circuit than today's**: spiking_msprt, N = 2 (00000000)" in pages.said(behind)
    behind["parameters"]["circuits"] = {}
    assert "with what circuit is not known" in pages.said(behind)


def test_a_number_that_is_not_there_raises(tmp_path):
    (tmp_path / "x.md.j2").write_text('{{ rows("y")[0].no }}')
    with pytest.raises(ValueError, match="there is no table"):
        pages.rendered(tmp_path / "x.md.j2", tmp_path)
    (tmp_path / "y.csv").write_text("a\n1\n")
    with pytest.raises(jinja2.UndefinedError):
        pages.rendered(tmp_path / "x.md.j2", tmp_path)
