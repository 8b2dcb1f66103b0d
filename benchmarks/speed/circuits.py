"""Comparison of the engines, and scaling of the compiled one: make benchmark.

Every measurement runs in a separate process, in turn and in rounds, so that other load on the
machine affects all equally. Costs are minima over rounds; an engine is compared with runs of the
spikes engine just before and after it, by the median over rounds; scaling is a mean of two, with
2 000 trials per point at least. CPU time of the run only: it excludes compiling and building
Brian2's networks, and includes wiring in the spikes engine. Cost: CPU ns per cell and tick.
"""

from __future__ import annotations

import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from figures.rooms import OUT

STEP_MS, STEPS, SETTLE_MS = 50.0, 10, 0.0
REPEATS = 3
ROUNDS = 5
"""Of the engines side by side."""
TRIALS_IN_ALL = 2000
"""Minimum number of trials per point of the curve of cost against trials."""


def drive(trials: int, channels: int) -> Any:
    """Return evidence that grows for one channel, (trials, STEPS, channels) nats."""
    values = np.zeros((trials, STEPS, channels))
    values[:, :, 0] = np.linspace(0, 2, STEPS)
    return values - values.mean(axis=2, keepdims=True)


def circuit_of(
    neurons: int = 300, channels: int = 2, connections: float = 1.0, heterogeneity: float = 0.0
) -> Any:
    """Return the circuit that is measured."""
    from circuits.anatomy import spiking_msprt

    circuit = spiking_msprt(channels).with_neurons(neurons).with_heterogeneity(heterogeneity)
    return circuit.with_connections(connections) if connections < 1 else circuit


def cells_of(circuit: Any) -> int:
    """Return the spiking cells of a circuit."""
    return sum(
        row.neurons * circuit.channels_of(row.name) for row in circuit.populations if row.spiking
    )


def spikes(trials: int = 100, workers: int = 1, times: int = 1, **which: Any) -> dict[str, float]:
    """Measure the compiled engine, averaged over repetitions."""
    from circuits.engines import Spikes

    engine = Spikes(settle_ms=SETTLE_MS, workers=workers, rates=False)
    return _compiled(engine, circuit_of(**which), trials, times)


def population(trials: int = 5000, **which: Any) -> dict[str, float]:
    """Measure the population engine, as if each of its cells had ticks of 0.1 ms."""
    from circuits.engines import Populations

    return _compiled(Populations(settle_ms=SETTLE_MS, rates=False), circuit_of(**which), trials)


def _compiled(engine: Any, circuit: Any, trials: int, times: int = 1) -> dict[str, float]:
    """Measure an engine of compiled code, which is compiled before."""
    settings = {"step_ms": STEP_MS, "seed": 1}
    engine.run(circuit, drive(1, circuit.channels), **settings)
    evidence = drive(trials, circuit.channels)
    wall, cpu = time.perf_counter(), time.process_time()
    for _ in range(times):
        engine.run(circuit, evidence, **settings)
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    return _cost(cells_of(circuit), trials, cpu / times, wall / times)


def brian2(trials: int = 20, **which: Any) -> dict[str, float]:
    """Measure the Brian2 engine, all trials in one network."""
    from circuits.engines import Brian2

    circuit = circuit_of(**which)
    engine, settings = Brian2(settle_ms=SETTLE_MS), {"step_ms": STEP_MS, "seed": 1}
    evidence = drive(trials, circuit.channels)
    engine.run(circuit, evidence[:, :1], **settings)
    one = _timed(lambda: engine.run(circuit, evidence[:, :1], **settings))
    more = _timed(lambda: engine.run(circuit, evidence, **settings))
    # What building takes is in both runs, and drops out of their difference.
    share = (STEPS - 1) / STEPS
    return _cost(cells_of(circuit), trials, (more - one) / share, (more - one) / share)


