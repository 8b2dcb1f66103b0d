"""Figures of models held to monkeys, people and patients, drawn from small tables."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from bgmodel.fitting.exact.algorithms import GapModel
from bgmodel.fitting.fit import cells_of
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.trials.design import design_of
from bgmodel.integrators.given import identity
from bgmodel.support.files import read_table, write_table
from bgmodel.trials.reading import read_trials
from circuits.anatomy import DEFAULT, load_circuit
from circuits.dynamics.fixed_point import resting_hz
from figures import figF1, figF2, figF3, figF4, figF5, fitted, windows
from figures.common import FULL
from tests.test_figures import TINY

SMALL = {"sensitivity": 15.0, "t0_s": 0.3, "t0_sd_s": 0.05, "lapse": 0.01}
OF = {
    fitted.TEST: {"bound": 0.6},
    fitted.FALLING: {"bound": 1.2, "fall_per_s": 2.0},
    fitted.CIRCUIT: {"threshold_nats": 0.3},
    fitted.DOPAMINE: {"threshold_nats": 0.2, "dopamine_rise": 0.5, "rise_ms": 700.0},
    fitted.ONSET: {"threshold_nats": 0.5, "onset_nats": 0.3, "decay_ms": 400.0},
}
WHO = {fitted.MONKEYS: ["b", "n"], fitted.PEOPLE: ["ah", "eh"]}


def stored(table, path):
    """Write a table as a score does, and return where."""
    circuits = {"2": identity(load_circuit(DEFAULT, 2))}
    return write_table(table, path, seed=1, trials=10, circuits=circuits)


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    """Return the paths of parameters, cells and predicted of two monkeys and two people."""
    folder = tmp_path_factory.mktemp("fits")
    parameters, cells, better = [], [], []
    for data, people in WHO.items():
        for who in people:
            design = design_of(read_trials(data, strength="coherence", participant=who))
            likelihood = likelihood_of(GapModel(), design)
            masses = cells_of(design, likelihood.density(likelihood.freedom.start))
            for k, (model, values) in enumerate(OF.items()):
                same = {"data": data, "participant": who, "model": model}
                parameters += [
                    same | {"parameter": name, "value": value}
                    for name, value in (SMALL | values).items()
                ]
                cells.append(masses.assign(**same))
                better.append(same | {"better_nats": 10.0 * k, "error_nats": 2.0})
    made = {"parameters": pd.DataFrame(parameters), "predicted": pd.DataFrame(better)}
    made["cells"] = pd.concat(cells)
    return {name: stored(table, folder / f"{name}.csv") for name, table in made.items()}


@pytest.fixture(scope="module")
def spreads(tmp_path_factory):
    """Return the path of the standard errors of monkeys' times."""
    path = tmp_path_factory.mktemp("spreads") / "spreads.parquet"
    figF1.spread(TINY, output=path)
    return path


def drawn(figure):
    """Return a figure that was drawn whole."""
    figure.draw_without_rendering()
    plt.close(figure)
    return figure


def heights(ax):
    """Return what the lines of a panel show, a list of arrays."""
    return [np.asarray(line.get_ydata(), float) for line in ax.lines]


def shows(ax, values):
    """Whether a line or the markers of a panel are at given values."""
    return any(len(y) == len(values) and np.allclose(y, values) for y in heights(ax))


def test_resampled_quantiles_scatter_as_those_of_so_many_trials(spreads):
    """The median of n Gaussian times has an error of 1.25 sd / sqrt(n)."""
    table = read_table(spreads)
    assert sorted(table["participant"].unique()) == WHO[fitted.MONKEYS]
    some = read_trials(fitted.MONKEYS, strength="coherence", participant="b")
    design = design_of(some)
    rt = design.observed.rt_s[design.observed.cell == 0]
    error = table[(table["participant"] == "b") & (table["strength"] == 0)]["q50_s"].item()
    assert error == pytest.approx(1.25 * rt.std() / np.sqrt(len(rt)), rel=0.4)
    assert (table[[*figF1.QUANTILES, "sd_s"]] > 0).all(axis=None)


