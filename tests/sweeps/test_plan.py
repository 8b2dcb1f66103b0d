"""The file of a sweep: keys, points, and the names of shards."""

from contextlib import nullcontext
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bgmodel.experiments.experiment import Experiment
from bgmodel.experiments.record import Changes
from bgmodel.stopping.task import StopTask
from bgmodel.sweeps.plan import BLOCK, Plan, Point, read_plan
from bgmodel.tactile.task import SameDifferent
from bgmodel.task import Gaussian, settings_of_tasks
from circuits.anatomy import load_circuit
from circuits.declaration.edits import Edits
from circuits.declaration.table_writer import write
from tests.helpers import long_table, refused, some_evidence


def plan(tmp_path, text):
    path = tmp_path / "sweep.toml"
    path.write_text(text)
    return read_plan(path)


def points(tmp_path, text):
    return plan(tmp_path, text).all_points(tmp_path)


def test_a_grid_is_every_combination_and_its_last_key_changes_fastest():
    read = Plan(grid={"lesion STN": (0.0, 0.1), "dopamine": (0.9, 1.0, 1.1)})
    assert [tuple(point.values()) for point in read.each] == [
        (0.0, 0.9), (0.0, 1.0), (0.0, 1.1), (0.1, 0.9), (0.1, 1.0), (0.1, 1.1)
    ]  # fmt: skip
    assert read.axes == {"lesion STN": [0.0, 0.1], "dopamine": [0.9, 1.0, 1.1]}


def test_a_sweep_and_an_experiment_have_the_same_defaults():
    """A reader who turns one into the other keeps the numbers."""
    sweep, experiment = ({f.name: f.default for f in fields(kind)} for kind in (Point, Experiment))
    names = sweep.keys() & experiment.keys() - {"task"}
    assert {"circuit", "engine", "gain", "posterior", "foreperiod_ms", "seed"} <= names
    assert {name: sweep[name] for name in names} == {name: experiment[name] for name in names}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", r"either \[grid\] or \[\[points\]\]"),
        ("grid = {'lesion STN' = [0.1]}\npoints = [{'lesion GPe' = 0.1}]", "either"),
        ("grid = {'lesion STN' = []}", "each key of grid needs one value or more"),
        ("points = [{'lesion STN' = 0.1}, {'lesion GPe' = 0.1}]", "all points must name the same"),
        ("points = [{}]", "all points must name the same keys, one or more"),
        ("colour = 1\ngrid = {'lesion STN' = [0.1]}", "no key 'colour'; there are circuit"),
        ("show = ['speed']\ngrid = {'lesion STN' = [0.1]}", "show must name accuracy, .*'speed'"),
        # Points.
        ("grid = {STN = [0.1]}", "the point STN = 0.1: there is no 'STN' .*; there are circuit"),
        (
            "grid = {'lesion STNN' = [0.1]}",
            "the point lesion STNN = 0.1: .*macaque has no .*'STNN'",
        ),
        ("grid = {'task.dprime' = [1]}", "there is no key 'task.dprime'.*; there are .*d_prime"),
        ("grid = {'task.d_prime' = ['a']}", "task.d_prime should be a valid number, got 'a'"),
        ("grid = {'lesion STN' = [0.1, 1.5]}", r"'lesion STN 1.5': a fraction is within 0..1"),
        ("grid = {posterior = [0.4]}", "posterior must lie between chance, 0.5"),
        ("grid = {engine = ['foo']}", "engine must be one of algebra, .*, got 'foo'"),
        ("grid = {circuit = ['gpr']}", "gpr works in salience, not nats"),
        ("grid = {'task.evidence' = ['no.csv']}", "there is no table"),
    ],
)
def test_a_file_or_a_point_that_makes_no_sense_is_one_sentence(tmp_path, text, says):
    with pytest.raises(ValueError, match=says):
        points(tmp_path, text)


class Started(Exception):
    """An experiment passed its checks."""


def started(*_):
    raise Started


def refusal(run):
    """Return what a run is refused with; nothing if it starts."""
    try:
        run()
    except Started:
        return ""
    except ValueError as error:
        return str(error)
    return ""


