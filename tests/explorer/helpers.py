"""Small states, and steps of a user, for the tests of the explorer."""

from dataclasses import replace

from hypothesis import strategies as st

from bgmodel.explorer.state import ExplorerState, opened
from bgmodel.task import Gaussian

FEW = Gaussian(trials=120, t_max=20, d_prime=1.0)
"""A task that is soon run."""


def small(name="macaque", engine="algebra", *edits):
    """Return a state of few trials on an engine without noise."""
    state = opened(name)
    experiment = replace(state.experiment, task=FEW, engine=engine)
    return ExplorerState(experiment).edited(*edits)


LINES = [
    *("lesion STN 10%", "lesion STN", "lesion D1 5%", "clamp GPe 50%", "cut GPe->STN 30%"),
    *("scale STN->GPe 0.5", "scale ctx->D1[0] 1.1", "dopamine 0.9", "compensate"),
    *("set STN->GPe.delay_ms 4", "set STN.bias_nats -2.2", "rebound SNr 0.3"),
    *("add D1->GPe weight=-0.1 delay_ms=4", "add dopamine amount=0.2 to_ms=300", "keep rest"),
    "add D2[0] amount=-1 from_ms=50 to_ms=90",
    *("neurons 60", "add TRN like=STN bias_nats=-1", "connections 0.5"),
    *("lesion STM 10%", "lesoin STN", "dopamine 3", "lesion STN x", "add D1->GPe", "lesion ctx"),
    *("", " ", "lesion", "set STN.wieght 2", "set STN->GPe.delay_ms fast", "lesion SNr"),
    *("add STN->D1 weight=-1", "lesion STN 150%", "lesion STN[7] 10%", "scale STN->GPe -1"),
    *("add D2[9] amount=1", "add D2[0] amount=1 to_ms=0"),
    *("set STN.cite <b>$x^$</b>", "lesion STN[0] 10%", "scale ctx->STN 0.3", "connections 2"),
]
"""Edits, of which about half are refused."""
SETTINGS = [
    *(("d_prime", value) for value in (0.5, 2.0, 0.0, -1.0, None)),
    *(("channels", value) for value in (2, 3, 12, 1, None)),
    *(("posterior", value) for value in (0.7, 0.9, 1.5, 0.1)),
    *(("threshold", value) for value in (0.3, -1.0, 9.0)),
    *(("trials", value) for value in (100, 130, 0, 10**7)),
    *(("conflict", value) for value in (0.0, 0.5, 1.0)),
    *(("step_ms", value) for value in (50.0, 0.0)),
    *(("t_max", value) for value in (40, 0)),
    *(("gain", value) for value in (None, 0.4, -1.0)),
    *(("trial", value) for value in (0, 5, 1000, -1)),
    *(("circuit", value) for value in ("macaque", "spiking_msprt", "gpr", "nobody", "no.toml")),
    *(("stop", value) for value in (True, None)),
    *(("stop.share", value) for value in (0.3, 1.5)),
    ("evidence", "no_such_table.csv"),
]
"""Settings, allowed and not."""
STEPS = st.one_of(
    st.sampled_from(LINES).map(lambda line: ("edit", line)),
    st.sampled_from(LINES[:19]).map(lambda line: ("edit", line)),
    st.sampled_from(SETTINGS).map(lambda pair: ("set", *pair)),
    st.sampled_from([("undo",), ("redo",), ("reset",), ("baseline",), ("remove",)]),
)
"""What a user does."""