def test_figure_f1_shows_data_and_both_models(tables, spreads, tmp_path):
    figure = drawn(figF1.draw(FULL, tables["cells"], spreads, output=tmp_path))
    cells = read_table(tables["cells"])
    for column, who in enumerate(WHO[fitted.MONKEYS]):
        one = cells[(cells["participant"] == who) & (cells["model"] == fitted.CIRCUIT)]
        for row, name in enumerate(("accuracy", "mean_s", "q90_s")):
            ax = figure.axes[3 * row + column]
            assert shows(ax, one[name])
            assert shows(ax, one[f"model_{name}"])
    people = cells[(cells["data"] == fitted.PEOPLE) & (cells["model"] == fitted.TEST)]
    for _, one in people.groupby("participant"):
        assert shows(figure.axes[5], one["mean_s"])


@pytest.fixture(scope="module")
def criterion(tables, tmp_path_factory):
    """Return the path of what figure F2 computes."""
    path = tmp_path_factory.mktemp("F2") / "figF2.parquet"
    figF2.compute(TINY, tables["parameters"], output=path)
    return path


def test_figure_f2_has_the_gap_as_it_was_fitted(criterion):
    table = read_table(criterion)
    gaps = table[(table["kind"] == "criterion") & (table["participant"] == "b")]
    constant = gaps[gaps["model"] == fitted.TEST]
    assert np.ptp(constant["value"]) == 0
    falling = gaps[gaps["model"] == fitted.FALLING]
    since = falling["time_s"] - SMALL["t0_s"]
    values = OF[fitted.FALLING]
    assert np.allclose(falling["value"], values["bound"] * np.exp(-values["fall_per_s"] * since))


def test_cells_driven_at_onset_raise_snr_early_and_decay(criterion):
    table = read_table(criterion)
    rates = table[(table["kind"] == "rate") & (table["participant"] == "b")]
    early = (rates["time_s"] > 0.05) & (rates["time_s"] <= 0.15)
    by = rates[early].groupby(["model", "nucleus"])["value"].mean()
    assert by[fitted.ONSET, "SNr"] > by[fitted.CIRCUIT, "SNr"] + 5
    driven = rates[(rates["model"] == fitted.ONSET) & (rates["nucleus"] == "STN_onset")]
    late = driven[driven["time_s"] > 1.5]["value"].mean()
    assert by[fitted.ONSET, "STN_onset"] > 2
    assert abs(late) < by[fitted.ONSET, "STN_onset"] / 3


def test_the_evidence_at_decisions_falls_with_cells_driven_at_onset():
    """And stays where it is with a threshold alone."""
    more = figF2.criterion(fitted.ONSET, SMALL | OF[fitted.ONSET], FULL)
    less = figF2.criterion(fitted.CIRCUIT, SMALL | OF[fitted.CIRCUIT], FULL)
    assert more["value"].iloc[0] > 1.5 * more["value"].iloc[-1]
    weights = less["trials"] / less["trials"].sum()
    mean = (weights * less["value"]).sum()
    assert (abs(less["value"] - mean) < 0.2 * mean).all()


def test_figure_f2_shows_every_model_and_person(tables, spreads, criterion, tmp_path):
    inputs = (tables["cells"], tables["predicted"], spreads, criterion)
    figure = drawn(figF2.draw(FULL, *inputs, output=tmp_path))
    left_out = figure.axes[4]
    names = [text.get_text() for text in left_out.get_yticklabels()]
    assert names == ["monkey b", "monkey n", "ah", "eh"]
    at = {float(line.get_xdata()[0]) for line in left_out.lines if len(line.get_xdata()) == 1}
    assert at == {10.0, 20.0, 30.0, 40.0}
    labels = {text.get_text() for text in figure.legends[0].get_texts()}
    assert labels == {*figF2.SHORT.values(), "data"}


CHANGES = {"1": (-0.2, -0.1), "2": (-0.1, -0.1), "3": (0.0, -0.1)}
"""Of each person's mean time with and without conflict, s."""


