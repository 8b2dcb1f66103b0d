"""The abstract tests compared with plain numpy, ssm-simulators and PyDDM: make benchmark.

The task: Gaussian evidence with separation d = 0.5 per reading, at most 50 readings, 40 gaps up to
8 nats. Here and in numpy all gaps use the same trials; ssm-simulators draws its own and runs one
gap at a time, and PyDDM solves a diffusion at each gap without simulation. CPU seconds of one
process, best of three, as trials per CPU-second for all gaps together.
"""

from __future__ import annotations

import platform
import time
from collections.abc import Callable

import numpy as np
import pandas as pd

from bgmodel import Msprt, stream
from bgmodel.deciding.reward import tally
from bgmodel.evidence import Evidence
from bgmodel.learning.reinforce import exhaustive_search
from bgmodel.simulated_evidence import separated_evidence

D, T_MAX, FEW = 0.5, 50, 20_000
DELTAS = np.linspace(0.2, 8, 40)
POSTERIORS = np.linspace(0.3, 0.98, 40)
SEPARATION = D / np.sqrt(2)


def plain_numpy(evidence: Evidence) -> np.ndarray:
    """Return the mean time at each gap: one comparison of all of Z a gap."""
    ratio = evidence.log_likelihood[..., 1] - evidence.log_likelihood[..., 0]
    z = np.abs(np.cumsum(ratio, axis=1))
    times = []
    for theta in DELTAS / 2:
        past = z >= theta
        past[:, -1] = True
        times.append(past.argmax(axis=1).mean() + 1)
    return np.array(times)


def ssm_simulators(trials: int) -> None:
    """Simulate the package's ddm with a time step of one reading, at each gap."""
    from ssms.basic_simulators.simulator import simulator

    for delta in DELTAS:
        theta = max(delta / 2, 1e-6) / D  # in sd of a reading
        simulator([D / 2, theta, 0.5, 0.0], model="ddm", n_samples=trials, delta_t=1.0, max_t=T_MAX)


def pyddm() -> None:
    """Solve the diffusion at each gap: a reading is a tenth of its unit of time."""
    import pyddm

    reading = 0.1
    for delta in DELTAS:
        model = pyddm.Model(
            drift=pyddm.DriftConstant(drift=D / 2 / reading),
            noise=pyddm.NoiseConstant(noise=reading**-0.5),
            bound=pyddm.BoundConstant(B=delta / 2 / D),
            dt=0.005,
            dx=0.01,
            T_dur=T_MAX * reading,
        )
        model.solve()


def cpu_seconds(work: Callable[[], object]) -> float:
    """Return the least CPU time of three runs."""
    best = np.inf
    for _ in range(3):
        start = time.process_time()
        work()
        best = min(best, time.process_time() - start)
    return best


def main() -> None:
    """Print the table."""
    evidence = separated_evidence(200_000, T_MAX, SEPARATION, rng=stream(1, "benchmark"))
    small = evidence[:FEW]
    four = separated_evidence(FEW, T_MAX, SEPARATION, rng=stream(1, "four"), hypotheses=4)
    levels = -np.log(POSTERIORS)

    assert four.truth is not None
    exhaustive_search(small, DELTAS)  # compile
    tally(Msprt().run(four[:10]), four.truth[:10], levels)
    work: dict[str, tuple[int, Callable[[], object]]] = {
        "SPRT, evidence given": (evidence.trials, lambda: exhaustive_search(evidence, DELTAS)),
        "MSPRT of 4, evidence given": (FEW, lambda: tally(Msprt().run(four), four.truth, levels)),
        "SPRT in numpy, evidence given": (FEW, lambda: plain_numpy(small)),
    }
    try:
        ssm_simulators(10)
        work["SPRT in ssm-simulators"] = (FEW // 10, lambda: ssm_simulators(FEW // 10))
    except ImportError:
        print("ssm-simulators is not installed: left out")
    rows = [(name, trials / cpu_seconds(made) / 1e6) for name, (trials, made) in work.items()]
    table = pd.DataFrame(rows, columns=["", "million trials per CPU-s"])
    print(
        f"{len(DELTAS)} thresholds, {T_MAX} readings, {platform.processor() or platform.machine()}"
    )
    print(table.round(3).to_string(index=False))
    gap = np.abs(exhaustive_search(small, DELTAS).mean_steps - plain_numpy(small)).max()
    print(f"largest difference of mean times from numpy's: {gap:.1e} readings")
    try:
        print(f"PyDDM solves the {len(DELTAS)} diffusions in {cpu_seconds(pyddm):.2f} CPU-s")
    except ImportError:
        print("PyDDM is not installed: left out")


if __name__ == "__main__":
    main()
