"""Edits of a circuit, in Python and at the terminal."""

from dataclasses import replace
from operator import itemgetter

import numpy as np
from hypothesis import strategies as st

from circuits import anatomy
from circuits.cells import Phase, Rate
from circuits.declaration.rows import Population, Projection
from circuits.engines import run
from tests.strategies import numbers


def edit(call, values=None):
    """Return an edit, a function of a circuit and a number, with its numbers."""
    return st.tuples(st.just(call), st.none() if values is None else values)


GOOD = [
    edit(lambda c, x: c.lesion("STN", x), numbers(0, 0.1)),
    edit(lambda c, x: c.clamp("GPe", x), numbers(0, 1)),
    edit(lambda c, x: c.scale("STN->GPe", x), numbers(0.9, 1.1)),
    edit(lambda c, x: c.dopamine(x), numbers(0.8, 1.2)),
    edit(lambda c, x: c.with_projection("STN->GPe", delay_ms=x), st.integers(1, 19)),
    edit(lambda c, x: c.with_projection("STN->GPe", tau_ms=x), numbers(0, 20)),
    edit(lambda c, _: c.with_population("D1", bias_nats=c.population("D1").bias_nats + 0.01)),
    edit(
        lambda c, x: c.with_rows(
            Population("TRN", x, 10.0), Projection("STN", "TRN", 2.0, delay_ms=2)
        ),
        st.sampled_from([Rate(), Phase(1.0), Phase(0.3)]),
    ),
    edit(lambda c, x: c.edited(f"set STN->GPe.tau_ms {x}"), numbers(0, 20)),
    edit(lambda c, x: c.edited(f"add STN->D1 weight={x}"), numbers(0, 1)),
    edit(lambda c, _: c.with_population("STN", cite="mine")),
]
"""Edits that leave a circuit that has a fixed point."""
OF_CELLS = [
    edit(lambda c, x: c.with_neurons(x), st.integers(1, 49)),
    edit(lambda c, x: c.with_heterogeneity(x), numbers(0, 0.3)),
    edit(lambda c, x: c.with_connections(x), numbers(0.1, 1)),
]


def driven(c, drive=None, **settings):
    """Run a circuit on nothing, or on a drive that is wrong."""
    drive = np.zeros((1, 1, c.channels)) if drive is None else drive
    return run(c, drive, **{"engine": "algebra", "step_ms": 1.0, **settings})


def of_stn(name):
    return lambda c, x: c.with_population("STN", **{name: x})


def of_path(name):
    return lambda c, x: c.with_projection("STN->GPe", **{name: x})


def of_cell(name):
    return lambda c, x: c.with_cell("STN", **{name: x})


def of_table(name):
    return lambda c, x: replace(c, **{name: x})


def wrong(of, **fields):
    """Return each field with the call that sets it and the values that it refuses."""
    return [(name, of(name), values) for name, values in fields.items()]


