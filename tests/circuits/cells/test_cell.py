"""Cell types: missing methods are reported, and invalid types are rejected."""

import numpy as np
import numpy.testing as npt
import pytest

from circuits.cells import CELLS, Cell, Phase, Rate, register, single
from circuits.cells.cell import RESERVED
from tests.circuits.spiking import (
    ADEX,
    BASE,
    SPIKING,
    Diffusing,
    kind_of,
    lacking,
    spikes_of,
)
from tests.helpers import refused, refusing


def test_a_type_that_only_names_its_state_lacks_every_step():
    circuit = BASE.with_population("GPe", cell=register(kind_of(state=("v",)))())
    for engine in SPIKING:
        with refused(r"cell Own\.\w+, and Own cells do not have it"):
            lacking(engine)(circuit)


test_a_type_that_cannot_be_one_is_refused_at_registration = refusing(
    (int, "cell subclass of Cell"),
    (type("Plain", (Cell,), {}), "cell frozen=True"),
    (kind_of(hears="mv", state=("v",)), "hears one of nats, hz"),
    (kind_of(), "state"),
    (kind_of(Phase, hears="nats"), "hears renewal"),
    (kind_of(Diffusing, interval_quantiles=Phase.interval_quantiles), "tick"),
    (kind_of(Phase, "Lif"), "cell already"),
    of=register,
)


def test_every_registered_type_answers_or_raises_in_every_engine():
    made = {"Rate": Rate(), "Lif": BASE.population("GPe").cell, "Phase": Phase(0.3), "AdEx": ADEX}
    assert set(made) == set(CELLS)
    calls = [lacking(name) for name in (*SPIKING, "rate")]
    calls += [lacking("algebra", laws=laws) for laws in ("table", "cells", "finite")]
    for name, cell in made.items():
        circuit = BASE.with_population("GPe", cell=cell)
        for call in calls:
            try:
                right = np.isfinite(call(circuit).output_nats).all()
            except ValueError as error:
                right = f"{name} cells do not have it" in str(error)
            assert right


ONE = np.float32(1)


def fitting(**answers):
    """Return a circuit whose STN has a custom cell type with a tick and other methods."""
    return BASE.with_population("STN", cell=register(kind_of(Diffusing, **answers))(0.3))


def short(heard, ones, phi, noise_step, factor):
    return (phi > phi,)


def swapped(heard, ones, phi, factor, noise_step):
    return phi > phi, phi


@pytest.mark.parametrize("engine", SPIKING)
@pytest.mark.parametrize(
    ("answers", "says"),
    [
        ({"constants": lambda *_: {"factor": ONE}}, "constants"),
        ({"constants": lambda *_: {"factor": ONE, "noise_step": ONE, "x": ONE}}, "constants"),
        ({"constants": lambda *_: {"noise_step": 1.0, "factor": ONE}}, "noise_step single prec"),
        (
            {"constants": lambda *_: {"noise_step": ONE * np.nan, "factor": ONE}},
            "noise_step nan",
        ),
        ({"begin": staticmethod(lambda uniform, noise_step, factor: ())}, "begin"),
        ({"tick": staticmethod(short)}, "tick must return whether it fires, phi; it returns 1"),
        ({"tick": staticmethod(swapped)}, "tick must take"),
    ],
    ids=["too few", "too many", "double", "nan", "begin", "tick", "order"],
)
def test_a_type_whose_answers_do_not_fit_each_other_is_refused_by_every_engine(
    engine, answers, says
):
    with refused(says):
        lacking(engine)(fitting(**answers))


@pytest.mark.parametrize("engine", SPIKING)
@pytest.mark.parametrize(
    "name", ["decay_hz", "x", "nats", "pi", "dt_s", "own", "interval", "train"]
)
def test_names_of_the_engines_are_refused_as_those_of_a_cell(engine, name):
    def begin(uniform, noise_step, factor):
        return (single.single(uniform),)

    circuit = fitting(state=(name,), begin=staticmethod(begin))
    code = f"lambda heard, ones, {name}, noise_step, factor: ({name} > {name}, {name})"
    type(circuit.population("STN").cell).tick = staticmethod(eval(code))
    if name in RESERVED:
        with refused(f"state an engine's own names .*{name}"):
            lacking(engine)(circuit)
    elif engine != "brian2":
        lacking(engine)(circuit)


@pytest.mark.parametrize("engine", SPIKING)
def test_a_bare_number_in_a_tick_is_refused(engine):
    def tick(heard, ones, phi, noise_step, factor):
        return phi >= 1, phi + 0.5

    with refused("tick numbers 1, 0.5"):
        lacking(engine)(fitting(tick=staticmethod(tick)))


def test_a_type_whose_tick_was_replaced_is_compiled_anew():
    circuit = fitting()
    before = spikes_of(circuit, "spikes")

    def silent(heard, ones, phi, noise_step, factor):
        return phi > phi, phi

    type(circuit.population("STN").cell).tick = staticmethod(silent)
    assert not any(s[0] == "STN" for s in spikes_of(circuit, "spikes"))
    assert any(s[0] == "STN" for s in before)


def test_the_exponential_of_all_engines_is_the_exponential_from_minus_87_to_60():
    x = np.linspace(-100, 100, 10_001).astype(np.float32)
    powers, within = single.exponential(x), (x >= -87) & (x <= 60)
    npt.assert_allclose(powers, np.exp(np.clip(x.astype(float), -87, 60)), rtol=5e-7)
    assert np.ptp(powers[x < -87]) == np.ptp(powers[x > 60]) == 0
    assert np.diff(powers[within]).min() > 0
    from circuits.engines.spikes import lanes

    compiled = lanes.numba.njit(lambda values: [lanes.exp32(value) for value in values])(x)
    npt.assert_array_equal(np.array(compiled), powers)