def stimulated():
    """Return small tables of stimulation: cells, and sums."""
    rows = []
    for move in figF3.MOVES:
        for who, (high, low) in CHANGES.items():
            for conflict, change in (("high", high), ("low", low)):
                for stimulation in ("off", "on"):
                    on = change if stimulation == "on" else 0.0
                    rows.append(
                        {
                            "participant": who, "moved": move, "conflict": conflict,
                            "stimulation": stimulation, "mean_s": 1.5 + on, "accuracy": 0.7,
                            "model_mean_s": 1.5, "model_accuracy": 0.6, "better_nats": 1.0,
                        }
                    )  # fmt: skip
    sums = {"moved": list(figF3.MOVES), "better_nats": 3.0, "error_nats": 1.0, "better_people": 2}
    return pd.DataFrame(rows), pd.DataFrame(sums)


def test_effects_of_stimulation_are_paired_within_people():
    """Means and Student's intervals of three people, by hand."""
    cells, _ = stimulated()
    effects = figF3.effects(cells[cells["moved"] == "nothing"], "mean_s")
    assert effects.loc["high", "mean"] == pytest.approx(-0.1)
    assert effects.loc["high", "off"] == pytest.approx(4.303 * 0.1 / np.sqrt(3), rel=1e-3)
    assert effects.loc["low", "mean"] == pytest.approx(-0.1)
    assert effects.loc["low", "off"] == pytest.approx(0.0, abs=1e-12)
    assert effects.loc["interaction", "mean"] == pytest.approx(0.0, abs=1e-12)


def test_figure_f3_shows_people_and_every_move(tmp_path):
    cells, sums = stimulated()
    paths = stored(cells, tmp_path / "cells.csv"), stored(sums, tmp_path / "sums.csv")
    figure = drawn(figF3.draw(FULL, *paths, output=tmp_path))
    assert shows(figure.axes[0], [-0.1, -0.1, 0.0])
    texts = [text.get_text() for text in figure.axes[1].texts]
    assert texts == ["2 of 3 people"] * 4
    assert len(figure.legends[0].get_texts()) == 1 + len(figF3.MOVES)


def test_figure_f4_shows_truth_ranks_and_coverage(tmp_path):
    """Ranks that are exactly even lie within the band."""
    rows, kept = [], []
    for by, name in figF4.CRITERION.items():
        for parameter in ("sensitivity", name, "t0_s", "t0_sd_s", "lapse"):
            truth = np.linspace(1, 2, 20)
            made = {"set": np.arange(20), "truth": truth, "mean": truth + 0.1, "low": truth - 0.1}
            made |= {"high": truth + 0.3, "rank": np.arange(2, 100, 5), "parameter": parameter}
            rows.append(pd.DataFrame(made).assign(by=by))
            coverage = {"sets": 20, "coverage": 0.9, "correlation": 1.0}
            kept.append({"by": by, "parameter": parameter, **coverage})
    paths = [
        stored(table, tmp_path / f"{name}.csv")
        for name, table in (("recovery", pd.concat(rows)), ("calibration", pd.DataFrame(kept)))
    ]
    figure = drawn(figF4.draw(FULL, *paths, output=tmp_path))
    assert len(figure.axes) == 9
    assert shows(figure.axes[0], np.linspace(1.1, 2.1, 20))
    for ax in figure.axes[6:8]:
        (band,) = ax.patches
        reach = band.get_height() / 2
        off = max(abs(y).max() for y in heights(ax) if len(y))
        assert 0 < off < reach


def test_the_interval_of_a_share_holds_all_that_counts_allow():
    """No success of n: up to 1 - 0.025 ** (1 / n) (Clopper & Pearson 1934)."""
    assert figF4.interval(0.0, 10) == pytest.approx([0, 1 - 0.025 ** (1 / 10)])
    assert figF4.interval(1.0, 10) == pytest.approx([0.025 ** (1 / 10), 1])


