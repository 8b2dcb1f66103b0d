"""Every argument of the front door, given what it can't be: one sentence that names it."""

import inspect
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import bgmodel as bg
from bgmodel import fit_trials
from bgmodel.discriminating.space import Space
from bgmodel.tactile.decoder import Decoder

EVIDENCE = bg.gaussian_evidence(120, d_prime=0.7, t_max=8, seed=1)
EVIDENCE_OF_STOP = bg.gaussian_evidence(40, d_prime=0.7, t_max=60, step_ms=10, seed=1)
TRACE = bg.Msprt().run(EVIDENCE)
CIRCUIT = bg.load_circuit("macaque")
MODEL = bg.BasalGanglia(CIRCUIT, "algebra")
CHOICES = {"response": np.tile([1, 1, 0], 40), "coherence": np.tile([0.1, 0.2, -0.2], 40)}
TRIALS = pd.DataFrame({"rt": np.tile(np.linspace(0.3, 0.9, 30), 4), **CHOICES})
PATHWAY = {"pathway": "STN->GPe"}
DECIDE = {"evidence": EVIDENCE, "posterior": 0.9}
CALLS = {
    bg.gaussian_evidence: {"trials": 4, "t_max": 3, "seed": 1},
    bg.Evidence: {"log_likelihood": np.ones((2, 3, 2))},
    bg.read_evidence: {"path": "e.csv", "step_ms": 50.0},
    bg.read_trials: {"source": TRIALS},
    bg.Columns: {},
    bg.stream: {"seed": 1},
    bg.Sprt: {},
    bg.Msprt: {},
    bg.Msprt.threshold: {"boundary_separation": 1.0},
    bg.threshold_from_posterior: {"posterior": 0.9},
    bg.Sprt.threshold: {"boundary_separation": 1.0},
    bg.first_crossing: {"trace": TRACE, "thresholds": 0.3},
    bg.load_circuit: {"name": "macaque"},
    CIRCUIT.row: {"name": "STN"},
    CIRCUIT.edited: {"lines": "lesion STN"},
    CIRCUIT.lesion: {"name": "STN"},
    CIRCUIT.clamp: {"name": "STN"},
    CIRCUIT.cut: PATHWAY,
    CIRCUIT.scale: {**PATHWAY, "factor": 0.5},
    CIRCUIT.set: {"field": "STN.baseline_hz", "value": 20.0},
    CIRCUIT.dopamine: {"level": 1.0},
    CIRCUIT.with_channels: {"channels": 3},
    CIRCUIT.lesion("STN", 0.1).compensate: {},
    bg.BasalGanglia: {"circuit": "macaque"},
    MODEL.run: {"evidence": EVIDENCE},
    MODEL.decide: DECIDE,
    bg.Msprt().run: {"evidence": EVIDENCE},
    bg.Msprt().decide: DECIDE,
    bg.Sprt().decide: DECIDE,
    bg.Condition: {},
    bg.StopTask: {},
    bg.StopTask().decide: {"model": MODEL, "evidence": EVIDENCE_OF_STOP, "posterior": 0.8},
    bg.Gaussian: {},
    bg.SameDifferent: {},
    bg.Orientation: {},
    bg.EdgeTurn: {},
    bg.EdgeDirection: {},
    bg.Gaussian().evidence: {"seed": 1},
    bg.load_taps: {},
    bg.load: {"path": "nothing.npz"},
    bg.load_decoder: {"path": "nothing.onnx"},
    bg.compare: {"model": MODEL, "evidence": EVIDENCE, "resamples": 20},
    bg.Experiment.from_toml: {"file": "stn_conflict"},
    bg.Sweep.from_toml: {"file": "grid.toml"},
    bg.fit: {"data": TRIALS, "model": "constant_gap"},
    bg.compare_fits: {},
    bg.take_exam: {},
    bg.discriminate: {"first": "msprt", "second": "max vs average"},
    bg.explore: {},
}
TASKS = ("Gaussian", "SameDifferent", "Orientation", "EdgeTurn", "EdgeDirection")
ODD = {
    "None": None, "text": "x", "object": object(), "list": [1, "a"], "nan": np.nan, "inf": np.inf,
    "negative": -1, "huge": 1e30, "array": np.zeros((2, 2)),
}  # fmt: skip
NAMES_OF_COLUMNS = ("rt", "response", "participant", "ssd", "trial_type", "upper", "stimulus")
LEGAL = {
    "seed": ["huge"],
    "BasalGanglia seed": ["None"],
    "gain": ["huge"],
    "hypotheses": ["huge"],
    "factor": ["huge"],
    "noise_nats": ["huge"],
    "fit trials": ["huge"],
    "gaussian_evidence conflict": ["negative"],
    "Condition threshold": ["negative", "huge"],
    **{
        f"{kind} {name}": ["huge"]
        for kind in TASKS
        for name in ("d_prime", "period_mm", "trials", "t_max", "step_ms")
    },
    "Gaussian channels": ["huge"],
    "a_deg": ["negative"],
    "b_deg": ["negative"],
    "amount_nats": ["negative", "huge"],
    "nucleus": ["text"],  # whose circuit is not known yet
    **{f"StopTask {name}": ["inf", "huge"] for name in ("duration_ms", "cancel_ms")},
    **{f"StopTask {name}": ["huge"] for name in ("delay_ms", "delay_sd_ms", "staircases")},
    **{f"{kind} taps": ["text"] for kind in TASKS},  # files that are read when trials are drawn
    "baseline": ["negative", "huge"],
    "boundary_separation": ["huge", "array"],
    "first_crossing thresholds": ["array"],
    "fit folder": ["text"],
    "fit model": ["None"],
    **{f"Columns {name}": ["text"] for name in NAMES_OF_COLUMNS},
    "Columns deadline_s": ["huge"],
    "discriminate workers": ["huge"],
    "fit workers": ["huge"],
    "names": ODD,
    "check_seed": ["huge"],
}
"""Odd values that make sense, by argument; None does so where it is the default."""
FIELDS = {
    "taps": ["path"],
    "withheld": ["deadline_s"],  # until which it is
    "spikes": ["evidence"],
    "d_prime": ["log_likelihood"],
    "conflict": ["log_likelihood"],
    "channels": ["trials"],  # of which there are too many for the memory
    "t_max": ["trials"],
    "expectancy_nats": ["foreperiod_ms"],
    "strength": ["x", "conditions"],
    "stimulus": ["x"],
    "conditions": ["x"],
    "thresholds": ["posterior"],
    "threshold": ["posterior"],
    "name": ["circuit", "nucleus"],
    "lines": ["edits"],
    "field": ["edits"],
    "value": ["baseline_hz", "edits"],
    "model": ["circuit", "models"],
    "intact": ["circuit"],
    "data": ["source"],
    "deadline": ["deadline_s"],
    "what": ["file"],
    "first": ["circuit"],
    "second": ["circuit"],
    "first_edits": ["edits"],
    "second_edits": ["edits"],
    "space": ["path"],
    "evidence": ["trial"],  # a column that the trials must have too
}
"""Fields that an error names in place of the argument."""


