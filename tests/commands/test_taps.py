"""The commands `simulate`, `train` and `decode`."""

from bgmodel.files import read_table
from tests.helpers import run


def test_taps_are_simulated_trained_on_and_decoded(tmp_path, capsys):
    """The whole way, on so few taps that only the way is tested."""
    taps, decoder, decoded = (tmp_path / n for n in ("t.npz", "d.safetensors", "x.csv"))
    periods = ["--periods-mm", 0, 5]
    assert run("simulate", taps, "--taps", 150, *periods, "--seed", 1) == 0
    first = taps.read_bytes()
    assert run("simulate", taps, "--taps", 150, *periods, "--seed", 1, "--force") == 0
    assert taps.read_bytes() == first
    assert run("train", taps, decoder, "--edge") == 2
    assert "holds taps of a grating, not of an edge" in capsys.readouterr().err
    quick = ["--training.width", 0.1, "--training.epochs", 1, "--training.batch", 32]
    assert run("train", taps, decoder, *quick) == 0
    assert run("decode", decoder, taps, decoded) == 0
    table = read_table(decoded)
    assert {"period_mm", "yaw_deg", "psi_deg", "orientation_deg"} <= set(table)
    assert len(table) == 300