def test_windows_read_a_channel_by_its_own_choice():
    """Channel 0 at 10 Hz and channel 1 at 30 Hz from 100 to 500 ms; before and after at rest."""
    time = np.arange(5.0, 1000, 5)
    inside = (time >= 100) & (time < 500)
    rates = np.where(inside[None, :, None], [10.0, 30.0], 5.0) * np.ones((2, 1, 1))
    choice, at = np.array([0, -1]), np.array([800.0, np.nan])
    means = windows.averaged({"STN": rates}, time, choice, at, {"STN": 5.0})
    hz = means.set_index(["window", "own"])["hz"]
    for window in windows.WINDOWS[:2]:
        assert hz[window, True] == pytest.approx(5)
        assert hz[window, False] == pytest.approx(25)
    assert (hz.loc[windows.WINDOWS[2]] == 0).all()
    assert set(means["trials"]) == {1}


def test_windows_leave_out_trials_that_respond_within_them():
    time = np.arange(5.0, 1000, 5)
    rates = {"STN": np.ones((2, len(time), 2))}
    means = windows.averaged(rates, time, np.array([0, 0]), np.array([400.0, 600.0]), {"STN": 1.0})
    counts = means[means["own"]].set_index("window")["trials"]
    assert counts.tolist() == [2, 1, 2]


@pytest.mark.parametrize("name", windows.patterns((0.1, 1.0)))
def test_a_pattern_is_most_like_itself(name):
    strengths = (0.032, 0.064, 0.128, 0.256, 0.512)
    pattern = windows.patterns(strengths)[name]
    rows = [
        {"window": window, "own": preferred, "strength": s, "hz": 3 + 2 * pattern[w, o, k]}
        for w, window in enumerate(windows.WINDOWS)
        for o, preferred in enumerate(windows.PREFERRED)
        for k, s in enumerate(strengths)
    ]
    likeness = windows.likeness(pd.DataFrame(rows), strengths)
    assert likeness[name] == pytest.approx(1)
    assert max(likeness, key=likeness.get) == name


def test_a_fitted_circuit_decides_for_the_evidence():
    values = SMALL | OF[fitted.CIRCUIT]
    did = fitted.follow(load_circuit(DEFAULT, 2), values, 0.512, 20, 1.0, 3)
    assert (did.choice == 0).all()
    assert (did.evidence > 0).all()
    again = fitted.follow(load_circuit(DEFAULT, 2), values, 0.512, 20, 1.0, 3)
    assert np.array_equal(did.at_ms, again.at_ms)


@pytest.fixture(scope="module")
def seen(tables, tmp_path_factory):
    """Return the path of what figure F5 computes."""
    path = tmp_path_factory.mktemp("F5") / "figF5.parquet"
    figF5.compute(TINY, tables["parameters"], output=path)
    return path


def test_rates_before_the_evidence_are_those_at_rest():
    """With 300 ms from motion to evidence nothing has happened in the first window."""
    values = SMALL | OF[fitted.ONSET]
    table = fitted.fitted_table(fitted.ONSET, values)
    did = fitted.follow(table, values, 0.512, 8, 1.0, 3)
    rates = figF5.seen_from_motion(did, 300.0, 300.0, resting_hz(table))
    early = rates[rates["window"] == windows.WINDOWS[0]]
    assert early["hz"].to_numpy() == pytest.approx(0, abs=1e-4)
    driven = rates[(rates["window"] == windows.WINDOWS[1]) & (rates["nucleus"] == "STN_onset")]
    assert (driven["hz"] > 2).all()


def test_figure_f5_shows_every_nucleus_of_both_monkeys(seen, tables, tmp_path):
    figure = drawn(figF5.draw(FULL, seen, tables["parameters"], output=tmp_path))
    assert len(figure.axes) == 4 * len(figF5.NUCLEI)
    table = read_table(seen)
    assert set(table["split"]) == set(figF5.SPLITS)
    assert set(table["participant"]) == set(WHO[fitted.MONKEYS])
    one = table[(table["nucleus"] == "GPe") & (table["window"] == windows.WINDOWS[2])]
    one = one[(one["participant"] == "n") & one["own"] & (one["split"] == figF5.SPLITS[0])]
    assert shows(figure.axes[4 * figF5.NUCLEI.index("GPe") + 2], one["hz"])
