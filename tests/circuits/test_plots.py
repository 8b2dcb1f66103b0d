"""Drawings of a circuit and of its rates."""

import sys
from dataclasses import replace

import matplotlib.pyplot as plt
import pytest
from matplotlib.figure import Figure

from circuits import anatomy, plots
from circuits.declaration.rows import GABA, Population, Projection
from tests.helpers import refused


def test_the_drawing_shows_every_nucleus_and_pathway():
    extra = Population("PPN", anatomy.bogacz_gurney().populations[0].cell, cite="test")
    circuit = anatomy.spiking_msprt().add(extra, Projection("PPN", "STN", 1, cite="test"))
    figure, ax = plt.subplots()
    assert plots.draw(circuit, ax) is ax
    labels = {text.get_text() for text in ax.texts}
    assert {row.name for row in circuit.populations} <= labels
    arrows = [text for text in ax.texts if getattr(text, "arrow_patch", None)]
    assert len(arrows) == len(circuit.projections)
    assert circuit.population("GPe").transmitter == GABA
    plt.close(figure)


def test_nuclei_stand_in_rows_and_columns_with_even_margins():
    """Cortex above striatum, pooled nuclei next to it; nuclei without a position in a row below."""
    rows = [replace(anatomy.spiking_msprt().population("STN"), name=name) for name in "AB"]
    circuit = anatomy.macaque().add(*rows)
    figure, ax = plt.subplots()
    plots.draw(circuit, ax)
    names = {row.name for row in circuit.populations}
    x, y = ({t.get_text(): t.get_position()[k] for t in ax.texts} for k in (0, 1))
    assert names <= set(x)
    assert y["ctx"] == y["ctx_inh"] == plots.PLACES["common"][1] > y["D1"] == y["STN"] > y["GPe"]
    assert x["D1"] == x["ctx_inh"] == x["A"] < x["D2"] == x["ctx"] < x["STN"]
    assert x["STN"] == plots.PLACES["common"][0]
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
    axes = plots.panels(count, **given)
    assert axes[0].figure.get_size_inches() == pytest.approx((6, inches))
    assert len(axes) == count
    plt.close(axes[0].figure)


def test_an_arrow_is_as_wide_as_the_root_of_its_weight_and_dotted_where_nothing_passes():
    """From 0.6 points at 0 to 3 at 4 nats, no further; a lesion of the whole source leaves dots."""
    weights = {"D1": 1.0, "D2": 4.0, "STN": 9.0}
    circuit = anatomy.spiking_msprt()
    for name, weight in weights.items():
        circuit = circuit.with_projection("ctx", name, weight=weight)
    circuit = circuit.with_projection("common", "ctx", weight=0.0).lesion("D2")
    figure, ax = plt.subplots()
    plots.draw(circuit, ax)
    arrows = [text.arrow_patch for text in ax.texts if getattr(text, "arrow_patch", None)]
    drawn = {p.name: arrow for p, arrow in zip(circuit.projections, arrows, strict=True)}
    width = {name: arrow.get_linewidth() for name, arrow in drawn.items()}
    assert [width[f"ctx->{name}"] for name in weights] == pytest.approx([1.8, 3.0, 3.0])
    assert width["common->ctx"] == pytest.approx(0.6)
    dotted = {name for name, arrow in drawn.items() if arrow.get_linestyle() in (":", "dotted")}
    assert dotted == {"common->ctx", *(name for name in drawn if name.startswith("D2->"))}
    plt.close(figure)


def test_a_circuit_plots_itself_on_a_new_figure_or_on_given_axes():
    ax = anatomy.spiking_msprt().plot()
    assert anatomy.spiking_msprt().lesion("STN", 0.5).plot(ax) is ax
    assert "STN\n50%" in {text.get_text() for text in ax.texts}
    plt.close(ax.figure)
    with refused("ax"):
        anatomy.spiking_msprt().plot(Figure().subplots(2))


def test_without_matplotlib_a_plot_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    with pytest.raises(ImportError, match="a plot needs Matplotlib: pip install matplotlib"):
        plots.panels(1)
