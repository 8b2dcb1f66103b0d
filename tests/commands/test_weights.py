"""The command that lets reward teach what readings mean."""

import pandas as pd
import pytest

from bgmodel.support.files import read_provenance
from tests.helpers import run

SHORT = ("--runs", 2, "--learner.trials", 600, "--t-max", 20)


def test_weights_are_learned_and_written_with_their_scores(tmp_path, capsys):
    out, picture = tmp_path / "weights.parquet", tmp_path / "weights.png"
    assert run("learn-weights", out, *SHORT, "--seed", 3, "--drawing", picture) == 0
    assert picture.stat().st_size > 5000
    assert "of that with them" in capsys.readouterr().out
    table = pd.read_parquet(out)
    assert list(table) == ["run", "hypothesis", "unit", "weight"]
    assert len(table) == 2 * 2 * 16
    about = read_provenance(out)["parameters"]
    assert len(about["summary"]["slope"]) == 2
    assert min(about["summary"]["r"]) > 0.7


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (("--rule", "hebb"), "rule must be one of confidence"),
        (("--critic", "exact"), "critic must be one of mean"),
        (("--posterior", 0.5), "posterior must be above 0.5"),
        (("--units", 1), "units must be at least 2"),
        (("--runs", 0), "runs must be at least 1"),
        (("--channels", 3), "same-different has 2 alternatives"),
        (("--fold", 7), "fold must be 0..5"),
        (("--drawing", "weights.txt"), "drawing must end in"),
        (("--feedback.given", 0), "nothing can be learned"),
        (("--feedback.wrong", -1), "takes rewards as 0 or 1"),
    ],
)
def test_options_that_cannot_be_met_are_refused(tmp_path, capsys, wrong, said):
    out = tmp_path / "weights.csv"
    assert run("learn-weights", out, *wrong) == 2
    assert said in capsys.readouterr().err
    assert not out.exists()
