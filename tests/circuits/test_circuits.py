"""What circuits, edits, laws and engines refuse: the field, and words where it has several errors.

Rows of files and lines of text are refused in tests of their readers, by line and as written.
"""

from dataclasses import replace

import numpy as np
import pytest

from circuits import anatomy
from circuits.anatomy import load_circuit as load
from circuits.cells import Lif, Rate
from circuits.cells.membrane import lif_mean_mv
from circuits.checks import is_whole, whole_ticks
from circuits.circuit import Circuit
from circuits.declaration import table_writer
from circuits.declaration.courses import Course
from circuits.declaration.edits import Edits
from circuits.declaration.rows import Population, Projection, rows
from circuits.differences import check_edits, differences
from circuits.dynamics import noise
from circuits.dynamics.fixed_point import off_nats
from circuits.dynamics.ticks import Clock, Scheme
from circuits.dynamics.wiring import wire
from circuits.engines import engine_of, run
from circuits.laws.fluctuation import out_variance, rate_spectrum
from circuits.laws.members import SIGMA0, moved
from circuits.laws.stability import ringing
from tests.circuits.spiking import ADEX
from tests.helpers import refused

NAMES = "bogacz_gurney", "spiking_msprt", "macaque", "gpr"
EXACT, SPIKING, MACAQUE, GPR = map(load, NAMES)
SILENCE = np.zeros((1, 1, 2))
UNEVEN = EXACT.with_projection("STN->GPe", delay_ms=2.05)
DOPAMINE = Course("dopamine", 0.8, 0, 100)
BARE = replace(SPIKING, populations=tuple(replace(p, receptor="") for p in SPIKING.populations))
RATES = run(EXACT, np.zeros((1, 1, 2)), engine="rate", step_ms=500)
NO_MOVE = {"GPe->STN.weight": -1.2}  # GPe->SNr would have to excite


def populations(table=SPIKING, drive=SILENCE, **options):
    return run(table, drive, engine="population", **{"step_ms": 500.0, "seed": 3, **options})


def stream(engine, table=MACAQUE, **options):
    return engine_of(engine).stream(table, **{"step_ms": 20.0, "steps": 2, "seed": 1, **options})


def course(**fields):
    return Course("STN", **{"amount": 0.1, **fields})


