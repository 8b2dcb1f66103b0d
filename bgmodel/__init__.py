"""Decision making in the basal ganglia: circuits, the optimal decision rule, experiments, fits.

    import bgmodel as bg

    task = bg.SameDifferent(period_mm=2)              # Orientation(4), EdgeTurn(5), Gaussian()
    evidence = task.evidence(500, taps=bg.load_taps(), seed=1)   # or taps="decoded.parquet"
    circuit = bg.load_circuit("macaque")              # print(circuit), circuit.plot()
    edited = circuit.lesion("STN", 0.1).dopamine(0.9)
    edited = circuit.edited("lesion STN 10%", "dopamine 0.9")    # the same, as in files
    model = bg.BasalGanglia(edited, seed=1)           # engine="spikes": each cell
    decision = model.decide(evidence, posterior=0.82) # .accuracy, .to_dataframe(), .plot()
    model.activity(evidence[:5]).to_xarray().rate_hz.sel(nucleus="STN", channel=0)
    bg.compare(model, evidence).summary()             # with the MSPRT, trial by trial
    bg.learn(task, model, xi=50).summary()            # reward moves dopamine
    bg.touch(task).plot()                             # all of it: taps, decisions, reward, spikes
    bg.StopTask(delay_ms=60).decide(model, evidence, posterior=0.82)    # stop signals
    bg.Experiment.from_toml("lesion.toml").run().summary()
    bg.Sweep.from_toml("grid.toml").run().to_xarray()
    bg.take_exam("macaque").summary()                     # an exam of published numbers
    bg.discriminate("msprt", "max vs average").summary()    # the task that tells two models apart
    bg.fit("trials.csv", "constant_gap", strength="coherence").summary()
    bg.fit("trials.csv", "constant_gap", strength="coherence", people="hierarchical").plot()
    bg.simulate("constant_gap", {"bound": 1.2}, "trials.csv", strength="coherence", seed=1)
    bg.explore(edited)                                # in a notebook: turn a number and watch

A tap becomes evidence, evidence becomes an output trace, the trace crosses a threshold, and reward
moves the threshold.  Importing this package loads neither torch, brian2 nor matplotlib.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

try:
    from circuits.errors import BgmodelWarning, InputError
except ImportError as error:
    raise ImportError(
        "found a package named 'circuits' that is not part of bgmodel: another distribution of "
        "that name is installed in this environment; install bgmodel in a separate one"
    ) from error

from bgmodel.deciding.decision import Decision, first_crossing
from bgmodel.deciding.trace import Trace
from bgmodel.evidence import Evidence
from bgmodel.integrators.sprt import Msprt, Sprt, threshold_from_posterior
from bgmodel.simulated_evidence import gaussian_evidence
from bgmodel.support import __version__
from bgmodel.support.seeds import stream
from bgmodel.task import Gaussian

if TYPE_CHECKING:
    from bgmodel.comparison.compare import compare
    from bgmodel.conditions import Condition
    from bgmodel.discriminating.discriminate import discriminate
    from bgmodel.exam.exam import Exam, take_exam
    from bgmodel.experiments.experiment import Experiment
    from bgmodel.explorer.notebook import explore
    from bgmodel.fit_trials import fit, simulate
    from bgmodel.fitting.model_comparison import compare_fits
    from bgmodel.from_taps import touch
    from bgmodel.integrators.basal_ganglia import BasalGanglia
    from bgmodel.learning.from_reward import learn
    from bgmodel.stopping.task import StopTask
    from bgmodel.support.saved import load
    from bgmodel.sweeps.sweep import Sweep
    from bgmodel.tactile.decoder import load_decoder, train_decoder
    from bgmodel.tactile.sensor import simulate_taps
    from bgmodel.tactile.source import load_taps
    from bgmodel.tactile.task import EdgeDirection, EdgeTurn, Orientation, SameDifferent
    from bgmodel.trials.evidence_table import read_evidence
    from bgmodel.trials.reader import Columns, read_trials
    from circuits.anatomy import load_circuit
    from circuits.circuit import Circuit

LAZY = {
    "BasalGanglia": "bgmodel.integrators.basal_ganglia",
    "Circuit": "circuits.circuit",
    "Condition": "bgmodel.conditions",
    "Exam": "bgmodel.exam.exam",
    "Experiment": "bgmodel.experiments.experiment",
    "EdgeDirection": "bgmodel.tactile.task",
    "EdgeTurn": "bgmodel.tactile.task",
    "Orientation": "bgmodel.tactile.task",
    "SameDifferent": "bgmodel.tactile.task",
    "load_taps": "bgmodel.tactile.source",
    "StopTask": "bgmodel.stopping.task",
    "Sweep": "bgmodel.sweeps.sweep",
    "take_exam": "bgmodel.exam.exam",
    "compare": "bgmodel.comparison.compare",
    "compare_fits": "bgmodel.fitting.model_comparison",
    "discriminate": "bgmodel.discriminating.discriminate",
    "explore": "bgmodel.explorer.notebook",
    "fit": "bgmodel.fit_trials",
    "learn": "bgmodel.learning.from_reward",
    "load": "bgmodel.support.saved",
    "load_circuit": "circuits.anatomy",
    "load_decoder": "bgmodel.tactile.decoder",
    "read_trials": "bgmodel.trials.reader",
    "Columns": "bgmodel.trials.reader",
    "simulate": "bgmodel.fit_trials",
    "simulate_taps": "bgmodel.tactile.sensor",
    "touch": "bgmodel.from_taps",
    "train_decoder": "bgmodel.tactile.decoder",
    "read_evidence": "bgmodel.trials.evidence_table",
}
"""Names whose modules load circuits and pandas; they are imported on first access."""

__all__ = [
    "BasalGanglia",
    "BgmodelWarning",
    "Circuit",
    "Columns",
    "Condition",
    "Decision",
    "EdgeDirection",
    "EdgeTurn",
    "Evidence",
    "Exam",
    "Experiment",
    "Gaussian",
    "InputError",
    "Msprt",
    "Orientation",
    "SameDifferent",
    "Sprt",
    "StopTask",
    "Sweep",
    "Trace",
    "__version__",
    "compare",
    "compare_fits",
    "discriminate",
    "explore",
    "first_crossing",
    "fit",
    "gaussian_evidence",
    "learn",
    "load",
    "load_circuit",
    "load_decoder",
    "load_taps",
    "read_evidence",
    "read_trials",
    "simulate",
    "simulate_taps",
    "stream",
    "take_exam",
    "threshold_from_posterior",
    "touch",
    "train_decoder",
]

if not TYPE_CHECKING:  # otherwise mypy would accept any attribute name

    def __getattr__(name: str) -> Any:
        """Import and return a lazily loaded name."""
        from importlib import import_module

        if name not in LAZY:
            raise AttributeError(f"module 'bgmodel' has no attribute {name!r}")
        loaded = getattr(import_module(LAZY[name]), name)
        globals()[name] = loaded
        return loaded

    def __dir__() -> list[str]:
        return sorted(__all__)
