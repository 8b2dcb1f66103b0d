"""A bias to one response: recovered, told from none, and mirrored with the sides."""

import numpy as np
import pandas as pd
import pytest

import bgmodel as bg
from bgmodel.fitting.algorithms import GAPS, GapModel
from bgmodel.fitting.design import FAVOURS, design_of
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.optimum import optimum
from bgmodel.fitting.responses import BIN_S, Grid, responded
from bgmodel.fitting.settings import FitSettings
from bgmodel.trials.reader import read_trials
from circuits.errors import DataWarning
from tests.helpers import refused, unwarned

pytestmark = pytest.mark.usefixtures("brief_search")
TRUE = {"sensitivity": 10.0, "bound": 0.7, "start": 0.25}
RESPONSES = {"t0_s": 0.3, "t0_sd_s": 0.05, "lapse": 0.01}
STRENGTHS = np.array([-0.3, -0.1, 0.0, 0.1, 0.3])


def drawn(seed, trials=400, model=None, **values):
    """Return a table of choices from a model's own density, at signed strengths."""
    model, grid = model or GapModel(), Grid(400)
    every = {k: np.full(len(STRENGTHS), v) for k, v in {**TRUE, **RESPONSES, **values}.items()}
    masses = model.decided(every, STRENGTHS, grid)
    density = responded(masses, grid, **{k: every[k] for k in RESPONSES})
    rng, rows = np.random.default_rng(seed), []
    for strength, one in zip(STRENGTHS, density, strict=True):
        below = one.ravel().cumsum() * BIN_S
        place = np.searchsorted(below, below[-1] * rng.random(trials), side="right")
        response, bins = np.divmod(place, grid.bins)
        rt = (bins + rng.random(trials)) * BIN_S
        rows.append(pd.DataFrame({"rt": rt, "response": response, "coherence": strength}))
    return pd.concat(rows, ignore_index=True).assign(participant_id="a")


def fitted(table, free="+start", model="constant_gap", **options):
    names = ((free,) if free else ()) if isinstance(free, str) else free
    asked = FitSettings(strength="coherence", free=names, **options)
    choices = asked.read(table)
    best = optimum(asked.likelihood(asked.design(choices), asked.model(model)))
    return best, {k: float(np.atleast_1d(v)[0]) for k, v in best.values.items()}


@pytest.mark.parametrize(
    ("model", "more"),
    [
        ("constant_gap", {}),
        pytest.param("falling_gap", {"fall_per_s": 1.0}, marks=pytest.mark.validate),
    ],
)
def test_a_start_is_recovered(model, more):
    table = drawn(91_001, model=GapModel(GAPS[model]), **more)
    with unwarned():
        best, values = fitted(table, model=model)
    without, _ = fitted(table, "", model=model)
    assert values["start"] * best.likelihood.design.side[0] == pytest.approx(0.25, abs=0.05)
    assert best.log_likelihood > without.log_likelihood + 50


def test_a_start_between_falling_bounds_is_likelier_than_none_or_its_mirror():
    """What a search for it, in `make validate`, climbs."""
    table = drawn(91_001, model=GapModel(GAPS["falling_gap"]), fall_per_s=1.0)
    asked = FitSettings(strength="coherence", free=("+start",))
    likelihood = asked.likelihood(asked.design(asked.read(table)), asked.model("falling_gap"))
    truth = {**TRUE, **RESPONSES, "fall_per_s": 1.0}
    vector = np.array([truth[name] for name in likelihood.freedom.names])
    at, side = likelihood.freedom.names.index("start"), likelihood.design.side[0]
    known = []
    for start in (0.25, 0.0, -0.25):
        vector[at] = side * start
        known.append(likelihood(vector))
    assert known[0] > known[1] + 50
    assert known[1] > known[2] + 50


def test_splitting_sides_alone_changes_no_likelihood():
    choices = read_trials(drawn(91_004, start=0.0), strength="coherence")
    plain, sides = (likelihood_of(GapModel(), design_of(choices, sides=s)) for s in (False, True))
    assert sides.design.cells == 5
    assert plain.design.cells == 3
    assert sides(plain.freedom.start) == pytest.approx(plain(plain.freedom.start), rel=1e-12)
    assert set(sides.design.conditions[FAVOURS]) == {"0", "1"}


def test_a_bias_that_is_not_fitted_is_warned_of_with_the_way_to_fit_it():
    choices = read_trials(drawn(91_005), strength="coherence")
    with pytest.warns(DataWarning, match=r"\+start"):
        FitSettings(strength="coherence").design(choices)
    with unwarned():
        FitSettings(strength="coherence", free=("+start",)).design(choices)


def test_python_fits_it_by_the_same_name_and_a_circuit_says_that_it_has_none():
    table = drawn(91_008, trials=100)
    fit = bg.fit(table, "constant_gap", strength="coherence", free="+start")
    values = fit.parameters().set_index("parameter")["value"]
    assert values["start"] == pytest.approx(0.25, abs=0.12)
    assert {"sensitivity", "bound", "t0_s", "lapse"} <= set(values.index)
    with refused("free must name a parameter"):
        bg.fit(table, "macaque", strength="coherence", free="+start")
    with refused("free must have a plus before all names"):
        bg.fit(table, "constant_gap", strength="coherence", free=["+start", "bound"])
    both = FitSettings(free=("+start",))
    models = {name: both.model(name) for name in ("constant_gap", "macaque")}
    (text,) = both.check_parameters(models)
    assert text == "macaque has no start and is fitted without"
