"""A circuit on one page, as a drawing and as NWB; the command that shows and runs it."""

import json

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from bgmodel.cli import main
from circuits import anatomy, show
from circuits.engines import ENGINES
from circuits.engines.ensemble import run as ensemble
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


def test_edits_show():
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


def test_nwb_reads_back(tmp_path):
    pynwb = pytest.importorskip("pynwb")
    from circuits.nwb import write_nwb

    circuit = anatomy.spiking_msprt().with_neurons(20)
    activity = ensemble.run(
        circuit, np.zeros((2, 1, 2)), step_ms=50, seed=1, settle_ms=10, spikes=("STN", "GPe")
    )
    for _ in range(2):
        write_nwb(activity, tmp_path / "a.nwb", trial=1)
    assert [path.name for path in tmp_path.iterdir()] == ["a.nwb"]
    with pynwb.NWBHDF5IO(str(tmp_path / "a.nwb"), "r") as file:
        read = file.read()
        units = read.units.to_dataframe()
        table = activity.spikes["STN"]
        expected = np.sort(table[table["trial"] == 1]["time_ms"].to_numpy()) / 1000
        found = units[units["population"] == "STN"]["spike_times"]
        np.testing.assert_allclose(np.sort(np.concatenate(found.to_list())), expected)
        assert len(units) == 2 * 2 * 20  # silent cells too
        out = read.acquisition["OUT"]
        np.testing.assert_array_equal(out.data[:], activity.output_nats[1])
        assert json.loads(read.notes)["seed"] == 1
    with pytest.raises(ValueError, match=r"trial must be 0\.\.1, got 2"):
        write_nwb(activity, tmp_path / "b.nwb", trial=2)


@pytest.mark.parametrize(
    "command", [("run", "a.csv"), ("lesion", "a.csv"), ("learn", "a.csv"), ("show",)]
)
def test_an_unknown_circuit_or_engine_is_answered_with_all_there_are(command, capsys, monkeypatch):
    """The lists are those of the circuits: one more is known to every command."""
    monkeypatch.setitem(anatomy.CIRCUITS, "mine", anatomy.bogacz_gurney)
    monkeypatch.setitem(ENGINES, "pen", "by hand")
    circuit = ("cortex",) if command == ("show",) else ("--circuit", "cortex")
    assert run(*command, *circuit) == 2
    said = capsys.readouterr().err
    assert all(name in said for name in anatomy.CIRCUITS), said
    assert len(said.splitlines()) == 1
    if command != ("show",):
        assert run(*command, "--engine", "quill") == 2
        timed = set(ENGINES) - ({"algebra"} if command[0] == "learn" else set())
        said = capsys.readouterr().err
        assert all(name in said for name in timed), said


def run(*arguments):
    return main(["circuit", *map(str, arguments)])


def test_show_command(capsys, tmp_path):
    drawing = tmp_path / "c.svg"
    edits = ["--edits.without", "STN=0.5", "--edits.scale", "D1->SNr=0.9"]
    assert run("show", "appendix_b", *edits, "--drawing", drawing) == 0
    assert "not exact" in capsys.readouterr().out
    assert drawing.stat().st_size > 1000


def test_show_says_whose_noise_it_is(capsys):
    """More cells of a nucleus, less of its noise; where there are no cells, none."""
    said = []
    for edits in ([], ["--edits.neurons", "1200"]):
        assert run("show", "spiking_msprt", "--noise", "0.85", *edits) == 0
        line = capsys.readouterr().out.splitlines()[-1]
        said.append(float(line.split("scatters by ")[1].split(" nats")[0]))
        shares = [int(part.split("%")[0]) for part in line.split("variance ")[1].split(" ")[1::2]]
        assert 97 <= sum(shares) <= 103
    assert said[1] == pytest.approx(said[0] / 2, abs=0.001)
    assert run("show", "appendix_b", "--noise", "0.85") == 0
    assert "does not scatter" in capsys.readouterr().out


@pytest.mark.parametrize("engine", ["ensemble", "algebra", "rate"])
def test_run_command(capsys, tmp_path, engine):
    table, rates = tmp_path / "d.csv", tmp_path / "r.csv"
    options = ["--trials", 6, "--t-max", 4, "--seed", 3, "--channels", 3]
    options += ["--edits.neurons", 30] if engine == "ensemble" else []
    assert run("run", table, "--engine", engine, "--rates", rates, *options) == 0
    assert "6 trials, accuracy" in capsys.readouterr().out
    first = pd.read_csv(table, comment="#")
    assert len(first) == 6
    assert {"rt", "response", "stimulus", "correct"} <= set(first)
    assert {"population", "channel", "time_ms", "rate_hz"} <= set(pd.read_csv(rates, comment="#"))
    again = tmp_path / "again.csv"
    assert run("run", again, "--engine", engine, *options, "--workers", 1) == 0
    pd.testing.assert_frame_equal(first, pd.read_csv(again, comment="#"))


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["show", "spiking_msprt", "--edits.without", "GPi"], "has no nucleus 'GPi': ctx, "),
        (["show", "spiking_msprt", "--edits.without", "SNr"], "SNr is the read-out"),
        (["show", "spiking_msprt", "--edits.scale", "STN=2"], 'a pathway like "STN->GPe=0.5"'),
        (["show", "spiking_msprt", "--edits.scale", "STN->GPe=x"], "a name, =, and a number"),
        (["show", "spiking_msprt", "--edits.neurons", "0"], "neurons must be a whole number"),
        (["show", "spiking_msprt", "--noise", "0.99"], "that spiking_msprt reads, 0.52 to 0.95"),
        (
            ["show", "spiking_msprt", "--noise", "0.8", "--edits.spread", "0.1"],
            "those of ctx differ by 10%",
        ),
        (["run", "d.txt"], "output must end in .parquet or .csv"),
        (["run", "d.csv", "--posterior", "1"], "posterior must lie between chance"),
        (["run", "d.csv", "--d-prime", "0"], "d_prime must be > 0"),
        (
            ["run", "d.csv", "--edits.without", "STN=0.5"],
            "rests at OUT = 0.00, which is not above",
        ),
        (["run", "d.csv", "--posterior", "0.501"], "it would decide without evidence"),
    ],
)
def test_bad_use_gets_one_clear_sentence(capsys, arguments, says):
    assert run(*arguments) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert says in lines[0]
