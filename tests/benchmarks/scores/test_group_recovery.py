"""The score of recovery in a hierarchy: its groups, ranks and pieces."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm

from benchmarks.methods.group_recovery import MOST_SD, RANGES, compared, data_set, group
from benchmarks.scores import group_recovery, pieces
from benchmarks.scores.group_recovery import SETS, condensed, numbers, order, pooled
from benchmarks.scores.pieces import Piece, Score
from bgmodel.fitting.hierarchy.fit import GroupFit
from bgmodel.fitting.hierarchy.sampler import Draws
from bgmodel.fitting.hierarchy.scale import Scale
from bgmodel.support.files import write_table
from bgmodel.support.seeds import stream

SEED = 24_341
NAMES = ["sensitivity", "bound", "t0_s", "t0_sd_s", "lapse"]


def test_groups_are_within_the_limits_of_their_prior():
    low, high = np.array([RANGES[name] for name in NAMES]).T
    scale = Scale(np.zeros(5), 4 * high, high / 4)
    for number in range(20):
        truth = group(scale, NAMES, stream(SEED, number), 6)
        median = scale.back(truth.mean)
        assert ((low <= median) & (median <= high)).all()
        assert ((truth.sd > 0) & (truth.sd <= MOST_SD)).all()
        assert truth.scaled.shape == (6, 5)


@pytest.fixture(scope="module")
def small():
    return data_set("test", SEED, 3, people=3, each=8)


def test_people_of_a_data_set_have_trials_of_their_own(small):
    truth, found = small
    assert [each.design.trials.sum() for each in found.values()] == [32, 32, 32]
    times = [each.design.observed.rt_s for each in found.values()]
    assert not np.array_equal(times[0], times[1], equal_nan=True)
    again, same = data_set("test", SEED, 3, people=3, each=8)
    assert truth.scaled.tobytes() == again.scaled.tobytes()
    assert [each.design.observed.rt_s.tobytes() for each in same.values()] == [
        each.tobytes() for each in times
    ]


def test_ranks_are_those_among_draws_within_the_limits(small):
    truth, likelihoods = small
    rng = stream(SEED, "draws")
    chains = []
    for _ in range(4):
        mean = truth.mean + 0.1 * rng.normal(size=(50, 5))
        sd = np.full((50, 5), 0.5)
        # Far below the truth, and beyond the limits: they do not count.
        mean[:10] -= 100.0
        sd[10:20, 2] = MOST_SD + 0.1
        scaled = truth.scaled + rng.normal(size=(50, 3, 5))
        chains.append(Draws(mean, sd, scaled, np.zeros((50, 3))))
    fit = GroupFit(likelihoods, truth.scale, chains)
    found = compared(truth, fit)
    low, high = truth.scale.to(np.array([RANGES[name] for name in fit.parameters]).T)
    mean = np.concatenate([each.mean[20:] for each in chains])
    kept = mean[((mean >= low) & (mean <= high)).all(axis=1)]
    assert found["inside"].unique().tolist() == [len(kept)]
    assert 0 < len(kept) <= 120
    means = found[found["of"] == "mean"]
    assert means["mean_prior"].to_numpy() == pytest.approx(truth.scale.back(kept).mean(axis=0))
    ranks = means["rank"].to_numpy()
    assert ranks == pytest.approx((kept < truth.mean).mean(axis=0))
    spreads = found[found["of"] == "spread"]
    assert spreads["rank"].tolist() == (truth.sd > 0.5).astype(float).tolist()
    people = found[found["of"] == "person"]
    assert people["person"].unique().tolist() == ["00", "01", "02"]
    natural = truth.scale.back(truth.scaled)
    assert people["truth"].to_numpy().reshape(3, 5) == pytest.approx(natural)


def posteriors(sets, shift=0.0, narrower=1.0):
    """Return rows of the score for exact posteriors, or for shifted or too narrow ones."""
    rng = np.random.default_rng(SEED)
    truth = rng.normal(size=(sets, 4))
    middle = (truth + rng.normal(size=truth.shape)) / 2 + shift
    sd = narrower * np.sqrt(0.5)
    parts = []
    for k, (of, who) in enumerate(
        [("mean", ""), ("spread", ""), ("person", "00"), ("person", "01")]
    ):
        true, mean = truth[:, k], middle[:, k]
        parts.append(
            pd.DataFrame(
                {
                    "of": of,
                    "person": who,
                    "parameter": "bound",
                    "truth": true + 5,
                    "mean": mean + 5,
                    "mean_prior": mean + 5,
                    "low": mean - 1.645 * sd + 5,
                    "high": mean + 1.645 * sd + 5,
                    "rank": norm.cdf(true, mean, sd),
                    "inside": 400,
                    "draws": 400,
                    "rhat": 1.001,
                    "effective": 900.0,
                    "set": np.arange(sets),
                    "by": "test",
                }
            )
        )
    return pd.concat(parts, ignore_index=True)


def test_exact_posteriors_are_calibrated():
    found = pooled(condensed(posteriors(300))).set_index("of")
    assert (found["uniform_p"] > 0.01).all()
    assert (found["coverage"] - 0.9).abs().max() < 0.03
    assert (found["coverage_prior"] - found["coverage"]).abs().max() < 1e-9
    assert (found["converged_sets"] == 1).all()
    assert numbers(condensed(posteriors(300)))[["bias", "bias_prior"]].abs().max().max() < 0.03


@pytest.mark.parametrize("wrong", [{"shift": 0.3}, {"narrower": 0.6}])
def test_wrong_posteriors_are_not(wrong):
    found = pooled(condensed(posteriors(300, **wrong))).set_index("of")
    assert (found["uniform_p"] < 0.01).all()
    assert (found["coverage"] < 0.88).all()


def test_tables_of_stored_pieces_are_those_of_computed_ones(tmp_path):
    """Names of people are digits, which a file does not tell from numbers."""
    path = tmp_path / "sets.csv"
    posteriors(40).to_csv(path, index=False)
    found = [numbers(condensed(each)) for each in (pd.read_csv(path), posteriors(40))]
    pd.testing.assert_frame_equal(*found)


def test_data_sets_of_an_earlier_run_are_taken_from_the_stored_table(tmp_path, monkeypatch):
    """Tables of two runs are those of one, and what is stored is not computed again."""
    monkeypatch.setattr(group_recovery, "TABLES", tmp_path)
    every = posteriors(40)
    whole = {name: table for name, (_, table) in group_recovery.tables({"sets": every}).items()}
    score, path = group_recovery.SCORE, tmp_path / "recovery_groups_groups.csv"
    given = score.behind([group_recovery.SIZE], False)
    write_table(condensed(every[every["set"] < 25]), path, seed=score.seed, **given)
    left = [piece.name for piece in group_recovery.pieces(False, 1)]
    assert len(left) == sum(SETS.values()) - 25
    assert "test 024" not in left
    assert "test 025" in left
    later = group_recovery.tables({"sets": every[every["set"] >= 25]})
    for name, table in whole.items():
        found = later[name][1].reset_index(drop=True)
        pd.testing.assert_frame_equal(found, table.reset_index(drop=True), check_dtype=False)
    again = group_recovery.tables({"sets": every[every["set"] < 2]})
    assert again["groups"][1]["set"].nunique() == 2
    write_table(condensed(every), path, seed=score.seed + 1, **given)
    assert len(list(group_recovery.pieces(False, 1))) == sum(SETS.values())


def test_data_sets_after_a_gap_wait(tmp_path, monkeypatch):
    """Those that finish first are the easy ones."""
    monkeypatch.setattr(group_recovery, "TABLES", tmp_path)
    every = posteriors(40)
    some = group_recovery.tables({"sets": every[~every["set"].isin([7, 30])]})
    assert (some["numbers"][1]["sets"] == 7).all()
    assert some["groups"][1]["set"].nunique() == 38
    assert list(group_recovery.tables({"sets": every[every["set"] > 3]})) == ["groups"]


def test_a_number_that_did_not_converge_counts_against_its_set():
    some = posteriors(10)
    some.loc[(some["set"] == 3) & (some["of"] == "spread"), "effective"] = 399.0
    found = pooled(condensed(some)).set_index("of")
    assert found.loc["group", "converged"] == pytest.approx(0.95)
    assert found.loc["group", "converged_sets"] == pytest.approx(0.9)
    assert found.loc["person", "converged_sets"] == 1


def test_every_data_set_has_one_turn():
    turns = list(order(**{f"{by}s": count for by, count in SETS.items()}))
    assert sorted(turns) == sorted((by, k) for by, count in SETS.items() for k in range(count))
    assert turns[:6] == [*(("test", k) for k in range(4)), ("circuit", 0), ("test", 4)]


class Stopped(Exception):
    """A run that is stopped in the middle of a piece."""


def score_of(stops, made):
    """Return a score of four pieces, one of which stops the first time."""

    def make(number):
        if number in stops:
            stops.remove(number)
            raise Stopped
        made.append(number)
        return pd.DataFrame({"number": [number], "drawn": stream(SEED, number).random(1)})

    def every(fast, workers):
        for number in range(4):
            yield Piece("sets", f"{number}", 8, 1, lambda number=number: make(number))

    return Score("some", SEED, (), every, lambda found: {"all": ("sets", found["sets"])},
                 circuit="", partial=True)  # fmt: skip


def test_a_run_that_was_stopped_goes_on_to_the_same_bytes(tmp_path, monkeypatch, capsys):
    written = {}
    for name, stops in {"whole": [], "stopped": [2]}.items():
        folder, tables = tmp_path / name, tmp_path / f"{name} tables"
        folder.mkdir()
        tables.mkdir()
        monkeypatch.setattr(pieces, "TABLES", tables)
        made = []
        score = score_of(stops, made)
        every = list(score.pieces(False, 1))
        if stops:
            with pytest.raises(Stopped):
                pieces.run(score, every, folder, False, "")
            assert made == [0, 1]
            pieces.run(score, every, folder, False, "no piece")
            partly = pd.read_csv(tables / "some_all.csv")
            assert partly["number"].tolist() == [0, 1]
        pieces.run(score, every[::-1], folder, False, "")
        pieces.run(score, every, folder, False, "")
        assert sorted(made) == [0, 1, 2, 3]
        written[name] = {
            path.name: path.read_bytes() for path in (*folder.iterdir(), *tables.iterdir())
        }
    assert written["whole"] == written["stopped"]
    assert len(written["whole"]) == 10
