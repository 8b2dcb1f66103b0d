"""Drawings of a circuit, and the parts that plots share."""

import re
from itertools import combinations

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.patches import FancyArrowPatch

from circuits import anatomy, drawing, plots, show
from circuits.declaration.rows import Population, Projection

MACAQUE = anatomy.macaque()
NAMES = ("macaque", "spiking_msprt", "appendix_b", "humphries", "stewart")


def drawn(circuit, **options):
    """Return the texts and the pathways of a drawing, by name."""
    figure = circuit.plot(**options)
    (ax,) = figure.axes
    texts = {text.get_text() for text in ax.texts}
    arrows = {p.get_gid(): p for p in ax.patches if isinstance(p, FancyArrowPatch)}
    plt.close(figure)
    return texts, arrows, ax


def test_the_drawing_shows_every_nucleus_and_pathway():
    extra = Population("PPN", anatomy.bogacz_gurney().populations[0].cell, cite="test")
    circuit = anatomy.spiking_msprt().with_rows(extra, Projection("PPN", "STN", 1, cite="test"))
    texts, arrows, _ = drawn(circuit)
    assert {row.name for row in circuit.populations} <= texts
    assert set(arrows) == {p.name for p in circuit.projections}


def points(ways):
    return {pair: drawing.along(way[None])[0] for pair, way in ways.items()}


@pytest.mark.parametrize("name", NAMES)
def test_no_pathway_passes_through_a_nucleus_or_another_pathway(name):
    circuit = anatomy.load_circuit(name)
    placed = drawing.boxes(circuit)
    ways = points(drawing.routes(circuit, placed))
    for (source, target), path in ways.items():
        for other, box in placed.items():
            if other not in (source, target):
                assert not box.holds(path[None], margin=0)[0], (source, target, other)
    for (a, one), (b, other) in combinations(ways.items(), 2):
        apart = np.hypot(*np.moveaxis(one[:, None] - other[None], 2, 0)).min()
        assert apart > 0.09, (a, b)


def test_a_row_for_a_second_receptor_shares_the_box_of_its_nucleus():
    texts, arrows, _ = drawn(anatomy.load_circuit("humphries"))
    assert "ctx + ctx_NMDA" in texts
    assert {"GPe->GPe", "SNr->SNr"} <= set(arrows)
    assert "ctx->ctx_NMDA" not in arrows


def test_lesions_and_edits_are_marked():
    edited = MACAQUE.lesion("STN", 0.5).lesion("D2").clamp("GPe").scale("ctx->D1", 0.5)
    texts, _, ax = drawn(edited, reference=MACAQUE)
    assert {"STN\n50 % left", "D2\nsilenced", "GPe\nclamped"} <= texts
    assert sum(line.get_marker() == "*" for line in ax.lines) == 4
    legend = {text.get_text() for text in ax.get_legend().get_texts()}
    assert {"Edited or new", "Partial lesion", "Clamped or silenced"} <= legend
    _, _, ax = drawn(MACAQUE)
    assert not ax.lines


def test_a_backend_that_turns_interactive_with_its_first_figure_stays_so():
    """As in a notebook: otherwise figures after the first are not shown."""

    @plots.styled
    def first() -> None:
        matplotlib.interactive(True)

    before = matplotlib.is_interactive()
    try:
        first()
        assert matplotlib.is_interactive()
    finally:
        matplotlib.interactive(before)


PUBLISHED = {"D1": (0, 1), "D2": (0, 1), "STN": (15.2, 22.8), "SNr": (59.1, 79.5)}
"""Resting rates of the macaque, Hz, of Lienard & Girard 2014."""


def _page(circuit):
    """Return the text of a circuit with its long lines whole again."""
    page = show.text(circuit)
    assert max(len(line) for line in page.splitlines()) <= 145
    return re.sub(r"\n {4,}", " ", page)


@pytest.mark.parametrize("name", anatomy.CIRCUITS)
def test_the_page_holds_every_row_with_its_source(name):
    circuit = anatomy.load_circuit(name, 3)
    page = _page(circuit)
    for row in circuit.populations:
        assert row.name in page
        assert row.cite
        assert row.cite in page
    for p in circuit.projections:
        assert f"{p.source} -> {p.target}" in page
        assert p.cite in page


def test_the_page_says_whether_a_circuit_is_in_the_family_and_what_fails():
    circuit = anatomy.macaque(3)
    assert "in the family of OUT = -ln P: Sigma0 2.6, loop gain 0.72" in _page(circuit)
    page = _page(circuit.scale("ctx->D1", 0.9))
    assert "not in the family of OUT = -ln P:\n  direct: " in page
    assert "off by +0.12" in page  # a tenth of 1 + 0.1 * 0.55 + 0.15, rounded
    assert "family" not in _page(anatomy.gpr())  # not in nats


@pytest.mark.parametrize("channels", range(2, 9))
def test_the_macaque_names_the_nuclei_that_rest_outside_the_published_range(channels):
    """STN rests at 32 / N and SNr at 40 + 40 ln N Hz: which of them is outside turns on N."""
    rates = {"D1": 1.28, "D2": 0.5, "STN": 32.3 / channels, "SNr": 40 + 40 * np.log(channels)}
    known = ((k, *ends) for k, ends in PUBLISHED.items())
    outside = {k: f"{low:.3g} to {top:.3g}" for k, low, top in known if not low <= rates[k] <= top}
    page = _page(anatomy.macaque(channels))
    (line,) = (line for line in page.splitlines() if "outside the published range" in line)
    assert dict(re.findall(r"(\w+) [\d.]+ \(([\d.]+ to [\d.]+)\)", line)) == outside
