"""Every row of a sweep is the single run with exactly the edits and settings that it names."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bgmodel.integrators.basal_ganglia import BasalGanglia, gain_of
from bgmodel.integrators.deciding import behaviour_of
from bgmodel.integrators.sprt import criterion_from_posterior
from bgmodel.stimuli import Stimuli
from bgmodel.sweeps import shards
from bgmodel.sweeps.plan import Plan
from circuits.anatomy import load_circuit
from circuits.declaration.table_files import digest
from circuits.edit_lists import Edits
from circuits.engines import Population

FRACTIONS = st.sampled_from([0, 0.1, 0.25, 0.5])
FACTORS = st.sampled_from([0, 0.5, 0.9, 1, 1.2])
NATS = st.sampled_from([-0.2, 0.0, 0.3])
WEIGHTS = st.sampled_from([-0.1, -0.05])
LESIONS, SCALES, CHANGES, ADDED, REBOUNDS = "without", "scale", "change", "add", "rebound"
CUTS = "cut"
EDITS = {
    "STN": (LESIONS, FRACTIONS),
    "STN[0]": (LESIONS, FRACTIONS),
    "STN[1]": (LESIONS, FRACTIONS),
    "GPe": (LESIONS, FRACTIONS),
    "D2": (LESIONS, FRACTIONS),
    "STN->SNr": (SCALES, FACTORS),
    "ctx->D1": (SCALES, FACTORS),
    "ctx->D1[0]": (SCALES, FACTORS),
    "ctx->D1[1]": (SCALES, FACTORS),
    "cut GPe->STN": (CUTS, FRACTIONS),
    "cut GPe->STN[1]": (CUTS, FRACTIONS),
    "cut STN->SNr": (CUTS, FRACTIONS),
    "STN.bias_nats": (CHANGES, NATS),
    "STN.intact": (CHANGES, FRACTIONS.map(lambda lost: 1 - lost)),
    "STN->SNr.weight": (CHANGES, FACTORS),
    "STN->SNr.delay_ms": (CHANGES, st.sampled_from([1, 5.5])),
    "GPe.cell.cv": (CHANGES, st.sampled_from([0.1, 0.3])),
    "D2->SNr weight": (ADDED, WEIGHTS),
    "D1->GPe delay_ms=4 weight": (ADDED, WEIGHTS),
    "rebound SNr": (REBOUNDS, NATS),
}
"""Left sides of edits of rows, with what each may be."""
OVERLAPS = [
    {"STN", "STN[0]"},
    {"STN", "STN[1]"},
    {"STN", "STN.intact"},
    {"STN[0]", "STN.intact"},
    {"STN[1]", "STN.intact"},
    {"cut GPe->STN", "cut GPe->STN[1]"},
    {"ctx->D1", "ctx->D1[0]"},
    {"ctx->D1", "ctx->D1[1]"},
    {"STN->SNr", "STN->SNr.weight"},
]
"""Edits of one number in two ways."""
OF_ALL = {
    "neurons": st.sampled_from([20, 50]),
    "spread": st.sampled_from([0.0, 0.1]),
    "dopamine": st.sampled_from([0.9, 1.0, 1.1]),
    "recovered": st.booleans(),
    "replaced": st.booleans(),
}
RUN = {
    "circuit": st.sampled_from(["spiking_msprt", "macaque"]),
    "engine": st.sampled_from(["population", "ensemble"]),
    "gain": st.sampled_from([0.4, 0.7]),
    "posterior": st.sampled_from([0.7, 0.8, 0.9]),
    "seed": st.integers(0, 9),
    "task.d_prime": st.sampled_from([0.4, 0.8]),
    "task.channels": st.sampled_from([2, 3]),
    "task.trials": st.sampled_from([20, 50]),
}
VALUES = {key: values for key, (_, values) in EDITS.items()} | OF_ALL | RUN


@st.composite
def sweeps(draw):
    """Return what every point has, and a grid; keys of both may be the same."""
    keys = st.lists(st.sampled_from(sorted(VALUES)), unique=True, max_size=5)
    base = {key: draw(VALUES[key]) for key in draw(keys)}
    chosen = draw(keys.filter(len).map(lambda some: some[:2]))
    grid = {
        key: tuple(draw(st.lists(VALUES[key], unique=True, min_size=1, max_size=2)))
        for key in chosen
    }
    return base, grid, draw(st.sampled_from(["{}", " {}", "{} "])), draw(st.booleans())


def edited(values):
    """Return the edits of these values by key, as an experiment's file has them."""
    of_rows = {kind: [] for kind in (LESIONS, CUTS, SCALES, CHANGES, ADDED, REBOUNDS)}
    for key, value in values.items():
        if key in EDITS:
            of_rows[EDITS[key][0]].append(
                f"{key.removeprefix('rebound ').removeprefix('cut ')}={value}"
            )
    named = {key: value for key, value in values.items() if key in OF_ALL}
    return Edits(**{kind: tuple(texts) for kind, texts in of_rows.items()}, **named)


