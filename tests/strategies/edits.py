"""Edits of a circuit, in Python and at the terminal."""

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
    edit(lambda c, x: c.scale("STN", "GPe", x), numbers(0.9, 1.1)),
    edit(lambda c, x: c.dopamine(x), numbers(0.8, 1.2)),
    edit(lambda c, x: c.with_projection("STN", "GPe", delay_ms=x), st.integers(1, 19)),
    edit(lambda c, x: c.with_projection("STN", "GPe", tau_ms=x), numbers(0, 20)),
    edit(lambda c, _: c.with_population("D1", bias_nats=c.population("D1").bias_nats + 0.01)),
    edit(
        lambda c, x: c.add(Population("TRN", x, 10.0), Projection("STN", "TRN", 2.0, delay_ms=2)),
        st.sampled_from([Rate(), Phase(1.0), Phase(0.3)]),
    ),
    edit(lambda c, x: c.edited(f"set STN->GPe.tau_ms {x}"), numbers(0, 20)),
    edit(lambda c, x: c.add(f"STN->D1 weight={x}"), numbers(0, 1)),
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


WRONG = {
    lambda c, x: c.lesion(x): ["thalamus", "ctx", "SNr"],
    lambda c, x: c.lesion("STN", x): [1.1, -0.1, np.nan, "half", None],
    lambda c, x: c.scale(x, "STN", 1.1): ["SNr"],
    lambda c, x: c.scale("STN", "GPe", x): [-1, np.nan, np.inf, "2"],
    lambda c, x: c.scale("D1", "SNr", 1.1, channel=x): [99, -1, "0"],
    lambda c, x: c.dopamine(x): [-0.1, 2.1, np.nan, "1"],
    lambda c, x: c.with_projection("STN", "GPe", delay_ms=x): [-1, 1e9, "4", np.nan],
    lambda c, x: c.with_projection("D1", "SNr", weight=x): [0.5],
    lambda c, x: c.with_projection("STN", "GPe", weight=x): [np.inf, "x", None, True],
    lambda c, x: c.edited(x): ["set STN.bias_nats", "set STN.x 1", "", 3, "lesoin STN", "STN=0.1"],
    lambda c, x: c.add(x): ["X", "D1->X weight=-1", "X like=Y", "STN", None, 3, {"name": "a"}],
    lambda c, x: c.with_population("STN", **x): [{"wieght": 1.0}, {"transfer": "cube"}],
    lambda c, x: c.with_neurons(x): [0, 2.5, "3", -1, np.nan],
    lambda c, x: c.with_heterogeneity(x): [5, -1, "a", np.nan],
    lambda c, x: c.with_connections(x): [0, 1.5, "a", np.nan],
    lambda c, x: c.add(Population(x, Rate())): ["", " ", "a->b", 3],
    lambda c, x: c.add(c.population(x)): ["STN"],
    lambda c, x: c.add(Projection("STN", x, 1.0)): ["thalamus"],
    lambda c, x: c.with_channels(x): [0, 1, "2", 2.5, np.nan],
    lambda c, x: c.with_population("STN", cell=x): ["Lif", None, 3],
    lambda c, x: c.with_projection("STN", "GPe", pattern=x): ["ring"],
    lambda c, x: c.with_population("STN", gain_hz_per_nat=x): [0, -1, "1", np.nan],
    lambda c, x: driven(c, **x): [
        {"engine": "pen"},
        *({"step_ms": step} for step in (0, "1", np.nan)),
        {"spikes": ("STN",)},
    ],
    lambda c, x: driven(c, x): ["abc", np.zeros((1, 1)), np.zeros((1, 1, 99)), [[[np.nan, 0.0]]]],
}
"""Calls with values that each of them refuses."""


@st.composite
def edited_circuits(draw):
    """Draw a circuit that was edited up to twice."""
    name = draw(st.sampled_from(sorted(anatomy.CIRCUITS)))
    circuit = anatomy.load_circuit(name, draw(st.integers(2, 6)))
    edits = [*GOOD, *(OF_CELLS if name == "spiking_msprt" else ())]
    for call, value in draw(st.lists(st.one_of(edits), max_size=2, unique_by=itemgetter(0))):
        circuit = call(circuit, value)
    return circuit


def refused_edits():
    """Return calls on a circuit, each with a value that it refuses."""
    return st.sampled_from([(call, value) for call, values in WRONG.items() for value in values])


OPTIONS = "|".join(
    (
        "",
        "--edits 'lesion STN 0.0..0.05'",
        "--edits 'lesion STN 0..5%' 'scale STN->GPe 0.98..1.02'",
        "--edits 'scale D1->SNr[0] 0.98..1.02'",
        "--edits 'set STN.cite 0..8'",
        "--edits 'add STN->D1 weight=0.0..0.001'",
    )
)
"""Options that leave a circuit that works."""
LESIONS = "'lesion STN 2%'|'scale D1->SNr 0.99' 'lesion D2'|'scale D2->GPe[0] 0.99'"
"""Arguments of `bgmodel circuit compare-edits`."""
WRONG_OPTIONS = """--edits 'lesion thalamus', --edits 'lesion STN 2', --edits 'lesion SNr',
    --edits 'lesion STN x', --edits 'lesoin STN', --edits STN=0.1, --edits 'scale STN',
    --edits 'scale STN->GPe -1', --edits 'scale STN->ctx 1', --edits 'scale STN->GPe[9] 1',
    --edits 'dopamine 3', --edits 'set STN.wieght 1', --edits 'set STM.bias_nats 1',
    --edits 'set STN->GPe.delay_ms fast', --edits 'add D1->GPe', --edits 'add TRN like=thalamus',
    --edits 'lesion STN' 'lesion STN[0]', --edits 'connections 2'"""
NO_EVIDENCE = "--edits 'scale ctx->STN 0.3'"
"""An edit after which the circuit reads no evidence."""
MANIPULATION = 'edits = ["lesion STN 0.005..0.05"]'
WRONG_MANIPULATIONS = 'edits = "lesion STN"|edit = ["lesion STN"]|edits = ["STN=0.1"]'
"""Manipulations in an experiment's file."""
