"""Parameters that are linear in conditions: designs, ranges, fits, and what is refused."""

from contextlib import suppress

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as some

import bgmodel as bg
from bgmodel.fit_trials import question
from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.formulas import Formula
from bgmodel.fitting.parameters import Parameter, freedom
from bgmodel.fitting.posterior import directions
from bgmodel.fitting.settings import settings_of
from circuits.errors import DataWarning, InputError
from tests.drawn import drawn, rows_of
from tests.helpers import refused, refusing, unwarned

pytest.importorskip("formulaic", reason="formulas need formulaic: pip install '.[fit]'")

SEED = 24_331
FIXED = {"t0_sd_s": 0.05, "lapse": 0.01}
BOUNDS = {("fast", 1): 0.5, ("fast", 2): 0.6, ("safe", 1): 0.9, ("safe", 2): 1.0}


def table(trials=300):
    """Return trials whose bound is 0.4, plus 0.4 if safe, plus 0.1 in each block."""
    parts = []
    for number, ((instruction, block), bound) in enumerate(BOUNDS.items()):
        some = drawn(GapModel(), [0.1, 0.4], trials, SEED + number, sensitivity=8.0, bound=bound)
        parts.append(rows_of(some, instruction=instruction, block=block))
    return pd.concat(parts, ignore_index=True).assign(participant_id="a", same="yes")


def likelihood(data=None, fix=FIXED, **options):
    asked = settings_of(strength="strength", fix=fix, **options)
    asked.check_parameters({"model": GapModel()})
    choices = asked.read(table(60) if data is None else data)
    return asked.likelihood(asked.design(choices), GapModel())


def test_a_value_for_each_level_is_what_vary_gives_byte_for_byte():
    formula = likelihood(formula="bound ~ 0 + instruction")
    vary = likelihood(vary={"bound": "instruction"})
    assert formula.freedom.names == vary.freedom.names
    assert "bound[instruction=fast]" in formula.freedom.names
    assert_same(formula, vary)


def assert_same(one, other):
    """Assert that two likelihoods have the same ranges, starts and values, byte for byte."""
    for name in ("low", "high", "start"):
        assert getattr(one.freedom, name).tolist() == getattr(other.freedom, name).tolist()
    vector = other.freedom.start + np.arange(len(other.freedom.start)) * 0.01
    assert one.each(vector).tobytes() == other.each(vector).tobytes()


@pytest.mark.parametrize("terms", ["1", "1 + 1"])
def test_a_constant_is_a_free_parameter_byte_for_byte(terms):
    constant, free = likelihood(formula=f"t0_s ~ {terms}"), likelihood(free="+t0_s")
    assert [name.partition("[")[0] for name in constant.freedom.names] == free.freedom.names
    assert_same(constant, free)


@pytest.mark.parametrize("name", ["cue.type", "cue type", "cue-2", "2nd"])
@pytest.mark.parametrize("terms", ["0 + `{}`", "0 + C(`{}`)"])
def test_columns_of_any_name_give_what_plain_names_give(name, terms):
    renamed = table(60).rename(columns={"instruction": name})
    other = likelihood(renamed, formula=f"bound ~ {terms.format(name)}")
    assert_same(other, likelihood(formula="bound ~ 0 + instruction"))


def test_a_name_with_dots_needs_no_backticks_outside_functions():
    assert Formula("bound", "cue.type * log(`n.x`) + np.log(n)").columns == ["cue.type", "n", "n.x"]


PIECES = (
    "1 0 2 0.5 cue cue.type `cue.type` ` n n.x C( I( log( np.log( bs( center( ( ) + * : - ** | { } "
    "[ ] ' , ~ . @ == ^ lambda if"
)
CONDITIONS = {"cue": ["x", "y"], "cue.type": ["a", "b"], "n": ["1", "2"], "n.x": ["3", "5"]}


@given(pieces=some.lists(some.sampled_from(PIECES.split()), min_size=1, max_size=7))
def test_any_text_is_a_design_or_refused_in_one_sentence(pieces):
    formula = Formula("bound", " ".join(pieces))
    with suppress(InputError):
        design = formula.matrix(CONDITIONS, np.array([0, 1, 1]), 2)
        assert {column.shape for column in design.values()} == {(2,)}


def test_a_product_of_conditions_spans_the_same_values_as_their_combinations():
    product = likelihood(formula="threshold ~ instruction * C(block)").freedom
    combined = likelihood(formula="bound ~ 0 + instruction:C(block)").freedom
    wanted = combined.values(np.array([5.0, 0.5, 0.9, 0.6, 1.0, 0.3]))["bound"]
    design = np.array([one.weights for one in product.moved[1:5]])
    coefficients, *_ = np.linalg.lstsq(design.T, wanted, rcond=None)
    bounds = product.values(np.array([5.0, *coefficients, 0.3]))["bound"]
    assert bounds == pytest.approx(wanted)
    assert not combined.moved[1].effect
    assert product.moved[1].effect


def test_ranges_are_those_in_which_the_parameter_can_stay_within_its_own():
    a = Parameter("a", 1.0, 3.0, 2.0)
    columns = {"a": {"Intercept": np.ones(3), "x": np.array([0.0, 2.0, 4.0])}}
    space = freedom([a], {}, 3, designs=columns)
    assert space.low == pytest.approx([1.0, -0.5])
    assert space.high == pytest.approx([3.0, 0.5])
    assert space.start == pytest.approx([2.0, 0.0])
    assert space.values(np.array([1.5, 0.25]))["a"] == pytest.approx([1.5, 2.0, 2.5])
    assert space.inside(np.array([1.5, 0.25]))
    assert not space.inside(np.array([2.5, 0.25]))
    # In the third cell the parameter is at its upper bound by both, in the first by the intercept.
    assert space.at_bound(np.array([1.5, 0.375])).tolist() == [True, True]
    assert space.at_bound(np.array([1.0, 0.375])).tolist() == [True, False]
    assert space.at_bound(np.array([1.5, 0.25])).tolist() == [False, False]
    assert space.values(np.array([2.5, 0.25]))["a"].max() == 3.0


