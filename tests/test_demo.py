"""The demo: its decisions are those of the engines, and its picture shows them."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from bgmodel import demo as demos
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.support.seeds import stream
from circuits.anatomy import load_circuit
from tests.helpers import ROOT, run

pytestmark = pytest.mark.usefixtures("no_check_of_noise")


@pytest.fixture(scope="module")
def found():
    """Return the trial up to shortly after its decisions: the readable engine is slow."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demos, "READINGS", 14)
        return demos.demo(seed=1)


def test_its_decision_is_that_of_the_compiled_engine(found):
    table = load_circuit("macaque", 3)
    model = BasalGanglia(table, "ensemble", gain_of(table), 1)
    out = model.run(found.evidence).out_nats
    assert np.allclose(out, found.traces["circuit"].out_nats)


def test_it_says_and_draws_both_decisions(found):
    said, figure = found.summary(), demos.draw(found)
    for name, decision in found.decisions.items():
        time_ms = decision.time_ms[0]
        assert f"chose alternative 1 (right) after {time_ms:.0f} ms" in said
        style = "--" if name == "MSPRT" else "-"
        for panel in figure.axes:
            assert any(
                line.get_linestyle() == style and list(line.get_xdata()) == [time_ms, time_ms]
                for line in panel.lines
            )
    plt.close(figure)


def test_the_demo_shows_the_trial_that_it_describes(found):
    """Readings of unit noise, every 50 ms, the true one's mean so far off that d' is 0.8."""
    assert "evidence every 50 ms" in found.summary()
    assert "OUT falls to -ln 0.85 is chosen" in found.summary()
    apart = 0.8 / np.sqrt(2)
    noise = found.evidence.log_likelihood / apart - apart * np.array([1, 0, 0])
    assert np.allclose(noise, stream(1, "demo").standard_normal((1, 14, 3)))
    for name, decision in found.decisions.items():
        trace = found.traces[name]
        at = int(np.searchsorted(trace.time_ms, decision.time_ms[0]))
        out = trace.out_nats[0, :, decision.choice[0]]
        assert out[at] <= -np.log(0.85) + 1e-9
        assert (out[:at] > -np.log(0.85) - 1e-9).all()


def test_the_picture_is_as_large_as_in_the_docs_and_shaded_to_the_top_where_out_is_not_read(found):
    figure = demos.draw(found)
    high, wide = plt.imread(ROOT / "docs" / "demo.png").shape[:2]
    assert np.allclose(200 * figure.get_size_inches(), (wide, high))
    panel = figure.axes[1]
    (shade,) = panel.patches
    low, top = shade.get_extents().transformed(panel.transData.inverted()).get_points()[:, 1]
    assert (low, top) == pytest.approx((found.readable_nats, panel.get_ylim()[1]))
    assert {round(line.get_linewidth(), 3) for ax in figure.axes for line in ax.lines[-2:]} == {0.8}
    plt.close(figure)


def test_rasters_have_the_spikes_from_the_onset_on_of_as_many_cells_as_the_title_says(found):
    figure = demos.draw(found)
    for panel, name in zip(figure.axes[2:], demos.NUCLEI, strict=True):
        spikes = found.spikes[name]
        late = spikes[(spikes["time_ms"] > 0) & (spikes["neuron"] < demos.CELLS)]
        drawn = np.concatenate(
            [line.get_xdata() for line in panel.lines if line.get_marker() == "s"]
        )
        assert sorted(drawn) == sorted(late["time_ms"])
    assert f"{demos.CELLS} cells per alternative" in figure.axes[2].get_title("left")
    plt.close(figure)


def test_the_command_writes_a_picture_and_says_what_one_sees(found, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(demos, "demo", lambda *_: found)
    assert run("demo", tmp_path / "demo.svg") == 0
    said = capsys.readouterr().out
    assert found.summary() in said
    assert said.endswith(f"-> {tmp_path / 'demo.svg'}\n")
    assert (tmp_path / "demo.svg").stat().st_size > 1000
    assert run("demo", tmp_path / "demo.svg") == 2
    assert run("demo", tmp_path / "two.svg", "--alternatives", 2) == 0
    assert "spiking cells\n" in capsys.readouterr().err