@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    posterior=st.floats(0.45, 1) | st.floats(0.9, 0.97),
    name=st.sampled_from(["macaque", "spiking_msprt", "appendix_b"]),
    channels=st.integers(2, 4),
    edits=st.sampled_from(
        [[], ["lesion STN 10%"], ["lesion STN"], ["dopamine 1.3"], ["scale ctx->STN 0.5"],
         ["set STN.bias_nats 9"]]
    ),
)  # fmt: skip
def test_a_sweep_refuses_the_posteriors_that_an_experiment_refuses(
    monkeypatch, posterior, name, channels, edits
):
    monkeypatch.setattr("bgmodel.integrators.at_thresholds.behaviour_of", started)
    monkeypatch.setattr("bgmodel.experiments.experiment.BasalGanglia.warn_of_noise", lambda *_: 0)
    task = Gaussian(trials=100, t_max=2, channels=channels)
    run = {"circuit": name, "engine": "rate", "gain": 0.5, "task": task}

    def experiment():
        words = {"name": "", "note": "", "predictions": (), "manipulation": Changes(Edits(edits))}
        Experiment(**words, **run, posterior=posterior).run()

    def sweep():
        Plan(**run, edits=Edits(edits), grid={"posterior": (posterior,)}).all_points()

    one, other = refusal(experiment), refusal(sweep)
    assert bool(one) == bool(other)
    assert other.endswith(one)


def test_a_shard_is_named_by_what_it_computes():
    def names(**changed):
        made = Plan(**({"grid": {"lesion STN": (0.1, 0.2)}} | changed)).all_points()
        return [shard.name for one in made for shard in one.shards()]

    one, two = names()
    assert one != two
    # What stays the same keeps its shards, in whatever sweep and place it is.
    assert names(grid={"lesion STN": (0.3, 0.2, 0.1)})[1:] == [two, one]
    assert names(name="another", show=("drift",)) == [one, two]
    assert names(edits=Edits(["lesion STN 10%"]), grid={"dopamine": (1.0,)}) == [one]
    for other in ({"seed": 1}, {"posterior": 0.9}, {"engine": "rate"}, {"gain": 0.4}):
        assert not {one, two} & set(names(**other))


def test_more_trials_keep_the_blocks_that_are_there():
    def blocks(trials):
        (point,) = Plan(grid={"task.trials": (trials,)}).all_points()
        return point.shards()

    few, many = blocks(2 * BLOCK), blocks(2 * BLOCK + 5)
    assert [shard.trials for shard in many] == [BLOCK, BLOCK, 5]
    assert [shard.name for shard in many[:2]] == [shard.name for shard in few]


def test_evidence_of_a_table_is_read_beside_the_file_and_every_trial_once(tmp_path):
    shown = some_evidence(trials=30, steps=21, hypotheses=3)
    long_table(shown).to_csv(tmp_path / "own.csv", index=False)
    (point,) = points(tmp_path, "task = {evidence = 'own.csv'}\n[grid]\n'lesion STN' = [0.1]")
    assert (point.trials, point.steps, point.hypotheses) == (30, 21, 3)
    assert point.edited.channels == 3
    parts = [point.block(first, 12).evidence for first in (0, 12, 24)]
    assert [part.trials for part in parts] == [12, 12, 6]
    nats = np.concatenate([part.log_likelihood for part in parts])
    assert np.allclose(nats, shown.log_likelihood, atol=1e-6)


def test_a_circuit_of_ones_own_is_read_beside_the_file_wherever_one_stands(tmp_path, monkeypatch):
    write(load_circuit("spiking_msprt", 2), tmp_path / "mine.toml")
    monkeypatch.chdir("/")
    for text in (
        "circuit = 'mine.toml'\n[grid]\n'lesion STN' = [0.1]",
        "grid = {circuit = ['mine.toml']}",
    ):
        (point,) = points(tmp_path, text)
        assert point.circuit == str(tmp_path / "mine.toml")
    with refused("nucleus spiking_msprt has no nucleus 'TRN'"):
        points(tmp_path, "[grid]\n'lesion TRN' = [0.1]\ncircuit = ['mine.toml']")