def vanilla(target: str = "cython", **which: Any) -> dict[str, float]:
    """Measure plain Brian2: one trial, all synapses."""
    import brian2 as b2

    from benchmarks.speed.vanilla import network

    circuit = circuit_of(**which)
    b2.defaultclock.dt = 0.1 * b2.ms
    if target == "standalone":
        folder = tempfile.mkdtemp()
        b2.set_device("cpp_standalone", directory=folder)
        net, cells = network(b2, circuit)
        net.run(STEPS * STEP_MS * b2.ms)
        # The loop over ticks alone, one thread: making synapses is not in it.
        seconds = b2.device._last_run_time
        return _cost(cells, 1, seconds, seconds)
    b2.prefs.codegen.target = target
    net, cells = network(b2, circuit)
    net.run(10 * b2.ms)
    few = _timed(lambda: net.run(50 * b2.ms))
    more = _timed(lambda: net.run(1050 * b2.ms))
    # What starting a run takes is in both, and drops out.
    return _cost(cells, 1, more - few, more - few, 1000.0)


def nengo() -> dict[str, float]:
    """Measure nengo's basal ganglia on its own network, dt 1 ms."""
    import nengo as ng

    with ng.Network(seed=1) as model:
        source = ng.Node([0.8, 0.3])
        nuclei = ng.networks.BasalGanglia(dimensions=2)
        ng.Connection(source, nuclei.input)
    with ng.Simulator(model, progress_bar=False) as simulator:
        simulator.run(0.1)
        seconds = _timed(lambda: simulator.run(1.0))
    return _cost(model.n_neurons, 1, seconds, seconds, 1000.0, dt_ms=1.0)


def _timed(work: Any) -> float:
    start = time.process_time()
    work()
    return time.process_time() - start


def _cost(
    cells: int,
    trials: int,
    cpu_s: float,
    wall_s: float,
    run_ms: float = STEPS * STEP_MS,
    dt_ms: float = 0.1,
) -> dict[str, float]:
    return {
        "cells": cells,
        "trials": trials,
        "cpu_s": cpu_s,
        "wall_s": wall_s,
        "ns_per_cell_tick": 1e9 * cpu_s / (cells * trials * run_ms / dt_ms),
        "trial_s_per_cpu_s": trials * run_ms / 1000 / cpu_s,
    }