def of_plan(base, grid, spelling="{}", wide=False):
    """Return the sweep of a grid whose keys are spelled in some way."""
    run = {key: value for key, value in base.items() if key in RUN and "." not in key}
    of_task = {key.removeprefix("task."): v for key, v in base.items() if key.startswith("task.")}
    keys = {key: spelling.format(key.replace("->", " -> ") if wide else key) for key in grid}
    return Plan(
        edits=edited({key: value for key, value in base.items() if key not in RUN}),
        task=Stimuli(**{"trials": 20, **of_task}),
        grid={keys[key]: values for key, values in grid.items()},
        **run,
    )


def single(values):
    """Return circuit, gain, posterior, seed and task of a run with these values alone."""
    task = {key.removeprefix("task."): v for key, v in values.items() if key.startswith("task.")}
    task = Stimuli(**{"trials": 20, **task})
    own = {key: value for key, value in values.items() if key not in RUN}
    table = edited(own).apply(load_circuit(values.get("circuit", "macaque"), task.channels))
    gain, posterior = gain_of(table, values.get("gain")), values.get("posterior", 0.82)
    return table, gain, posterior, values.get("seed", 0), task


def overlap(base, grid):
    """Whether a key of the grid and another edit set one number."""
    kept = base.keys() | grid.keys()
    pairs = [{one, other} for one, other in combinations(kept, 2) if grid.keys() & {one, other}]
    return any(pair in OVERLAPS for pair in pairs)


@settings(max_examples=200)
@given(sweeps())
def test_every_row_is_a_single_run_with_exactly_what_it_names(drawn):
    base, grid, *_ = drawn
    plan = of_plan(*drawn)
    points = [dict(zip(grid, point.values(), strict=True)) for point in plan.each]
    try:
        wanted = [single(base | point) for point in points]
    except ValueError:
        wanted = None  # an edit without sense, such as a rebound of what is replaced
    if overlap(base, grid) or wanted is None:
        with pytest.raises(ValueError, match=r"the point|edit the same"):
            plan.all_points()
        return
    for found, point, (table, gain, posterior, seed, task) in zip(
        plan.all_points(), points, wanted, strict=True
    ):
        assert digest(found.edited) == digest(table)
        assert gain_of(found.edited, found.gain) == gain
        assert found.threshold_nats == criterion_from_posterior(posterior, task.channels)
        assert (found.seed, found.task) == (seed, task)
        assert found.engine == (base | point).get("engine", "population")


@pytest.mark.parametrize(
    ("base", "point"),
    [
        ({"STN": 0.1}, {"STN": 0.1}),
        ({"STN->SNr": 0.5, "GPe": 0.1}, {"STN->SNr": 0.9}),
        ({"STN.bias_nats": 0.3, "seed": 3}, {"STN.bias_nats": -0.2, "seed": 4}),
    ],
)
def test_a_row_decides_as_the_single_run_does(base, point, tmp_path):
    same = {"posterior": 0.7, "task.d_prime": 0.8, "circuit": "spiking_msprt"}
    (setting,) = of_plan(base | same, {key: (value,) for key, value in point.items()}).all_points()
    (shard,) = setting.shards()
    shards.compute(shard, tmp_path)
    found, _ = shards.read(setting, tmp_path)
    table, gain, posterior, _, _ = single(base | same | point)
    model = BasalGanglia(table, Population(rates=False), gain, setting.block_seed(0))
    threshold = float(criterion_from_posterior(posterior))
    want = behaviour_of(model, setting.block(0, 20).evidence, threshold, 500.0)
    assert np.array_equal(found.decision.choice, want.decision.choice)
    assert np.array_equal(found.decision.time_ms, want.decision.time_ms)
    assert np.array_equal(found.anticipatory, want.anticipatory)


