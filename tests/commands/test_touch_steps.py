"""The commands `touch simulate`, `touch train` and `touch decode`."""

import warnings
from dataclasses import fields, replace
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from bgmodel import cli
from bgmodel.commands.touch_steps import _taps
from bgmodel.support.files import checksum, read_provenance, read_table
from bgmodel.tactile.decoder import EDGE, Decoder, Training
from tests.helpers import refused, run
from tests.tactile.recorded import MM_PER_PX, hexagon, record


def test_taps_take_yaws_in_turn_or_from_all_of_a_half_turn(tmp_path, monkeypatch, refusal):
    simulate = Mock(side_effect=ValueError("taken"))
    monkeypatch.setattr("bgmodel.tactile.library.contact_library", lambda *arguments, **named: None)
    monkeypatch.setattr("bgmodel.tactile.sensor.simulate", simulate)
    two = ("touch", "simulate", "--save", tmp_path / "t.npz", "--periods-mm", 0, 2)
    assert "taken" in refusal(*two, "--taps", 3, "--yaw-deg", 0, 45)
    assert "taken" in refusal(*two, "--taps", 3000)
    (periods, yaw), (_, drawn) = (call.args for call in simulate.call_args_list)
    assert periods.tolist() == [0, 0, 0, 2, 2, 2]
    assert yaw.tolist() == [0, 45, 0, 45, 0, 45]
    assert len(drawn) == 6000
    assert -90 <= drawn.min() < -89 < 89 < drawn.max() <= 90


def test_taps_are_simulated_trained_on_and_decoded(tmp_path, refusal, capsys):
    """The whole way, on so few taps that only the way is tested."""
    taps, decoder, decoded = (tmp_path / n for n in ("t.npz", "d.safetensors", "x.csv"))
    simulate = ["touch", "simulate", "--periods-mm", 0, 5, "--save"]
    assert run(*simulate, taps, "--taps", 150, "--seed", 1) == 0
    first = taps.read_bytes()
    assert run(*simulate, taps, "--taps", 150, "--seed", 1, "--force") == 0
    assert taps.read_bytes() == first
    wrong = refusal("touch", "train", taps, "--save", decoder, "--edge")
    assert "holds taps of a grating: not edge" in wrong
    quick = ["--training", "width=0.1", "epochs=1", "batch=32"]
    assert run("touch", "train", taps, "--save", decoder, *quick) == 0
    told = capsys.readouterr().err
    assert "bgmodel: training on 300 taps for at most 1 epochs\n" in told
    assert run("touch", "decode", decoder, taps, "--save", decoded) == 0
    table = read_table(decoded)
    assert {"period_mm", "yaw_deg", "psi_deg", "orientation_deg"} <= set(table)
    assert len(table) == 300
    # The decoder knows these taps; it has not seen those that a task needs.
    assert table["trained_on"].all()
    decide = ("--task", "trials=40", "t_max=5", "period_mm=5")
    assert run("decide", "--save", tmp_path / "a.csv", "--task", f"taps={decoded}", *decide) == 2
    assert "was trained on 300 of its 300 taps" in capsys.readouterr().err
    held, fresh = tmp_path / "held.npz", tmp_path / "fresh.csv"
    assert run(*simulate, held, "--taps", 120, "--task", "same-different") == 0
    assert run("touch", "decode", decoder, held, "--save", fresh) == 0
    table = read_table(fresh)
    assert "trained_on" not in table
    error = np.abs(table["psi_deg"] - table["yaw_deg"]).mean()
    told = capsys.readouterr().out
    assert f"240 taps decoded, mean absolute error {error:.1f} degrees -> " in told
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        assert run("decide", "--save", tmp_path / "a.csv", "--task", f"taps={fresh}", *decide) == 0
    settings = read_provenance(tmp_path / "a.csv")["parameters"]["command"]["task"]
    assert settings["taps"] == {"file": "fresh.csv", "sha256": checksum(fresh)}
    assert settings["decoder"] == checksum(decoder)
    # Another task needs other yaws: the command that makes them is named.
    asked = ("--task", f"taps={fresh}", *decide, "--task", "orientation", "channels=3")
    asked += ("--posterior", 0.9)
    assert run("decide", "--save", tmp_path / "b.csv", *asked) == 2
    assert "--periods-mm 5 --yaw-deg -45 15 75" in capsys.readouterr().err


def test_a_decoder_of_recordings_is_stored_with_the_name_of_their_folder(tmp_path, monkeypatch):
    monkeypatch.setattr("bgmodel.commands.touch_steps.EDGE", replace(EDGE, epochs=1))
    folder = record(tmp_path / "my_taps", np.linspace(-180, 175, 320))
    out = tmp_path / "edge.safetensors"
    assert run("touch", "train", folder, "--save", out, "--edge", "--mm-per-px", MM_PER_PX) == 0
    about = Decoder.load(out).about
    assert about["command"]["taps"] == {"folder": "my_taps", "sha256": about["taps"]["sha256"]}


def test_the_count_of_pins_in_a_recording_is_said(tmp_path, capsys):
    folder = record(tmp_path / "my_taps", (-90, 0, 90), hexagon()[6:])  # a row at the rim is hidden
    taps, about = _taps(folder, True, MM_PER_PX, 91)
    assert len(taps) == 3
    assert about["recordings"] == "my_taps"
    assert "my_taps: 85 of 91 pins found, 85 to 85 of them per tap" in capsys.readouterr().out


def test_memory_is_asked_for_what_the_taps_take(tmp_path, monkeypatch, refusal):
    """Three times the displacements, two numbers of eight bytes per pin: 361 pins, 2 gratings."""
    check = Mock(side_effect=ValueError("asked"))
    monkeypatch.setattr("bgmodel.tactile.sensor.check_memory", check)
    options = ("--save", tmp_path / "t.npz", "--taps", 1000, "--periods-mm", 0, 5)
    assert "asked" in refusal("touch", "simulate", *options)
    assert [call.args[0] for call in check.call_args_list] == [3 * 2000 * 361 * 2 * 8]


CHOSEN = {
    "network": "edge", "width": 0.25, "epochs": 8, "patience": 3, "batch": 64,
    "learning_rate": 3e-3, "dropout": 0.5, "l2": 0.005, "validation": 0.25,
}  # fmt: skip


@pytest.mark.parametrize("edge", [True, False])
@pytest.mark.parametrize("name", [each.name for each in fields(Training)])
def test_a_training_option_is_used_for_edges_too_also_at_the_default_of_gratings(
    monkeypatch, name, edge
):
    fitted = Mock(side_effect=ValueError("asked"))
    monkeypatch.setattr("bgmodel.commands.touch_steps.fitted", fitted)
    monkeypatch.setattr("bgmodel.commands.touch_steps._taps", lambda *arguments: ([], {}))
    asked = ["touch", "train", "taps.npz", "--save", "edge.safetensors", *["--edge"] * edge]
    default = EDGE if edge else Training()
    for options, change in (([], {}), (["--training", f"{name}={CHOSEN[name]}"], CHOSEN)):
        assert run(*asked, *options) == 2
        training = replace(default, **{name: change.get(name, getattr(default, name))})
        assert fitted.call_args.kwargs["training"] == training


def test_a_count_of_pins_is_refused_with_a_file_of_taps(monkeypatch):
    decoder = SimpleNamespace(rest_mm=())
    monkeypatch.setattr("bgmodel.commands.touch_steps.load_decoder", lambda *_: decoder)
    with refused("pins"):
        cli.run(["touch", "decode", "taps.npz", "taps.npz", "--save", "d.csv", "--pins", "91"])
