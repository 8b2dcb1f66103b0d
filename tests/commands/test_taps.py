"""The commands `simulate`, `train` and `decode`."""

from bgmodel.commands.taps import _taps
from bgmodel.support.files import read_table
from tests.helpers import run
from tests.tactile.recorded import MM_PER_PX, draw, field, hexagon, write


def test_taps_take_yaws_in_turn_or_from_all_of_a_half_turn(tmp_path, monkeypatch, refusal):
    taken = []

    def stop(periods, yaw, **given):
        taken.append((periods, yaw))
        raise ValueError("taken")

    monkeypatch.setattr("bgmodel.tactile.library.contact_library", lambda *given, **named: None)
    monkeypatch.setattr("bgmodel.tactile.sensor.simulate", stop)
    two = ("simulate", tmp_path / "t.npz", "--periods-mm", 0, 2)
    assert run(*two, "--taps", 3, "--yaw-deg", 0, 45) == 2
    assert "taken" in refusal(*two, "--taps", 3000)
    (periods, yaw), (_, drawn) = taken
    assert periods.tolist() == [0, 0, 0, 2, 2, 2]
    assert yaw.tolist() == [0, 45, 0, 45, 0, 45]
    assert len(drawn) == 6000
    assert -90 <= drawn.min() < -89 < 89 < drawn.max() <= 90


def test_taps_are_simulated_trained_on_and_decoded(tmp_path, refusal, capsys):
    """The whole way, on so few taps that only the way is tested."""
    taps, decoder, decoded = (tmp_path / n for n in ("t.npz", "d.safetensors", "x.csv"))
    periods = ["--periods-mm", 0, 5]
    assert run("simulate", taps, "--taps", 150, *periods, "--seed", 1) == 0
    first = taps.read_bytes()
    assert run("simulate", taps, "--taps", 150, *periods, "--seed", 1, "--force") == 0
    assert taps.read_bytes() == first
    assert "holds taps of a grating, not of an edge" in refusal("train", taps, decoder, "--edge")
    quick = ["--training.width", 0.1, "--training.epochs", 1, "--training.batch", 32]
    assert run("train", taps, decoder, *quick) == 0
    told = capsys.readouterr().err
    assert "bgmodel: training on 300 taps, 1 epochs at most\n" in told
    assert run("decode", decoder, taps, decoded) == 0
    table = read_table(decoded)
    assert {"period_mm", "yaw_deg", "psi_deg", "orientation_deg"} <= set(table)
    assert len(table) == 300


def test_the_count_of_pins_in_a_recording_is_said(tmp_path, capsys):
    shown = hexagon()[6:]  # a row at the rim is hidden
    images = [draw(shown + field(shown, yaw)) for yaw in (-90, 0, 90)]
    folder = write(tmp_path / "my_taps", images, "dev-data")
    taps, about = _taps(folder, MM_PER_PX, edge=True, pins=91)
    assert len(taps) == 3
    assert about["recordings"] == "my_taps"
    assert "my_taps: 85 of 91 pins found, 85 to 85 of them per tap" in capsys.readouterr().out


def test_memory_is_asked_for_what_the_taps_take(tmp_path, monkeypatch, refusal):
    """Three times the displacements, two numbers of eight bytes per pin: 361 pins, 2 gratings."""
    asked = []

    def refuse(needed, what):
        asked.append(needed)
        raise ValueError("asked")

    monkeypatch.setattr("bgmodel.commands.taps.check_memory", refuse)
    assert "asked" in refusal("simulate", tmp_path / "t.npz", "--taps", 1000, "--periods-mm", 0, 5)
    assert asked == [3 * 2000 * 361 * 2 * 8]
