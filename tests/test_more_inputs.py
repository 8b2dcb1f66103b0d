"""Further inputs of a circuit, trial by trial: the same as a course, on every engine."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from circuits import anatomy
from circuits.declaration.table_writer import digest, write
from circuits.engines import run

BASE = anatomy.macaque(2).with_neurons(30)
STEP_MS, STEPS = 5.0, 6
DRIVE = np.random.default_rng(1).normal(0, 0.3, (2, STEPS, 2)).cumsum(axis=1)
WHERE = [*product(("STN", "STN[1]"), ("rate", "population", "spikes"))]
WHERE += [("STN", "brian2"), ("STN[1]", "plain")]


def driven(circuit, engine, columns=DRIVE[..., :0]):
    drive = np.concatenate([DRIVE, columns], axis=2)
    return run(circuit, drive, engine=engine, step_ms=STEP_MS, seed=3, settle_ms=20).output_nats


@pytest.mark.parametrize(("nucleus", "engine"), WHERE)
def test_an_input_for_some_time_is_a_course_of_that_trial_and_channel_alone(nucleus, engine):
    """The first trial gets 0.7 nats in its third and fourth reading; the second gets none.

    Columns that are left out are zeros.
    """
    columns = np.zeros((2, STEPS, 1))
    columns[0, 2:4] = 0.7
    out = driven(BASE.with_inputs(nucleus), engine, columns)
    course = BASE.add(nucleus, amount=0.7, from_ms=2 * STEP_MS, to_ms=4 * STEP_MS)
    with_course, without = (driven(table, engine) for table in (course, BASE))
    np.testing.assert_allclose(out[0], with_course[0], atol=2e-6)
    np.testing.assert_array_equal(out[1], without[1])
    np.testing.assert_array_equal(driven(BASE.with_inputs(nucleus), engine), without)
    assert np.abs(with_course[0] - without[0]).max() > 0.02


@pytest.mark.parametrize("engine", ["rate", "population", "spikes", "brian2"])
def test_of_several_inputs_each_has_its_own_column(engine):
    one, other = np.full((2, STEPS, 1), 0.4), np.full((2, STEPS, 1), -0.3)
    both = driven(BASE.with_inputs("STN", "GPe[1]"), engine, np.concatenate([one, other], axis=2))
    turned = driven(BASE.with_inputs("GPe[1]", "STN"), engine, np.concatenate([other, one], axis=2))
    np.testing.assert_array_equal(both, turned)
    columns = np.concatenate([one, 0 * one], axis=2)
    alone = driven(BASE.with_inputs("STN", "GPe[1]"), engine, columns)
    np.testing.assert_array_equal(alone, driven(BASE.with_inputs("STN"), engine, one))
    assert np.abs(both - alone).max() > 0.05


def test_every_column_keeps_its_place_in_the_file_and_the_hash(tmp_path):
    table = BASE.with_inputs("STN", "GPe[1]")
    restored = anatomy.load_circuit(write(table, tmp_path / "one.toml"), 2)
    assert replace(restored, name=table.name) == table
    assert digest(table) != digest(BASE) == digest(table.with_inputs())