MEASURED: tuple[Callable[..., Any], ...] = (spikes, population, brian2, vanilla, nengo)
KINDS = {each.__name__: each for each in MEASURED}
SIDE_BY_SIDE: list[tuple[str, str, dict[str, Any]]] = [
    ("spikes", "spikes", {"trials": 300}),
    ("spikes, 10 % heterogeneity", "spikes", {"trials": 300, "heterogeneity": 0.1}),
    ("spikes, 25 % connections", "spikes", {"trials": 300, "connections": 0.25}),
    ("spikes, both", "spikes", {"trials": 300, "heterogeneity": 0.1, "connections": 0.25}),
    ("population", "population", {}),
    ("spikes, 3 000 cells", "spikes", {"trials": 30, "neurons": 3000}),
    ("population, 3 000 cells", "population", {"neurons": 3000}),
    ("Brian2 engine", "brian2", {}),
    ("vanilla Brian2, standalone", "vanilla", {"target": "standalone"}),
    ("vanilla Brian2, cython", "vanilla", {"target": "cython"}),
    ("nengo, its own network", "nengo", {}),
]
SCALING: list[tuple[str, str, dict[str, Any]]] = [
    *[
        ("trials", "spikes", {"trials": n, "times": -(-TRIALS_IN_ALL // n)})
        for n in (100, 300, 1000, 3000, 10_000)
    ],
    *[("neurons", "spikes", {"neurons": n}) for n in (100, 300, 1000, 3000)],
    *[("alternatives", "spikes", {"channels": n}) for n in (2, 4, 8, 12)],
]


def measure(kind: str, options: dict[str, Any]) -> dict[str, float]:
    """Measure once, in a separate process; add its peak memory, MB."""
    return alone("benchmarks.speed.circuits", kind, json.dumps(options))


def alone(module: str, *arguments: str) -> dict[str, float]:
    """Return what a module measures in a process of one thread; RuntimeError if it fails."""
    command = [sys.executable, "-m", module, *arguments]
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    done = subprocess.run(
        command, capture_output=True, text=True, env=os.environ | threads, check=False
    )
    if done.returncode:
        raise RuntimeError(f"{' '.join(arguments)} failed:\n{done.stderr[-2000:]}")
    return json.loads(done.stdout.splitlines()[-1])


def processes() -> dict[str, float]:
    """Return how much more two processes do than one, in wall time."""
    command = [sys.executable, "-m", "benchmarks.speed.circuits", "spikes", '{"trials": 300}']
    one = min(measure("spikes", {"trials": 300})["wall_s"] for _ in range(REPEATS))
    two = np.inf
    for _ in range(REPEATS):
        started = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(2)]
        walls = [json.loads(p.communicate()[0].splitlines()[-1])["wall_s"] for p in started]
        two = min(two, max(walls))
    threads = min(
        measure("spikes", {"trials": 600, "workers": 2})["wall_s"] for _ in range(REPEATS)
    )
    return {"two_processes": 2 * one / two, "two_threads": 2 * one / threads}


def machine() -> str:
    """Describe the machine in a line."""
    flags = ""
    name = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        text = info.read_text()
        flags = next((line for line in text.splitlines() if line.startswith("flags")), "")
        model = next((line for line in text.splitlines() if line.startswith("model name")), "")
        name = model.partition(":")[2].strip() or name
    best = next((f for f in ("avx512f", "avx2", "sse4_2") if f in flags.split()), "?")
    return f"{name}, {os.cpu_count()} CPUs, {best}, Python {platform.python_version()}"


def side_by_side(bar: tqdm) -> pd.DataFrame:
    """Return all rounds: spikes, another engine, spikes, the next engine, and so on."""
    (reference, kind, options), *others = SIDE_BY_SIDE
    rows = []
    for turn in range(ROUNDS):
        for other in others:
            for what, engine, settings in ((reference, kind, options), other):
                rows.append({"round": turn, "what": what, **measure(engine, settings)})
                bar.update()
        rows.append({"round": turn, "what": reference, **measure(kind, options)})
        bar.update()
    return pd.DataFrame(rows)


def held_to_spikes(rounds: pd.DataFrame) -> pd.DataFrame:
    """Return each engine's cost in those of the spikes engine just before and after it."""
    cost = rounds["ns_per_cell_tick"]
    ratio = 2 * cost / (cost.shift(1) + cost.shift(-1))
    others = rounds["what"] != rounds["what"].iloc[0]
    grouped = ratio[others].groupby(rounds["what"][others], sort=False)
    return grouped.agg(["min", "median", "max"]).add_prefix("times_spikes_")


def least(rows: pd.DataFrame, keys: list[str]) -> pd.DataFrame:
    """Return the row of least CPU time of each kind."""
    return rows.sort_values("cpu_s").drop_duplicates(keys)


def main() -> None:
    """Measure everything; print the tables and write them."""
    OUT.mkdir(exist_ok=True)
    plan = SCALING * 2
    with tqdm(total=len(plan) + ROUNDS * (2 * len(SIDE_BY_SIDE) - 1)) as bar:
        rounds = side_by_side(bar)
        rows = []
        for what, kind, options in plan:
            rows.append({"what": what, **options, **measure(kind, options)})
            bar.update()
    rounds.to_csv(OUT / "circuits_rounds.csv", index=False)
    # The spikes engine ran more often than the others: a least of as many.
    once = rounds.drop_duplicates(["round", "what"])
    side = least(once, ["what"]).set_index("what").loc[[name for name, *_ in SIDE_BY_SIDE]]
    side = side.join(held_to_spikes(rounds))
    grown = pd.DataFrame(rows)
    keys = ["what", "trials", "neurons", "channels"]
    cost = grown.groupby(keys, dropna=False)["ns_per_cell_tick"]
    grown["mean_ns_per_cell_tick"] = cost.transform("mean")
    grown = least(grown, keys).sort_values(keys)
    grown.to_csv(OUT / "circuits_scaling.csv", index=False)
    side.to_csv(OUT / "circuits.csv")
    print(machine())
    columns = ["ns_per_cell_tick", *(c for c in side if str(c).startswith("times"))]
    print(side[[*columns, "trial_s_per_cpu_s", "peak_mb"]].round(3).to_string())
    columns = [*keys, "ns_per_cell_tick", "mean_ns_per_cell_tick", "peak_mb"]
    print(grown[columns].round(3).to_string(index=False))
    print({name: round(value, 2) for name, value in processes().items()})


if __name__ == "__main__":
    if len(sys.argv) > 2:
        result = KINDS[sys.argv[1]](**json.loads(sys.argv[2]))
        usage = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
        print(
            json.dumps(
                result | {"peak_mb": usage if sys.argv[1] != "brian2" else max(usage, children)}
            )
        )
    else:
        main()