# fmt: off
FIELDS = [
    # Tables and their numbers.
    *[("dopamine must be within 0..1, got", lambda x=x, f=f: f(dopamine=x)) for x in (-0.1, 1.1)
      for f in (anatomy.gpr, anatomy.humphries, anatomy.stewart)],
    ("channels", lambda: anatomy.humphries(17)),  # a cell hears at least one of each channel
    ("slope", lambda: anatomy.linear_gpe(slope=0)),
    ("w_gpe_stn", lambda: anatomy.appendix_b(w_gpe_stn=1.2)),
    ("w_gpe_stn", lambda: anatomy.appendix_b(w_gpe_stn=-0.1)),
    ("w_d2_gpe", lambda: anatomy.appendix_b(w_d2_gpe=-1)),
    *[("published_hz", lambda x=x: Population("STN", Rate(), published_hz=x))
      for x in ((1.0,), (2.0, 1.0), (-1.0, 1.0), (0.0, float("nan")), "1")],
    *[("rate_hz", lambda x=x: lif_mean_mv(SPIKING.population("GPe").cell, x))
      for x in (0, -1, 500, np.nan)],
    ("tau_ms STN: tau_ms is that of the Lif cell",
     lambda: replace(EXACT["STN"], cell=Lif(10, 3, 15, 5, 2, 0, 1))),
    ("cv", lambda: SPIKING.with_cell("STN", cv=1.5)),
    ("noise_mv", lambda: SPIKING.with_cell("GPe", noise_mv=-1)),
    ("refractory_ms must be >= 0", lambda: SPIKING.with_cell("GPe", refractory_ms=-1)),
    ("reset_mv", lambda: SPIKING.with_cell("GPe", reset_mv=20)),
    ("tau_ms", lambda: SPIKING.with_cell("GPe", tau_ms=0)),
    ("transfer must be linear", lambda: EXACT.with_projection("STN->GPe", probability=0.5)),
    ("channels", lambda: Circuit("mine", (Population("ctx", Rate()), Population("SNr", Rate())),
                                 (Projection("ctx", "SNr", 1.0),), 1001)),
    ("circuit one of bogacz_gurney, appendix_b.*got 'gprx'", lambda: load("gprx")),
    ("path", lambda: table_writer.write(GPR, "mine.csv")),
    # Edits.
    ("channel ctx_inh is pooled", lambda: MACAQUE.lesion("ctx_inh", 0.5, channel=0)),
    ("nucleus SNr is the read-out", lambda: MACAQUE.lesion("SNr", 0.5, channel=0)),
    ("nucleus GPe is already", lambda: SPIKING.clamp("GPe", channel=0).lesion("GPe", 0.5)),
    ("intact_by_channel 4 channels, got 2$",
     lambda: MACAQUE.lesion("GPe", 0.5, channel=0).with_channels(4)),
    ("intact_by_channel each of 2 channels, got 1$",
     lambda: MACAQUE.edited("set GPe.intact_by_channel=0.5")),
    ("intact_by_channel 0..1", lambda: MACAQUE.edited("set GPe.intact_by_channel=0.5,2")),
    ("factors", lambda: SPIKING.scale("ctx->D1", 0.5, channel=0).with_channels(4)),
    ("transfer STN->GPe", lambda: EXACT.scale("STN->GPe", 0.5, channel=0)),
    ("readout", lambda: EXACT.lesion("STN").lesion("D1")),  # cuts the input from it
    ("readout", lambda: EXACT.lesion("STN").scale("D1->SNr", 0)),
    ("readout", lambda: EXACT.lesion("D1").scale("ctx->STN", 0)),
    ("readout", lambda: EXACT.scale("D1->SNr", 0, 0).scale("D1->SNr", 0, 1).lesion("STN")),
    ("readout", lambda: EXACT.cut("D1->SNr").cut("STN->SNr")),
    ("pathway", lambda: MACAQUE.cut("GPe->D1", 0.5)),
    ("fraction must be within 0..1", lambda: MACAQUE.cut("GPe->STN", 1.5)),
    ("channel", lambda: MACAQUE.cut("GPe->STN", 0.5, 2)),
    ("populations two populations are FSI", lambda: replace(
        MACAQUE, populations=(*MACAQUE.populations, MACAQUE.population("FSI")))),
    *[("unit", lambda x=x: GPR.add(x)) for x in ("urgency", "onset_transient")],
    ("more_inputs ctx", lambda: MACAQUE.with_inputs("ctx")),
    ("more_inputs XYZ", lambda: MACAQUE.with_inputs("XYZ")),
    ("more_inputs STN has 2", lambda: MACAQUE.with_inputs("STN[2]")),
    ("more_inputs once", lambda: MACAQUE.with_inputs("STN", "STN[1]")),
    *[("second", lambda x=x: differences(MACAQUE, x)) for x in (
        load("macaque", 3), load("appendix_b"), GPR, replace(MACAQUE, readout_tau_ms=20.0),
        MACAQUE.edited("add dopamine amount=0.2 to_ms=300"))],
    *[("edits", lambda e=e, x=x: check_edits(Edits([x]), e)) for e, x in (
        ("algebra", "set STN->GPe.delay_ms 4"), ("algebra", "set STN.tau_ms 4"),
        ("algebra", "set GPe.cell.tau_ms 4"), ("algebra", "heterogeneity 0.1"),
        ("rate", "set STN.cell.cv 0.1"), ("rate", "set STN.neurons 7"), ("rate", "neurons 7"),
        ("rate", "set STN->GPe.probability 0.5"), ("rate", "connections 0.5"))],
    # Courses.
    ("amount course of STN from 0 to inf ms: amount must be finite", lambda: course(amount=np.nan)),
    ("amount course of STN: amount must be a number", lambda: course(amount="much")),
    ("from_ms must be >= 0, when the drive begins, got -1", lambda: course(from_ms=-1)),
    ("from_ms must be finite", lambda: course(from_ms=np.inf)),
    ("to_ms must come after from_ms, 5, got 5", lambda: course(from_ms=5, to_ms=5)),
    ("to_ms must come after from_ms", lambda: course(to_ms=np.nan)),
    ("rise_ms must be >= 0 and finite", lambda: course(rise_ms=-1)),
    ("decay_ms must be >= 0 and finite", lambda: course(to_ms=5, decay_ms=np.inf)),
    ("decay_ms without an end, to_ms, there is no decay_ms", lambda: course(decay_ms=5)),
    ("pulse_ms a train of pulses needs both", lambda: course(rate_hz=100.0)),
    ("rate_hz a train of pulses needs both", lambda: course(pulse_ms=2.0)),
    ("pulse_ms shorter than the period, 10 ms", lambda: course(rate_hz=100.0, pulse_ms=10.0)),
    ("rate_hz must be >= 0", lambda: course(rate_hz=-1.0, pulse_ms=1.0)),
    ("rise_ms 0 in a train", lambda: course(rate_hz=100.0, pulse_ms=1.0, rise_ms=2.0)),
    ("courses", lambda: SPIKING.with_rows(DOPAMINE, replace(DOPAMINE, from_ms=50))),  # 1.6 together
    ("courses", lambda: BARE.with_rows(DOPAMINE)),  # no receptor
    ("courses", lambda: SPIKING.with_rows(Population("dopamine", Rate())).with_rows(DOPAMINE)),
    ("dopamine", lambda: SPIKING.scale("ctx->D1", 0.9, channel=0).with_rows(DOPAMINE)),
    ("channel within 0..1, got 2", lambda: load("gpr", 3).add("STN[2]", amount=1).with_channels(2)),
    # Laws.
    ("drive", lambda: out_variance(SPIKING, [1.0])),
    ("frequency_hz", lambda: rate_spectrum(SPIKING, "STN", [0.0])),
    ("drive", lambda: ringing(EXACT, np.zeros(3))),
    ("nats", lambda: GPR.effect_of_nats(np.nan)),
    ("circuit", lambda: moved(MACAQUE.scale("STN->SNr", 0.5), {SIGMA0: 2.6})),
    ("to", lambda: moved(MACAQUE, {"STN->SNr.weight": 0.5})),  # it follows from the others
    ("to", lambda: moved(MACAQUE, {SIGMA0: float("nan")})),
    ("weight", lambda: moved(MACAQUE, NO_MOVE)),
    ("reference 2 channels, got 4", lambda: MACAQUE.compensate(load("macaque", 4))),
    ("nucleus", lambda: MACAQUE.compensate(MACAQUE, rebound_nats={"GPi": 1})),
    ("rebound_nats", lambda: MACAQUE.compensate(MACAQUE, rebound_nats={"SNr": np.nan})),
    ("rebound_nats FSI is new",
     lambda: MACAQUE.compensate(load("macaque_small"), rebound_nats={"FSI": 0.3})),
    ("reference ^ctx_inh is pooled in only one",
     lambda: MACAQUE.with_population("ctx_inh", pooled=False).compensate(MACAQUE)),
    *[("competitors within 1..2", lambda x=x: off_nats(load("bogacz_gurney", 3), x))
      for x in (0, 3)],
    *[(what, lambda x=x, what=what: noise.stream_key(**{"seed": 0, "trial": 0, what: x}, name="a"))
      for what in ("seed", "trial") for x in (-1, 2**64, 0.5)],
    # Runs.
    ("dt_ms", lambda: whole_ticks("delay", 2, 0)),
    ("step_ms", lambda: Clock(1, 0)),
    ("sample_ms of 0.25 ms is not a multiple", lambda: Clock(1, 1, sample_ms=0.25)),
    ("settle_ms", lambda: Clock(1, 1, settle_ms=-1)),
    ("sample_ms step_ms must be a multiple of sample_ms", lambda: Clock(1, 3, sample_ms=2)),
    *[("probability", lambda x=x: populations(SPIKING.with_connections(0.2), **x))
      for x in ({}, {"laws": "lines"}, {"noise": False})],
    *[("first_trial", lambda x=x: populations(first_trial=x)) for x in (-1, 2**63)],
    ("cell AdEx.rate_hz", lambda: populations(SPIKING.with_population("GPe", cell=ADEX))),
    ("cell AdEx", lambda: populations(SPIKING.with_population("GPe", cell=ADEX), laws="lines")),
    ("step_ms", lambda: populations(dt_ms=0.3)),
    ("drive channels", lambda: run(MACAQUE.with_inputs("STN", "GPe"), np.zeros((1, 2, 3)),
                                   engine="rate", step_ms=5.0)),
    ("engine all readings of a trial at once", lambda: stream("brian2")),
    ("engine all readings of a trial at once", lambda: stream("algebra")),
    ("seed needs a seed", lambda: stream("population", seed=None)),
    ("sample_ms multiple", lambda: stream("spikes", step_ms=10.1)),
    ("step_ms > 0", lambda: stream("spikes", step_ms=-1.0)),
    ("drive channels", lambda: stream("rate").add([0.0, 1.0, 0.0])),
    ("drive finite", lambda: stream("rate").add([0.0, np.nan])),
    ("segment_ms", lambda: RATES.spectrum("STN", from_ms=100)),
    ("trial", lambda: RATES.plot(2)),
    ("rates", lambda: replace(RATES, rates_hz={}).plot(0)),
]
"""The field, then words that its error holds, and a call."""
FAILS = [
    ("STN: 3 columns, got 2 values",
     lambda: rows(Projection, ("source target weight", ("STN", 2)))),
    ("'name tau_ms' has a row SNr, the first part does not",
     lambda: rows(Population, ("name cell", ("STN", Rate())), ("name tau_ms", ("SNr", 5)))),
    ("a part must begin with source target, got 'source weight'",
     lambda: rows(Projection, ("source weight", ("STN", 1)))),
    *[(f"{x} must be one of the nuclei of spiking_msprt, ctx",
       lambda x=x: replace(SPIKING, **{x: "GPi"})) for x in ("input", "readout")],
    ("macaque has no lesion: compensate needs a reference", lambda: MACAQUE.compensate()),
    ("delay of STN->GPe of 2.05 ms is not a multiple of dt_ms = 0.1",
     lambda: Scheme(wire(UNEVEN), 0.1).unit_delay),
    ("^ctx cannot rest at 100 Hz: no input to its transfer 'saturating' is known",
     lambda: MACAQUE.compensate(MACAQUE, rebound_nats={"ctx": 4.0})),
    ("ctx->D1 connects 25%", lambda: out_variance(SPIKING.with_connections(0.25))),
    ("is unstable", lambda: out_variance(SPIKING.edited("set STN->GPe.delay_ms 20",
                                                        "set GPe->STN.delay_ms 20"))),
    ("GPe is clamped", lambda: MACAQUE.clamp("GPe").compensate()),
    ("not nats: OUT as -ln P has no meaning", lambda: off_nats(GPR)),
    *[(f"spiking_msprt has courses, but {who} has no", lambda f=f: f(SPIKING.with_rows(course())))
      for who, f in (
          ("the algebra engine", lambda x: run(x, SILENCE, engine="algebra", step_ms=1)),
          ("stability", ringing),
          ("its noise in closed form", out_variance))],
]
"""Words of an error without a field, and a call."""
# fmt: on


@pytest.mark.parametrize(("wanted", "call"), FIELDS, ids=[wanted for wanted, _ in FIELDS])
def test_what_makes_no_sense_is_refused_by_its_field_in_one_sentence(wanted, call):
    with refused(wanted):
        call()


@pytest.mark.parametrize(("words", "call"), FAILS, ids=[words for words, _ in FAILS])
def test_what_cannot_be_answered_says_why(words, call):
    with pytest.raises(ValueError, match=words):
        call()


def test_a_whole_number_is_one_of_whatever_type_and_not_a_truth():
    assert whole_ticks("delay", 2.5, 0.1) == 25
    assert all(map(is_whole, (3, 3.0, np.int32(3), np.float32(3), -2, 0)))
    assert not any(map(is_whole, (2.5, np.inf, True, np.bool_(True), "3", None, [3])))