def called(call, argument, odd):
    good = {name: value for name, value in CALLS[call].items() if name != argument.name}
    if argument.kind == argument.VAR_POSITIONAL:
        return call(*good.values(), odd)
    return call(**good, **{argument.name: odd})


@pytest.mark.parametrize("call", CALLS, ids=lambda call: call.__qualname__)
@pytest.mark.filterwarnings("ignore")
def test_what_an_argument_cannot_be_is_refused_by_name(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Space, "shipped", lambda: Space(d_prime=(1.0,)))
    monkeypatch.setattr(fit_trials, "fit_entry", lambda *_: SimpleNamespace(get=lambda: (None, ())))
    monkeypatch.setattr(fit_trials, "fit_group", lambda *_, **__: None)
    absent = Decoder.load
    monkeypatch.setattr(Decoder, "load", lambda p: None if str(p) == "nothing.onnx" else absent(p))
    (tmp_path / "e.csv").write_text("trial,step,ll_a,ll_b,truth\n1,1,-1,-2,a\n1,2,-1,-3,a\n")
    for argument in inspect.signature(call).parameters.values():
        name = argument.name
        legal = [*LEGAL.get(name, []), *LEGAL.get(f"{call.__name__} {name}", [])]
        if argument.kind == argument.VAR_KEYWORD:
            continue  # Python refuses a name that is none of an option's
        if argument.default is None and name not in CALLS[call]:
            legal.append("None")
        for what, odd in ODD.items():
            if what in legal:
                called(call, argument, odd)
                continue
            with pytest.raises(bg.InputError) as caught:
                called(call, argument, odd)
            assert caught.value.field in (name, *FIELDS.get(name, [])), (name, what)
            assert len(str(caught.value).splitlines()) == 1


def test_every_function_of_the_front_door_is_in_the_table():
    tried = {call.__name__ for call in CALLS} | {
        "Circuit",
        "Exam",
        "Experiment",
        "Sweep",
        # Tried by tests of their modules.
        "learn",
        "simulate",
        "simulate_taps",
        "touch",
        "train_decoder",
    }
    results = {"Decision", "Trace", "InputError", "BgmodelWarning", "__version__"}
    assert set(bg.__all__) == {name for name in tried if name in bg.__all__} | results
