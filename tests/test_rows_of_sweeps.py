"""Every row of a sweep is the single run with exactly the edits and settings that it names."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bgmodel.integrators.at_thresholds import behaviour_of
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.integrators.sprt import threshold_from_posterior
from bgmodel.sweeps import shards
from bgmodel.sweeps.plan import Plan
from bgmodel.task import Gaussian
from circuits.anatomy import load_circuit
from circuits.declaration.edits import Edits
from circuits.declaration.table_writer import digest
from circuits.engines import Populations
from tests.helpers import refused

FRACTIONS = st.sampled_from([0, 0.1, 0.25, 0.5])
FACTORS = st.sampled_from([0, 0.5, 0.9, 1, 1.2])
NATS = st.sampled_from([-0.2, 0.0, 0.3])
WEIGHTS = st.sampled_from([-0.1, -0.05])
EDITS = {
    "lesion STN": FRACTIONS,
    "lesion STN[0]": FRACTIONS,
    "lesion STN[1]": FRACTIONS,
    "lesion GPe": FRACTIONS,
    "clamp GPe": FRACTIONS,
    "lesion D2": FRACTIONS,
    "scale STN->SNr": FACTORS,
    "scale ctx->D1": FACTORS,
    "scale ctx->D1[0]": FACTORS,
    "scale ctx->D1[1]": FACTORS,
    "cut GPe->STN": FRACTIONS,
    "cut GPe->STN[1]": FRACTIONS,
    "cut STN->SNr": FRACTIONS,
    "set STN.bias_nats": NATS,
    "set STN.intact": FRACTIONS.map(lambda lost: 1 - lost),
    "set STN->SNr.weight": FACTORS,
    "set STN->SNr.delay_ms": st.sampled_from([1, 5.5]),
    "set GPe.cell.cv": st.sampled_from([0.1, 0.3]),
    "add D2->SNr weight": WEIGHTS,
    "add D1->GPe delay_ms=4 weight": WEIGHTS,
    "rebound SNr": NATS,
    "neurons": st.sampled_from([20, 50]),
    "heterogeneity": st.sampled_from([0.0, 0.1]),
    "dopamine": st.sampled_from([0.9, 1.0, 1.1]),
    "compensate": st.booleans(),
}
"""Edits without their values, with what each may be."""
OVERLAPS = [
    {"lesion STN", "lesion STN[0]"},
    {"lesion STN", "lesion STN[1]"},
    {"lesion STN", "set STN.intact"},
    {"lesion STN[0]", "set STN.intact"},
    {"lesion STN[1]", "set STN.intact"},
    {"lesion GPe", "clamp GPe"},
    {"cut GPe->STN", "cut GPe->STN[1]"},
    {"scale ctx->D1", "scale ctx->D1[0]"},
    {"scale ctx->D1", "scale ctx->D1[1]"},
    {"scale STN->SNr", "set STN->SNr.weight"},
]
"""Edits of one number in two ways."""
RUN = {
    "circuit": st.sampled_from(["spiking_msprt", "macaque"]),
    "engine": st.sampled_from(["population", "spikes"]),
    "gain": st.sampled_from([0.4, 0.7]),
    "posterior": st.sampled_from([0.7, 0.8, 0.9]),
    "seed": st.integers(0, 9),
    "task.d_prime": st.sampled_from([0.4, 0.8]),
    "task.channels": st.sampled_from([2, 3]),
    "task.trials": st.sampled_from([20, 50]),
}
VALUES = EDITS | RUN


@st.composite
def sweeps(draw):
    """Return what every point has, and a grid; keys of both may be the same."""
    keys = st.lists(st.sampled_from(sorted(VALUES)), unique=True, max_size=5)
    base = {key: draw(VALUES[key]) for key in draw(keys)}
    chosen = draw(keys.filter(len).map(lambda some: some[:2]))
    some = {"unique": True, "min_size": 1, "max_size": 2}
    grid = {key: tuple(draw(st.lists(VALUES[key], **some))) for key in chosen}
    return base, grid, draw(st.sampled_from(["{}", " {}", "{} "])), draw(st.booleans())


def edited(values):
    """Return the lines of these edits by key, as a file has them."""
    made = {key: value for key, value in values.items() if value is not False}
    return [
        key if value is True else f"{key}{'=' if key.startswith('add') else ' '}{value}"
        for key, value in made.items()
    ]


def of_plan(base, grid, spelling="{}", wide=False):
    """Return the sweep of a grid whose keys are spelled in some way."""
    run = {key: value for key, value in base.items() if key in RUN and "." not in key}
    of_task = {key.removeprefix("task."): v for key, v in base.items() if key.startswith("task.")}
    keys = {key: spelling.format(key.replace("->", " -> ") if wide else key) for key in grid}
    return Plan(
        edits=Edits(edited({key: value for key, value in base.items() if key not in RUN})),
        task=Gaussian(**{"trials": 20, **of_task}),
        grid={keys[key]: values for key, values in grid.items()},
        **run,
    )


def single(values):
    """Return circuit, gain, posterior, seed and task of a run with these values alone."""
    task = {key.removeprefix("task."): v for key, v in values.items() if key.startswith("task.")}
    task = Gaussian(**{"trials": 20, **task})
    changes = {key: value for key, value in values.items() if key not in RUN}
    table = load_circuit(values.get("circuit", "macaque"), task.channels).edited(*edited(changes))
    gain, posterior = gain_of(table, values.get("gain")), values.get("posterior", 0.82)
    return table, gain, posterior, values.get("seed", 0), task


def overlap(base, grid):
    """Whether two edits change one number."""
    return any({one, other} in OVERLAPS for one, other in combinations(base | grid, 2))


@settings(max_examples=80)
@given(sweeps())
def test_every_row_is_a_single_run_with_exactly_what_it_names(drawn):
    base, grid, *_ = drawn
    if overlap(base, {}):
        with refused("edits edit the same"):
            of_plan(*drawn)
        return
    plan = of_plan(*drawn)
    points = [dict(zip(grid, point.values(), strict=True)) for point in plan.each]
    try:
        wanted = [single(base | point) for point in points]
    except ValueError:
        wanted = None  # an edit without sense, such as a rebound of what is clamped
    if overlap(base, grid) or wanted is None:
        with pytest.raises(ValueError, match=r"the point|edit the same"):
            plan.all_points()
        return
    for read, point, (table, gain, posterior, seed, task) in zip(
        plan.all_points(), points, wanted, strict=True
    ):
        assert digest(read.edited) == digest(table)
        assert gain_of(read.edited, read.gain) == gain
        assert read.threshold_nats == threshold_from_posterior(posterior, task.channels)
        assert (read.seed, read.task) == (seed, task)
        assert read.engine == (base | point).get("engine", "population")


@pytest.mark.parametrize(
    ("base", "point"),
    [
        ({"lesion STN": 0.1}, {"lesion STN": 0.1}),
        ({"scale STN->SNr": 0.5, "lesion GPe": 0.1}, {"scale STN->SNr": 0.9}),
        ({"set STN.bias_nats": 0.3, "seed": 3}, {"set STN.bias_nats": -0.2, "seed": 4}),
    ],
)
def test_a_row_decides_as_the_single_run_does(base, point, tmp_path):
    same = {"posterior": 0.7, "task.d_prime": 0.8, "circuit": "spiking_msprt"}
    (setting,) = of_plan(base | same, {key: (value,) for key, value in point.items()}).all_points()
    (shard,) = setting.shards()
    shards.compute(shard, tmp_path)
    behaviour, _ = shards.read(setting, tmp_path)
    table, gain, posterior, _, _ = single(base | same | point)
    model = BasalGanglia(table, Populations(rates=False), gain, setting.block_seed(0))
    threshold = float(threshold_from_posterior(posterior))
    want = behaviour_of(model, setting.block(0, 20).evidence, threshold, 500.0)
    assert np.array_equal(behaviour.decision.choice, want.decision.choice)
    assert np.array_equal(behaviour.decision.time_ms, want.decision.time_ms)
    assert np.array_equal(behaviour.anticipatory, want.anticipatory)


@pytest.mark.parametrize(
    ("edits", "grid", "rows"),
    [
        # One of each kind, in another spelling than that of the edits.
        (["lesion STN 10%"], {" lesion  STN": (0.2,)}, ["lesion STN 20%"]),
        (["cut GPe->STN"], {"cut GPe -> STN": (0.2,)}, ["cut GPe->STN 20%"]),
        (["set STN -> GPe.tau_ms = 4"], {"set STN->GPe.tau_ms": (5,)}, ["set STN->GPe.tau_ms 5"]),
        (
            ["add TRN like=STN", "add D1->GPe weight=-0.1"],
            {"add TRN like=STN bias_nats": (1,)},
            ["add D1->GPe weight=-0.1", "add TRN like=STN bias_nats=1"],
        ),
        (["rebound SNr 0.5"], {"rebound  SNr": (0.2,)}, ["rebound SNr 0.2"]),
        (["dopamine 0.9"], {" dopamine": (1.1,)}, ["dopamine 1.1"]),
        # Two courses of one nucleus are two edits.
        ([], {"add D2[0] to_ms=300 amount": (0.1,), "add D2[0] from_ms=400 amount": (0.2,)},
         ["add D2[0] to_ms=300 amount=0.1", "add D2[0] from_ms=400 amount=0.2"]),
        # An edit by itself is made or not.
        (["lesion STN 10%", "compensate"], {"compensate": (False,)}, ["lesion STN 10%"]),
        (["lesion STN 10%"], {"compensate": (True,)}, ["lesion STN 10%", "compensate"]),
        (["lesion STN 10%"], {"lesion STN": (False,)}, []),
        ([], {"add urgency": (True,), "circuit": ("macaque_small",)}, ["add urgency"]),
        # What is lost, scaled or set of a row that is added.
        (
            ["add TRN like=STN bias_nats=1", "add TRN->GPe weight=0.1"],
            {"set TRN.tau_ms": (2,), "lesion TRN": (0.5,), "scale TRN->GPe": (0.5,)},
            [
                "add TRN like=STN bias_nats=1", "add TRN->GPe weight=0.1", "set TRN.tau_ms 2",
                "lesion TRN 50%", "scale TRN->GPe 0.5",
            ],
        ),
    ],
)  # fmt: skip
def test_a_point_replaces_the_same_edit_in_any_spelling(edits, grid, rows):
    (read,) = Plan(edits=Edits(edits), grid=grid).all_points()
    assert digest(read.edited) == digest(load_circuit(read.circuit).edited(*rows))


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"grid": {"lesion STN": (0.1,), " lesion STN": (0.2,)}}, "each key may be given once"),
        ({"grid": {"posterior": (0.7,), "posterior ": (0.8,)}}, "each key may be given once"),
        ({"grid": {"lesion STN": (0.1, 0.2, 0.1)}}, "each value may be given once"),
        ({"points": ({"lesion STN": 0.1}, {"lesion STN": 0.1})}, "each point may be given once"),
        ({"grid": {"lesion STN": (0.1, "10%")}}, "are the same point"),
        ({"grid": {"lesion STN": (0.1, "0.10")}}, "are the same point"),
        ({"points": ({"lesion STN": 0.1}, {"lesion STN": "10 %"})}, "are the same point"),
    ],
)
def test_a_key_a_value_or_a_point_that_is_there_twice_is_refused(wrong, says):
    with pytest.raises(ValueError, match=says):
        Plan(**wrong).all_points()