def test_a_table_without_the_truth_is_refused_before_anything_runs(tmp_path):
    for truth in (True, False):
        long_table(some_evidence(trials=30), truth).to_csv(tmp_path / "own.csv", index=False)
        with nullcontext() if truth else refused(r"truth own\.csv"):
            points(tmp_path, "grid = {'task.evidence' = ['own.csv']}")


def test_readings_and_alternatives_of_what_is_drawn_are_those_of_the_task():
    task = Gaussian(trials=30, t_max=17, channels=4)
    drawn = Point(task=task)
    assert (drawn.trials, drawn.steps, drawn.hypotheses) == (30, 17, 4)
    evidence = drawn.block(0, 12).evidence
    assert (evidence.trials, evidence.steps, evidence.hypotheses) == (12, 17, 4)
    assert Point(task=SameDifferent()).hypotheses == 2


def test_an_edit_is_of_the_circuit_of_its_own_point_whatever_comes_first():
    """ctx_inh is a nucleus of macaque alone, and common one of spiking_msprt."""
    other = load_circuit("spiking_msprt")
    for values in (
        {"lesion common": 0.2, "circuit": other.name},
        {"circuit": other.name, "lesion common": 0.2},
    ):
        (point,) = Plan(points=(values,)).all_points()
        assert point.edited == other.lesion("common", 0.2)
    with refused("nucleus spiking_msprt has no nucleus 'ctx_inh'"):
        Plan(points=({"lesion ctx_inh": 0.2, "circuit": other.name},)).all_points()


SETTINGS = {
    "circuit": "spiking_msprt", "edits": Edits(["lesion STN 10%"]), "engine": "rate", "gain": 0.3,
    "seed": 1, "posterior": 0.7, "threshold": 0.3, "foreperiod_ms": 200.0, "stop": StopTask(),
}  # fmt: skip
TASKS = {
    "channels": 3, "d_prime": 0.6, "conflict": 0.5, "t_max": 41, "step_ms": 25.0, "trials": 90,
    "expectancy_nats": 0.2, "expectancy_ms": 200.0,
}  # fmt: skip
TACTILE = {"period_mm": 1.5, "fold": 1, "t_max": 41, "step_ms": 40.0, "trials": 90}
STOP = {
    "share": 0.5, "delays_ms": (150.0, 250.0), "staircases": 1, "delay_sd_ms": 10.0,
    "failures": 0.1, "nucleus": "SNr", "amount_nats": 1.5, "delay_ms": 40.0, "duration_ms": 50.0,
    "cancel_ms": 20.0,
}  # fmt: skip


def names_of(point):
    return {shard.name for shard in point.shards()}


@pytest.mark.filterwarnings("ignore::circuits.errors.EditWarning")
def test_the_name_of_a_shard_follows_every_setting_of_its_point():
    """A shard of other settings would be taken for this one."""
    assert SETTINGS.keys() | {"task"} == {f.name for f in fields(Point)}
    expectant = Gaussian(expectancy_nats=0.1, expectancy_ms=100.0)
    tactile = SameDifferent()
    assert settings_of_tasks().keys() == TASKS.keys() | TACTILE.keys() | {
        "evidence", "taps", "step_deg", "a_deg", "b_deg"
    }  # fmt: skip
    every = [names_of(Point())]
    every += [names_of(Point(**{name: value})) for name, value in SETTINGS.items()]
    every += [names_of(Point(task=expectant)), names_of(Point(task=tactile))]
    every += [names_of(Point(task=replace(expectant, **{k: v}))) for k, v in TASKS.items()]
    every += [names_of(Point(task=replace(tactile, **{k: v}))) for k, v in TACTILE.items()]
    assert STOP.keys() == {f.name for f in fields(StopTask)}
    every += [names_of(Point(stop=StopTask(**{k: v}))) for k, v in STOP.items()]
    assert len(set().union(*every)) == sum(map(len, every))
