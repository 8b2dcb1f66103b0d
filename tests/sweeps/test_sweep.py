"""A sweep in Python: the command's numbers, with labels."""

import numpy as np
import pytest

from bgmodel.cli import main
from bgmodel.support.files import read_table
from bgmodel.sweeps.sweep import Sweep
from circuits.errors import BgmodelWarning

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")
GRID = """
engine = "rate"
circuit = "macaque"
posterior = 0.7
seed = 3
[task]
trials = 60
t_max = 20
d_prime = 1.0
[grid]
"lesion STN" = [0, 0.05]
"task.channels" = [2, 3]
"""


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("sweep") / "grid.toml"
    path.write_text(GRID)
    return path


@pytest.fixture(scope="module")
def outcome(file):
    return Sweep.from_toml(file).run()


def test_it_has_the_numbers_of_the_command(file, outcome, tmp_path):
    assert main(["sweep", str(file), str(tmp_path / "out"), "--workers", "1"]) == 0
    expected = read_table(tmp_path / "out" / "outcome.csv")
    mine = outcome.to_dataframe()
    assert list(mine) == list(expected)
    for name in ("value", "low", "high"):
        assert np.allclose(mine[name], expected[name], equal_nan=True)


def test_a_part_is_computed_into_a_folder_that_is_named_as_text(file, tmp_path):
    sweep, folder = Sweep.from_toml(file), str(tmp_path / "out")
    first, second = (sweep.part(f"{k}/2") for k in (1, 2))
    sweep.compute(folder, part="1/2")
    assert sweep.status(folder)[1] == second
    assert sweep.status(folder, "1/2")[1] == []
    assert len(first) + len(second) == len(sweep.shards)


def test_labels_are_keys_and_measures(outcome):
    labelled = outcome.to_xarray()
    assert dict(labelled.sizes) == {"lesion_STN": 2, "task_channels": 2, "of": 3}
    assert set(labelled) == set(outcome.table["measure"])
    one = labelled.accuracy.sel(lesion_STN=0.05, task_channels=3, of="value")
    rows = outcome.table.query("`lesion STN` == 0.05 and measure == 'accuracy'")
    assert float(one) == rows.loc[rows["task.channels"] == 3, "value"].item()


def test_a_summary_has_the_points_of_the_plan_and_no_others(tmp_path):
    points = '[[points]]\n"lesion STN" = {}\n"task.d_prime" = {}\n'
    listed = tmp_path / "listed.toml"
    two = points.format(0.05, 0.5) + points.format(0, 0.8)
    listed.write_text(GRID.partition("[grid]")[0] + two)
    summary = Sweep.from_toml(listed).run().summary()
    assert summary.index.tolist() == [(0.05, 0.5), (0.0, 0.8)]
    assert summary["accuracy"].notna().all()


def test_remarks_on_points_are_warned_of_in_python_as_at_the_terminal(file, tmp_path):
    short = tmp_path / "short.toml"
    short.write_text(GRID.replace("t_max = 20", "t_max = 3").replace("d_prime = 1.0", ""))
    with pytest.warns(BgmodelWarning) as caught:
        outcome = Sweep.from_toml(short).run()
    remarks = [str(each.message) for each in caught if "points (" in str(each.message)]
    assert remarks
    assert remarks == outcome.cautions()
    with pytest.warns(BgmodelWarning) as again:
        assert main(["sweep", str(short), str(tmp_path / "out"), "--workers", "1"]) == 0
    assert {*remarks} <= {str(each.message) for each in again}


def test_what_lies_in_a_folder_is_not_computed_again(file, outcome, tmp_path, monkeypatch):
    Sweep.from_toml(file).run(tmp_path)
    monkeypatch.setattr("bgmodel.sweeps.shards.compute", None)
    again = Sweep.from_toml(file).run(tmp_path)
    assert again.table.equals(outcome.table)
