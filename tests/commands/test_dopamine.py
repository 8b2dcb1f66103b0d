"""The command `circuit learn`."""

from bgmodel.cli import main
from bgmodel.files import read_table


def test_the_command_says_before_it_starts_how_long_it_takes(tmp_path, monkeypatch, capsys):
    def stop(*given):
        raise ValueError("started")

    monkeypatch.setattr("bgmodel.learning.level.level_outcomes", stop)
    assert main(["circuit", "learn", str(tmp_path / "a.csv")]) == 2
    said = capsys.readouterr().err
    assert (
        "learning in spiking_msprt on rate, 16 circuits, 500 trials of up to 1.6 s: about" in said
    )
    assert said.index("about") < said.index("started")


def test_the_command_learns_and_says_what_it_did(tmp_path, capsys):
    path = tmp_path / "dopamine.csv"
    small = ["--trials", "40", "--t-max", "10", "--levels", "4", "--runs", "2"]
    assert main(["circuit", "learn", str(path), *small, "--learner.episodes", "600"]) == 0
    assert "learned level" in capsys.readouterr().out
    table = read_table(path)
    assert list(table) == ["run", "episode", "tonic", "level", "reward", "phasic"]
    assert len(table) == 1200
    assert main(["circuit", "learn", str(path), *small, "--start-level", "3", "--force"]) == 2
    assert (
        "start_level must lie where spiking_msprt decides by evidence, 0.837..1.696, got 3"
        in capsys.readouterr().err
    )
