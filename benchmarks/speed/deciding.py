"""The exhaustive search beside plain numpy and ssm-simulators on the same work: make benchmark.

The work: Gaussian evidence of separation d = 0.5 a reading, at most 30 readings, every gap in
0, 0.1, ... 8 nats.  Here and in numpy all gaps see the same trials, whose evidence is drawn
before; ssm-simulators draws its own inside, and runs one gap at a time.  CPU seconds of one
process, best of three, scaled to 1.4 million trials.
"""

from __future__ import annotations

import platform
import time
from collections.abc import Callable

import numpy as np
import pandas as pd

from bgmodel import stream, threshold_from_gap
from bgmodel.evidence import Evidence, gaussian_evidence
from bgmodel.learning.reinforce import exhaustive_search

D, T_MAX, TRIALS = 0.5, 30, 1_400_000
DELTAS = np.linspace(0, 8, 81)


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


def ssm_simulators(trials: int) -> np.ndarray:
    """Return the mean time at each gap from the package's ddm with a time step of one reading."""
    from ssms.basic_simulators.simulator import simulator

    times = []
    for delta in DELTAS:
        theta = max(delta / 2, 1e-6) / D  # in sd of a reading
        out = simulator(
            [D / 2, theta, 0.5, 0.0], model="ddm", n_samples=trials, delta_t=1.0, max_t=T_MAX
        )
        times.append(out["rts"].mean())
    return np.array(times)


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
    few = 20_000
    rng = stream(1, "benchmark")
    evidence = gaussian_evidence(TRIALS, T_MAX, D / np.sqrt(2), rng=rng)
    small = evidence[:few]
    exhaustive_search(small, DELTAS)  # compiles
    thresholds = threshold_from_gap(DELTAS)
    rows = {
        "bgmodel, all gaps in one pass": cpu_seconds(lambda: exhaustive_search(evidence, DELTAS)),
        "numpy, a gap at a time": cpu_seconds(lambda: plain_numpy(small)) * TRIALS / few,
    }
    try:
        rows["ssm-simulators, a gap at a time"] = (
            cpu_seconds(lambda: ssm_simulators(few // 10)) * TRIALS / (few // 10)
        )
    except ImportError:
        print("ssm-simulators is not installed: left out")
    table = pd.DataFrame({"cpu_s": pd.Series(rows)})
    table["ratio"] = table["cpu_s"] / table["cpu_s"].iloc[0]
    table["trials_per_cpu_s"] = TRIALS / table["cpu_s"]
    print(f"{TRIALS} trials, {len(thresholds)} gaps, {platform.processor() or platform.machine()}")
    print(table.round(2).to_string())
    gap = np.abs(exhaustive_search(small, DELTAS).mean_steps - plain_numpy(small)).max()
    print(f"largest difference of mean times from numpy's: {gap:.1e} readings")


if __name__ == "__main__":
    main()
