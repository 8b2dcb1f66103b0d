"""How fast a circuit takes readings one by one: python -m benchmarks.speed.sessions."""

from __future__ import annotations

import time
import warnings

import numpy as np

from bgmodel import BasalGanglia, load_circuit, stream
from circuits.anatomy import DEFAULT

STEP_MS, READINGS = 100.0, 300
ENGINES = ("spikes", "population", "rate")


def seconds(engine: str) -> np.ndarray:
    """Return how long each of many readings takes in sessions of the default circuit, s."""
    rng = stream(0, "speed of sessions")
    session = BasalGanglia(load_circuit(DEFAULT, 2), engine, seed=1).session(
        posterior=0.82, step_ms=STEP_MS, t_max=60, baseline=0.0
    )
    session.add([0.0, 0.0])  # compiles
    taken = []
    for reading in rng.normal(0, 0.2, (READINGS, 2)):
        if session.decision is not None:
            session.next()
        begun = time.perf_counter()
        session.add(reading)
        taken.append(time.perf_counter() - begun)
    return np.array(taken)


def main() -> None:
    """Print the time per reading, and how many times faster than the sensor that is."""
    for engine in ENGINES:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            taken = seconds(engine)
        middle, late = np.quantile(taken, [0.5, 0.95])
        print(
            f"{engine:<12}{1e3 * middle:6.1f} ms a reading (95 %: {1e3 * late:.1f}), "
            f"{STEP_MS / 1000 / middle:.0f} times real time"
        )


if __name__ == "__main__":
    main()