NAN, INF = np.nan, np.inf
CHANNELS = [1, 0, -1, "2", 2.5, NAN, None, True]
WRONG = [
    *wrong(
        of_stn, neurons=[0, 1e12, 2.5, "3", NAN], heterogeneity=[-0.1, 5, "a", NAN], intact=[1.1],
        gain_hz_per_nat=[0, -1, "1", NAN], bias_nats=[NAN, "x"], tau_ms=[-1, "x"], pooled=[1],
        transmitter=["glycine"], transfer=["cubic"], cell=["Lif", None, 3], wieght=[1.0],
        cv=[0.1], name=["GPi"], baseline_hz=[-20, -1e-3, 1000.1, 1e6],
    ),
    *wrong(
        of_path, weight=[-1, NAN, INF, "x", None, True], delay_ms=[-1, INF, 1e9, "4", NAN],
        tau_ms=[-1], probability=[0, 1.1], pattern=["ring"], delay=[3],
    ),
    *wrong(of_cell, tau_ms=[0.1]),
    *wrong(
        of_table, readout_tau_ms=[-1], reference_nats=[NAN], max_lead_nats=[0.0, -1.0, NAN],
        range_nats=[(1,), (1, 2, 3), (1, "x"), {1.0, 2.0}, 3, "ab"],
    ),
    ("row", lambda c, x: replace(c, projections=(x,)), ["STN->GPe"]),
    ("row", lambda c, x: replace(c, courses=(x,)), ["x"]),
    ("weight", lambda c, x: c.with_projection("D1->SNr", weight=x), [0.5, 1]),
    ("factors", lambda c, x: c.with_projection("ctx->D1", factors=x),
     ["ab", (-1, 1), (1, "x"), (1, True), (1, None), 3, {1.0, 2.0}]),
    ("pathway", lambda c, x: c.with_projection(f"STN->{x}", weight=2), ["GPi"]),
    ("input", lambda c, x: c.with_population("SNr", pooled=x), [True]),
    ("nucleus", lambda c, x: c.lesion(x), ["thalamus", "ctx", "SNr"]),
    ("fraction", lambda c, x: c.lesion("STN", x), [1.1, -0.1, NAN, "half", None]),
    ("channel", lambda c, x: c.lesion("GPe", 0.5, channel=x), [99, -1, "0"]),
    ("channel", lambda c, x: c.scale("D1->SNr", 1.1, channel=x), [99, -1, "0"]),
    ("pathway", lambda c, x: c.scale(f"{x}->STN", 1.1), ["SNr"]),
    ("factor", lambda c, x: c.scale("STN->GPe", x), [-1, NAN, INF, "2"]),
    ("factor", lambda c, x: c.scale("ctx->D1", x, channel=0), [-1]),
    ("factor", lambda c, x: c.with_neurons_times(x), [0, -1, INF]),
    ("level", lambda c, x: c.dopamine(x), [-0.1, 2.1, NAN, "1"]),
    ("x", lambda c, x: c.edited(x), ["set STN.x 1"]),
    ("edits", lambda c, x: c.edited(x), ["set STN.bias_nats", "", 3, "lesoin STN", "STN=0.1"]),
    ("add", lambda c, x: c.add(x), ["X", "STN", "TRN like=STN", None, 3]),
    ("row", lambda c, x: c.with_rows(x), [None, "X like=STN", {"name": "a"}]),
    ("nucleus", lambda c, x: c.add(x, weight=-1), ["D1->X"]),
    ("nucleus", lambda c, x: c.add("X", like=x), ["Y"]),
    ("nucleus", lambda c, x: c.with_rows(Projection("STN", x, 1.0)), ["thalamus"]),
    ("populations", lambda c, x: c.with_rows(c.population(x)), ["STN"]),
    ("synapse", lambda c, x: c.with_rows(c.projection(f"STN->{x}")), ["GPe"]),
    ("name", lambda c, x: c.with_rows(Population(x, Rate())), ["", " ", "a->b", 3]),
    ("channels", lambda c, x: c.with_channels(x), CHANNELS),
    ("neurons", lambda c, x: c.with_neurons(x), [0, 2.5, "3", -1, NAN]),
    ("heterogeneity", lambda c, x: c.with_heterogeneity(x), [5, -1, "a", NAN]),
    ("probability", lambda c, x: c.with_connections(x), [0, 1.5, "a", NAN]),
    ("engine", lambda c, x: driven(c, engine=x), ["pen"]),
    ("step_ms", lambda c, x: driven(c, step_ms=x), [0, "1", NAN]),
    ("spikes", lambda c, x: driven(c, spikes=x), [("STN",)]),
    ("drive", driven, [np.zeros((1, 1)), np.zeros((1, 1, 99)), [[[NAN, 0.0]]]]),
]  # fmt: skip
"""Fields, calls, and values that each of them refuses by the name of the field."""


@st.composite
def edited_circuits(draw):
    """Draw a circuit that was edited up to twice."""
    name = draw(st.sampled_from(sorted(anatomy.CIRCUITS)))
    circuit = anatomy.load_circuit(name, draw(st.integers(2, 6)))
    edits = [*GOOD, *(OF_CELLS if name == "spiking_msprt" else ())]
    for call, value in draw(st.lists(st.one_of(edits), max_size=2, unique_by=itemgetter(0))):
        circuit = call(circuit, value)
    return circuit


MANIPULATION = 'edits = ["lesion STN 0.005..0.05"]'
WRONG_MANIPULATIONS = 'edits = "lesion STN"|edit = ["lesion STN"]|edits = ["STN=0.1"]'
"""Manipulations in an experiment's file."""
