"""Decisions per CPU-second and memory of this package and of other tools: make benchmark.

The task: two alternatives, Gaussian readings every 50 ms with d' = 0.7, a posterior of 0.85. Every
tool runs in a separate process for about a minute of CPU time (``BUDGET_S``), so that its rate is
an extrapolation to a million decisions; populations make the million in full. Spikes of other
tools have no decisions: theirs are the simulated seconds divided by the mean decision time of the
population engine. Diffusions of other tools have the drift of the readings and the bound of the
posterior, in steps of 1 ms; they have no circuit.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.speed.circuits import alone, machine
from benchmarks.speed.circuits import measure as measured_circuit
from figures.rooms import OUT

BUDGET_S, WHOLE = 60.0, 1_000_000
POSTERIOR, D_PRIME, STEP_MS, READINGS = 0.85, 0.7, 50.0, 60
BATCH = {"population": 10_000, "spikes": 100, "msprt": 50_000, "ssms": 20_000, "pyddm": 20}
SEED = 46_201


def _evidence(trials: int, batch: int) -> Any:
    from bgmodel import gaussian_evidence

    settings = {"d_prime": D_PRIME, "step_ms": STEP_MS, "t_max": READINGS, "channels": 2}
    return gaussian_evidence(trials, seed=SEED + batch, **settings)


def _circuit(engine: str) -> Callable[[int, int], float]:
    from bgmodel import BasalGanglia, load_circuit

    model = BasalGanglia(load_circuit("macaque", 2), engine, seed=SEED)
    model.decide(_evidence(64, 0), posterior=POSTERIOR)

    def run(trials: int, batch: int) -> float:
        decided = model.decide(_evidence(trials, batch), posterior=POSTERIOR)
        return float(decided.time_ms.mean())

    return run


def _msprt() -> Callable[[int, int], float]:
    from bgmodel import Msprt, first_crossing

    def run(trials: int, batch: int) -> float:
        decision = first_crossing(Msprt().run(_evidence(trials, batch)), -np.log(POSTERIOR))
        return float(decision.time_ms.mean())

    run(64, 0)
    return run


def _diffusion() -> tuple[float, float]:
    """Return the drift per second and the bound of the log odds, with unit noise."""
    step_s, odds = STEP_MS / 1000, np.log(POSTERIOR / (1 - POSTERIOR))
    # A reading's log odds have the variance d'^2, and half of that as their mean.
    per_s, noise = D_PRIME**2 / 2 / step_s, D_PRIME / np.sqrt(step_s)
    return per_s / noise, float(odds / noise)


def _ssms() -> Callable[[int, int], float]:
    from ssms.basic_simulators.simulator import simulator

    drift, bound = _diffusion()

    def run(trials: int, batch: int) -> float:
        theta = [drift, bound, 0.5, 0.0]
        simulated = simulator(theta, model="ddm", n_samples=trials, delta_t=0.001, max_t=20.0,
                          random_state=SEED + batch)  # fmt: skip
        return 1000 * float(simulated["rts"].mean())

    run(64, 0)
    return run


def _pyddm() -> Callable[[int, int], float]:
    import pyddm

    drift, bound = _diffusion()
    model = pyddm.Model(
        drift=pyddm.DriftConstant(drift=drift),
        noise=pyddm.NoiseConstant(noise=1.0),
        bound=pyddm.BoundConstant(B=bound),
        dt=0.001,
        dx=0.001,
        T_dur=20.0,
    )

    def run(trials: int, batch: int) -> float:
        simulated = model.simulated_solution(size=trials, seed=SEED + batch)
        return 1000 * float(simulated.mean_decision_time())

    return run


TOOLS: dict[str, tuple[str, Callable[[], Callable[[int, int], float]]]] = {
    "population": ("bgmodel, populations", lambda: _circuit("population")),
    "spikes": ("bgmodel, spikes", lambda: _circuit("spikes")),
    "msprt": ("bgmodel, MSPRT", _msprt),
    "ssms": ("ssm-simulators, diffusion", _ssms),
    "pyddm": ("PyDDM, trials of a diffusion (for debugging; it solves them)", _pyddm),
}
NETWORKS = [
    ("Brian2 engine of bgmodel, 20 trials", "brian2", {}),
    ("vanilla Brian2, standalone", "vanilla", {"target": "standalone"}),
    ("vanilla Brian2, cython", "vanilla", {"target": "cython"}),
    ("nengo, its own network", "nengo", {}),
]


def run(tool: str) -> dict[str, float]:
    """Decide in batches until the budget is spent; populations make the whole million."""
    decide, size, made, mean = TOOLS[tool][1](), BATCH[tool], 0, 0.0
    begun = time.process_time()
    while made < WHOLE and (tool == "population" or time.process_time() - begun < BUDGET_S):
        mean += decide(size, made // size + 1)
        made += size
    cpu = time.process_time() - begun
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {
        "decisions": made,
        "cpu_s": cpu,
        "per_cpu_s": made / cpu,
        "mean_ms": mean * size / made,
        "memory_mb": memory,
    }


def _measured(name: str, measure: Callable[..., dict[str, float]], *what: Any) -> dict[str, float]:
    """Return what a tool measures; one that is not installed has no numbers."""
    try:
        return measure(*what)
    except RuntimeError as error:
        print(f"{name}: {str(error).splitlines()[-1]}")
        return {}


def main() -> None:
    """Print and store the table."""
    rows: list[dict[str, Any]] = []
    for tool, (name, _) in TOOLS.items():
        measured = _measured(name, alone, "benchmarks.speed.decisions", tool)
        rows.append({"tool": name, **measured})
    mean_s = rows[0]["mean_ms"] / 1000
    for name, kind, options in NETWORKS:
        if measured := _measured(name, measured_circuit, kind, options):
            per_s = measured["trial_s_per_cpu_s"] / mean_s
            rows.append({"tool": name, "per_cpu_s": per_s, "memory_mb": measured["peak_mb"]})
    table = pd.DataFrame(rows)
    table["million_cpu_s"] = WHOLE / table["per_cpu_s"]
    print(machine())
    print(table.round(2).to_string(index=False))
    table.to_csv(OUT / "speed_decisions.csv", index=False)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        print(json.dumps(run(sys.argv[1])))
    else:
        main()
