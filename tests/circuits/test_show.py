"""A circuit on one page and as a drawing."""

import matplotlib.pyplot as plt
import pytest

from circuits import anatomy, show
from circuits.spec import GABA, Population, Projection


@pytest.mark.parametrize("name", anatomy.CIRCUITS)
def test_the_page_holds_every_row_with_its_source(name):
    circuit = anatomy.circuit(name, 3)
    page = show.text(circuit)
    for row in circuit.populations:
        assert row.name in page
        assert row.cite
        assert row.cite in page
    for p in circuit.projections:
        assert f"{p.source} -> {p.target}" in page
        assert p.cite in page
    assert max(len(line) for line in page.splitlines()) < 200


def test_edits_show_on_the_page_and_nothing_else_does():
    page = show.text(anatomy.spiking_msprt().without("GPe", 0.5, replaced=True).with_spread(0.1))
    assert "0.5, replaced" in page
    assert "spread" in page
    assert "1 0.9" in show.text(anatomy.spiking_msprt().scaled("ctx", "D1", 0.9, channel=1))
    assert "by_channel" not in show.text(anatomy.spiking_msprt())
    assert "intact" not in show.text(anatomy.spiking_msprt())


def test_the_drawing_shows_every_nucleus_and_pathway():
    extra = Population("PPN", anatomy.bogacz_gurney().populations[0].cell, cite="test")
    circuit = anatomy.spiking_msprt().with_rows(extra, Projection("PPN", "STN", 1, cite="test"))
    figure, ax = plt.subplots()
    assert show.draw(circuit, ax) is ax
    labels = {text.get_text() for text in ax.texts}
    assert {row.name for row in circuit.populations} <= labels
    arrows = [text for text in ax.texts if getattr(text, "arrow_patch", None)]
    assert len(arrows) == len(circuit.projections)
    assert circuit.population("GPe").transmitter == GABA
    plt.close(figure)


def test_a_page_of_saliences_calls_nothing_nats():
    page = show.text(anatomy.gpr())
    assert "in salience, not nats: no posterior follows from OUT" in page
    assert "gain_hz_per_salience" in page
    assert "bias_salience" in page
    assert page.count("nats") == 1