def test_functions_are_over_trials():
    data = table(60)
    data = data[(data["block"] == 1) | (data.index % 3 == 0)]
    space = likelihood(data, formula="bound ~ center(block)").freedom
    weights = next(one.weights for one in space.moved if "center" in one.name)
    assert np.unique(weights.round(9)) == pytest.approx(np.array([1, 2]) - data["block"].mean())


MANY = [f"m{k}" for k in np.arange(1600) // 20]
test_formulas_that_cannot_be_fitted_are_refused = refusing(
    ("bound ~ day", "day"),
    *((f"bound ~ {terms}", "formula") for terms in (
        "instruction + block + instruction:block + block:instruction + I(2 * block)",
        "same", "many", "instruction **", "", "block ~ same", "log(block - 1)", "nothing(block)",
    )),
    *((formula, "formula") for formula in (
        "bound", "speed ~ block", ["bound ~ block", "bound ~ instruction"], 3,
    )),
    of=lambda formula: likelihood(table(200).assign(many=MANY), formula=formula),
)  # fmt: skip


def test_a_parameter_has_one_rule():
    with refused("vary"):
        likelihood(formula="bound ~ block", vary={"bound": "instruction"})
    with refused("fix"):
        likelihood(formula="bound ~ block", fix={"bound": 0.7})


def test_a_covariate_of_any_number_of_values_has_the_slope_that_made_the_data():
    """Bounds rise by 0.15 per unit of a Gaussian covariate, which takes 60 values."""
    rng, asked = np.random.default_rng(8), {"strength": "strength", "fix": {"lapse": 0.01}}
    parts = []
    for k, theta in enumerate(rng.normal(size=60)):
        some = drawn(GapModel(), [0.3], 50, k, sensitivity=6.0, bound=max(0.8 + 0.15 * theta, 0.3))
        parts.append(rows_of(some, theta=theta))
    table = pd.concat(parts, ignore_index=True)
    shuffled = table.assign(theta=rng.permutation(table["theta"]))
    for data, slope in ((table, 0.15), (shuffled, 0.0)):
        made = bg.fit(data, "constant_gap", formula="bound ~ theta", **asked)
        row = made.parameters().set_index("parameter").loc["bound[theta]"]
        assert abs(row["value"] - slope) < 3 * row["standard_error"]
        assert row["standard_error"] < 0.015
        assert made.optimum.likelihood.design.cells == 10
    with refused("vary"):
        bg.fit(table, "constant_gap", vary={"bound": "theta"}, **asked)


def test_the_error_of_a_slope_does_not_depend_on_where_its_covariate_is_0():
    data = table(60)
    x = np.random.default_rng(3).normal(size=len(data)).round(3)
    errors = {}
    for away in (0.0, 20.0, 45.0):
        made = likelihood(data.assign(x=x + away), formula="bound ~ x")
        vector = made.freedom.start.copy()
        places = [made.freedom.names.index(f"bound[{name}]") for name in ("Intercept", "x")]
        vector[places] = 0.7 - 0.03 * away, 0.03
        errors[away] = directions(made, vector).standard_errors[places[1]]
    assert errors[20.0] == pytest.approx(errors[0.0], rel=1e-3)
    assert errors[45.0] == pytest.approx(errors[0.0], rel=1e-3)
    for away in (60.0, 1e5):
        with refused("formula"):
            likelihood(data.assign(x=x + away), formula="bound ~ x")
    first, second = (
        likelihood(data.assign(x=x + away), formula="bound ~ center(x)").freedom.moved[2].weights
        for away in (0, 1e5)
    )
    np.testing.assert_allclose(np.sort(first), np.sort(second), atol=1e-4)


def test_trials_with_equal_values_of_a_covariate_are_in_one_group():
    data = table(60)
    data = data.assign(x=np.random.default_rng(3).integers(0, 35, len(data)) / 8)
    values = (set(likelihood(rows, formula="bound ~ x").design.conditions["x"])
              for rows in (data, data.sample(frac=1, random_state=1)))  # fmt: skip
    first, second = values
    assert first == second
    with refused("formula"):
        likelihood(data, formula="bound ~ C(x)")


def test_people_with_other_levels_have_other_contrasts_and_that_is_said():
    data = table(60)
    fast = data["instruction"] == "fast"
    people = pd.concat([data, data[~fast].assign(participant_id="b")])
    asked = settings_of(strength="strength", formula="bound ~ instruction", people="each")
    with pytest.warns(DataWarning, match="b have no trials with instruction fast"):
        assert set(question(asked, people, ["constant_gap"]).designs) == {"a", "b"}
    both = pd.concat([data[::2], data[1::2].assign(participant_id="b")])
    with unwarned():
        question(asked, both, ["constant_gap"]).designs  # noqa: B018


def test_a_number_of_each_person_may_have_any_number_of_values():
    ages = [f"{20 + k}" for k in range(40)]
    made = Formula("bound", "age").matrix({"age": ages}, np.arange(40), 40)
    assert made["age"].tolist() == list(range(20, 60))
