"""The command `fit --hierarchical`."""

import json

import pandas as pd
import pytest

from bgmodel.fitting.hierarchy import chains
from bgmodel.support.files import read_provenance
from tests.fitting.conftest import PEOPLE as PERSONS
from tests.fitting.conftest import table
from tests.helpers import run, words

GROUP, PEOPLE, CELLS = "group.csv", "people.csv", "people_cells.csv"
CORRELATIONS = "group_correlations.csv"
SINGLE = words("mine.csv out --strength strength --models constant_gap --fix t0_sd_s=0.05 t0_s=0.3")
SINGLE += ["--fix", "lapse=0.01"]
ASKED = [*SINGLE, "--people", "hierarchical", "--workers", "1"]


@pytest.fixture
def mine(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # Few draws: their agreement is tested elsewhere.
    monkeypatch.setattr(chains, "BLOCK", 40)
    monkeypatch.setattr(chains, "WARM_UP", 10)
    monkeypatch.setattr(chains, "LARGEST_RHAT", 10.0)
    monkeypatch.setattr(chains, "FEWEST_EFFECTIVE", 5.0)
    three = {who: PERSONS[who] for who in ("anna", "cleo", "dora")}
    table(three, trials=20).to_csv("mine.csv", index=False)
    return tmp_path


def test_it_writes_tables_a_figure_and_draws_and_goes_on_from_them(mine, capsys):
    assert run("fit", *ASKED) == 0
    assert "bound" in capsys.readouterr().out
    group, people = (pd.read_csv(mine / "out" / name) for name in (GROUP, PEOPLE))
    assert group["parameter"].tolist() == ["sensitivity", "bound"]
    assert len(people) == 6
    assert pd.read_csv(mine / "out" / CELLS)["participant"].tolist() == ["anna", "cleo", "dora"]
    assert (mine / "out" / "constant_gap cells.png").is_file()
    assert {path.suffix for path in (mine / "out").iterdir()} > {".nc", ".png", ".csv"}
    assert read_provenance(mine / "out" / GROUP)["parameters"]["trials"]
    assert run("fit", *ASKED, "--fix", "lapse=0.02") == 2
    assert "holds fits that differ in fix" in capsys.readouterr().err
    assert run("fit", *ASKED, "--json") == 0
    records = json.loads(capsys.readouterr().out)["records"]
    assert records[0]["median"] == pytest.approx(group["median"][0])


def test_models_are_compared_by_the_draws(mine, capsys):
    both = [*ASKED, "--models", "constant_gap", "falling_gap", "--compare"]
    assert run("fit", *both) == 0
    assert "PSIS-LOO" in capsys.readouterr().out
    table = pd.read_csv(mine / "out" / "comparison.csv")
    assert set(table["model"]) == {"constant_gap", "falling_gap"}
    assert (mine / "out" / "comparison.png").is_file()


def test_fits_of_both_kinds_have_one_folder(mine):
    """Neither writes over the other's tables."""
    assert run("fit", *SINGLE) == 0
    assert run("fit", *ASKED) == 0
    before = {path.name: path.read_bytes() for path in (mine / "out").glob("*.csv")}
    assert run("fit", *SINGLE) == 0
    assert {path.name: path.read_bytes() for path in (mine / "out").glob("*.csv")} == before


def test_people_with_other_strengths_have_no_figure_of_averages(mine, capsys):
    trials = pd.read_csv("mine.csv")
    trials.loc[trials["participant_id"] == "cleo", "strength"] *= 1.05
    trials.to_csv("mine.csv", index=False)
    assert run("fit", *ASKED) == 0
    assert "people have different strengths" in capsys.readouterr().out
    assert not (mine / "out" / "constant_gap cells.png").exists()
    assert len(pd.read_csv(mine / "out" / CELLS)) == 3


def test_another_prior_or_correlations_have_chains_of_their_own(mine, capsys):
    def stored():
        return {path.name for path in (mine / "out" / "pieces").glob("*chains*")}

    together = ["correlated" if word == "hierarchical" else word for word in ASKED]
    asked = [*together, "--prior", "bound=0.3:0.9"]
    assert run("fit", *asked) == 0
    told = capsys.readouterr().out
    assert "priors (central 95 %): bound 0.3 to 0.9" in told
    assert "correlations between people" in told
    related = pd.read_csv(mine / "out" / CORRELATIONS)
    assert related[["first", "second"]].to_numpy().tolist() == [["sensitivity", "bound"]]
    made = read_provenance(mine / "out" / GROUP)["parameters"]
    assert (made["prior"], made["people"]) == (["bound=0.3:0.9"], "correlated")
    seen = stored()
    assert run("fit", *asked, "--force") == 0
    assert stored() == seen
    for other in ([*together, "--prior", "bound=0.3:0.8"], [*ASKED, *asked[-2:]], ASKED):
        before = stored()
        assert run("fit", *other, "--force") == 0
        assert len(stored() - before) == 1
    capsys.readouterr()
    assert run("fit", *ASKED, "--prior", "bound=0.3", "--force") == 2
    assert "prior must give two numbers" in capsys.readouterr().err
