"""A circuit on one page and as a drawing."""

import sys
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure

from circuits import anatomy, show
from circuits.declaration.spec import GABA, Population, Projection
from circuits.engines import run


@pytest.mark.parametrize("name", anatomy.CIRCUITS)
def test_the_page_holds_every_row_with_its_source(name):
    circuit = anatomy.load_circuit(name, 3)
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
    page = show.text(anatomy.spiking_msprt().clamp("GPe", 0.5).with_spread(0.1))
    assert "0.5, replaced" in page
    assert "spread" in page
    assert "1 0.9" in show.text(anatomy.spiking_msprt().scale("ctx", "D1", 0.9, channel=1))
    assert "0.75 1" in show.text(anatomy.spiking_msprt().lesion("GPe", 0.25, channel=0))
    for idle in ("by_channel", "probability", "spread"):
        assert idle not in show.text(anatomy.spiking_msprt())
    assert "probability" in show.text(anatomy.spiking_msprt().with_connections(0.25))
    assert "intact" not in show.text(anatomy.spiking_msprt())


def test_constants_of_cells_are_in_the_circuits_unit():
    for name, unit in (("humphries", "salience"), ("spiking_msprt", "nat")):
        table = anatomy.load_circuit(name)
        shown = show.constants(table)
        assert [f"mv_per_{unit} " in shown, shown.count("mv_per_")] == [
            any(hasattr(row.cell, "mv_per_nat") for row in table.populations),
            len({row.cell for row in table.populations if hasattr(row.cell, "mv_per_nat")}),
        ]


def test_a_row_without_a_source_is_assumed():
    edited = anatomy.spiking_msprt().add("D1->GPe weight=-0.1", "D1 amount=0.1 to_ms=9")
    assert show.pathways(edited)["source"].iloc[-1] == "assumed"
    assert show.courses(edited)["source"].tolist() == ["assumed"]


def test_the_drawing_shows_every_nucleus_and_pathway():
    extra = Population("PPN", anatomy.bogacz_gurney().populations[0].cell, cite="test")
    circuit = anatomy.spiking_msprt().add(extra, Projection("PPN", "STN", 1, cite="test"))
    figure, ax = plt.subplots()
    assert show.draw(circuit, ax) is ax
    labels = {text.get_text() for text in ax.texts}
    assert {row.name for row in circuit.populations} <= labels
    arrows = [text for text in ax.texts if getattr(text, "arrow_patch", None)]
    assert len(arrows) == len(circuit.projections)
    assert circuit.population("GPe").transmitter == GABA
    plt.close(figure)


def test_nuclei_stand_in_rows_and_columns_with_even_margins():
    """Cortex above striatum, what pools beside it; nuclei that have no place in a row below all."""
    rows = [replace(anatomy.spiking_msprt().population("STN"), name=name) for name in "AB"]
    circuit = anatomy.macaque().add(*rows)
    figure, ax = plt.subplots()
    show.draw(circuit, ax)
    names = {row.name for row in circuit.populations}
    x, y = ({t.get_text(): t.get_position()[k] for t in ax.texts} for k in (0, 1))
    assert names <= set(x)
    assert y["ctx"] == y["ctx_inh"] == show.PLACES["common"][1] > y["D1"] == y["STN"] > y["GPe"]
    assert x["D1"] == x["ctx_inh"] == x["A"] < x["D2"] == x["ctx"] < x["STN"]
    assert x["STN"] == show.PLACES["common"][0]
    assert y["A"] == y["B"] == y["SNr"] - 1
    for of, (low, high) in ((x, ax.get_xlim()), (y, ax.get_ylim())):
        inside = [of[name] for name in names]
        assert min(inside) - low == pytest.approx(high - max(inside))
    plt.close(figure)


@pytest.mark.parametrize(
    ("count", "given", "inches"), [(1, {}, 3), (5, {}, 6), (5, {"height": 2}, 10)]
)
def test_a_new_figure_has_room_for_every_panel(count, given, inches):
    """Six inches wide; 1.2 for a panel unless told otherwise, three at least."""
    axes = show.panels(count, **given)
    assert axes[0].figure.get_size_inches() == pytest.approx((6, inches))
    assert len(axes) == count
    plt.close(axes[0].figure)


def test_an_arrow_is_as_wide_as_the_root_of_its_weight_and_dotted_where_nothing_passes():
    """From .6 points at 0 to 3 at 4 nats, no further; a lesion of the whole source leaves dots."""
    weights = {"D1": 1.0, "D2": 4.0, "STN": 9.0}
    circuit = anatomy.spiking_msprt()
    for name, weight in weights.items():
        circuit = circuit.with_projection("ctx", name, weight=weight)
    circuit = circuit.with_projection("common", "ctx", weight=0.0).lesion("D2")
    figure, ax = plt.subplots()
    show.draw(circuit, ax)
    arrows = [text.arrow_patch for text in ax.texts if getattr(text, "arrow_patch", None)]
    drawn = {p.name: arrow for p, arrow in zip(circuit.projections, arrows, strict=True)}
    width = {name: arrow.get_linewidth() for name, arrow in drawn.items()}
    assert [width[f"ctx->{name}"] for name in weights] == pytest.approx([1.8, 3.0, 3.0])
    assert width["common->ctx"] == pytest.approx(0.6)
    dotted = {name for name, arrow in drawn.items() if arrow.get_linestyle() in (":", "dotted")}
    assert dotted == {"common->ctx", *(name for name in drawn if name.startswith("D2->"))}
    plt.close(figure)


def test_a_page_of_saliences_calls_nothing_nats():
    page = show.text(anatomy.gpr())
    assert "in salience, not nats: no posterior follows from OUT" in page
    assert "gain_hz_per_salience" in page
    assert "bias_salience" in page
    assert page.count("nats") == 1


def test_the_notebook_shows_both_tables_and_escapes_their_words():
    circuit = replace(anatomy.spiking_msprt(), about="a < b & c")
    page = circuit._repr_html_()
    assert page.count("<table") == 2
    assert "D1 -&gt; SNr" in page
    assert "a &lt; b &amp; c" in page
    assert "D1 -> SNr" not in page


@pytest.fixture
def activity():
    drive = np.zeros((2, 3, 2))
    return run(anatomy.spiking_msprt(), drive, engine="rate", step_ms=20.0)


def test_rates_are_drawn_a_panel_per_nucleus_and_a_line_per_channel(activity):
    axes = show.rates(activity, 1)
    assert len(axes) == len(activity.circuit.populations)
    drawn = dict(zip(activity.rates_hz, axes, strict=True))
    assert len(drawn["STN"].lines) == 2
    assert (drawn["STN"].lines[1].get_ydata() == activity.rates_hz["STN"][1, :, 1]).all()
    again = show.rates(activity, 0, axes)
    assert (again == axes).all()
    plt.close(axes[0].figure)


def test_what_cannot_be_drawn_is_said(activity, monkeypatch):
    with pytest.raises(ValueError, match=r"trial must lie in 0\.\.1, got 2"):
        show.rates(activity, 2)
    with pytest.raises(ValueError, match="kept no rates"):
        show.rates(replace(activity, rates_hz={}), 0)
    with pytest.raises(ValueError, match="ax must be 7 Axes, one per panel, got 1"):
        show.rates(activity, 0, Figure().subplots())
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    with pytest.raises(ImportError, match="a plot needs Matplotlib: pip install matplotlib"):
        show.rates(activity, 0)