@pytest.mark.parametrize(
    ("edits", "grid", "rows"),
    [
        # One of each kind, in another spelling than that of [edits].
        ({"without": ("STN = 0.1",)}, {"STN": (0.2,)}, {"without": ("STN=0.2",)}),
        ({"without": ("GPe[0]",)}, {" GPe[0]": (0.2,)}, {"without": ("GPe[0]=0.2",)}),
        ({"scale": ("STN->GPe=0.5",)}, {"STN  ->  GPe": (2,)}, {"scale": ("STN->GPe=2",)}),
        (
            {"change": ("STN -> GPe.delay_ms = 4",)},
            {"STN->GPe.delay_ms": (5,)},
            {"change": ("STN->GPe.delay_ms=5",)},
        ),
        (
            {"add": ("TRN like=STN", "D1->GPe weight=-0.1")},
            {"TRN like=STN bias_nats": (1,)},
            {"add": ("TRN like=STN bias_nats=1", "D1->GPe weight=-0.1")},
        ),
        ({"rebound": ("SNr=0.5",)}, {"rebound  SNr": (0.2,)}, {"rebound": ("SNr=0.2",)}),
        ({"dopamine": 0.9}, {" dopamine": (1.1,)}, {"dopamine": 1.1}),
        # What is changed of a new row, and a loss of it, are what they are called.
        (
            {"add": ("TRN like=STN bias_nats=1",)},
            {"TRN.bias_nats": (2,), "TRN": (0.5,)},
            {
                "add": ("TRN like=STN bias_nats=1",),
                "change": ("TRN.bias_nats=2",),
                "without": ("TRN=0.5",),
            },
        ),
        (
            {"add": ("striatal_FSI",)},
            {"FSI": (0.5,)},
            {"add": ("striatal_FSI",), "without": ("FSI=0.5",)},
        ),
    ],
)
def test_a_point_replaces_the_same_edit_in_any_spelling(edits, grid, rows):
    (found,) = Plan(edits=Edits(**edits), grid=grid).all_points()
    assert digest(found.edited) == digest(Edits(**rows).apply(load_circuit("macaque")))


@pytest.mark.parametrize(
    ("edits", "grid"),
    [
        ({"without": ("STN=0.1",)}, {"STN[0]": (0.1,)}),
        ({"without": ("STN[1]=0.1",)}, {"STN": (0.1,)}),
        ({"scale": ("ctx->D1=0.9",)}, {"ctx->D1[0]": (0.9,)}),
        ({"scale": ("STN->GPe=0.5",)}, {"STN->GPe.weight": (0.5,)}),
        ({"change": ("STN->GPe.weight=0.5",)}, {"STN->GPe": (0.5,)}),
        ({"scale": ("STN->GPe[0]=0.5",)}, {"STN->GPe.factors": ("1,1",)}),
        ({"change": ("STN.intact_by_channel=0.5,1",)}, {"STN": (0.1,)}),
        ({"change": ("TRN.bias_nats=1",)}, {"TRN like=STN bias_nats": (2,)}),
        ({"scale": ("D1->GPe=0.5",)}, {"D1->GPe weight": (-0.1,)}),
        ({"add": ("STN amount=0.1",)}, {"STN to_ms=300 amount": (0.1,)}),
        ({}, {"STN": (0.1,), "STN [0]": (0.1,)}),
        ({}, {"STN->GPe": (0.5,), "STN -> GPe": (0.5,)}),
        ({}, {"D1->GPe weight=-0.1 delay_ms": (4,), "D1->GPe delay_ms=4 weight": (-0.1,)}),
    ],
)
def test_two_edits_of_one_number_are_refused_with_both(edits, grid):
    with pytest.raises(ValueError, match=r"' and '.* edit the same number"):
        Plan(edits=Edits(**edits), grid=grid).all_points()


@pytest.mark.parametrize(
    "wrong",
    [
        {"grid": {"STN": (0.1,), " STN": (0.2,)}},
        {"grid": {"posterior": (0.7,), "posterior ": (0.8,)}},
        {"grid": {"STN": (0.1, 0.2, 0.1)}},
        {"points": ({"STN": 0.1}, {"STN": 0.1})},
    ],
)
def test_a_key_a_value_or_a_point_that_is_there_twice_is_refused(wrong):
    with pytest.raises(ValueError, match="may be given once"):
        Plan(**wrong)


def test_two_courses_of_one_nucleus_may_both_be_named():
    early, late = "dopamine to_ms=300 amount", "dopamine from_ms=400 amount"
    (found,) = Plan(grid={early: (0.1,), late: (0.2,)}).all_points()
    assert found.edited == load_circuit("macaque").add(f"{early}=0.1", f"{late}=0.2")


@pytest.mark.parametrize("kind", [LESIONS, SCALES])
def test_one_edit_given_twice_is_refused_wherever_edits_are(kind):
    """Two losses of a tenth would be one of 19 %."""
    place = {LESIONS: "STN", SCALES: "STN->SNr"}[kind]
    twice = Edits(**{kind: (f"{place}=0.9", f"{place} = 0.9")})
    with pytest.raises(ValueError, match="edit the same number"):
        twice.apply(load_circuit("macaque"))
    apart = replace(twice, **{kind: (f"{place}[0]=0.9", f"{place}[1]=0.9")})
    assert apart.apply(load_circuit("macaque")) != load_circuit("macaque")
