"""Edits of a circuit, in Python."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import logsumexp

from circuits import anatomy
from circuits.cells import Phase, Rate
from circuits.declaration.rows import Population, Projection
from circuits.engines import run
from tests.fuzzing.case import Case, Rng, pick

GOOD_EDITS: dict[str, Callable[[Any, Rng], Any]] = {
    "lesion": lambda c, rng: c.lesion("STN", rng.uniform(0, 0.1)),
    "replaced": lambda c, rng: c.lesion("GPe", rng.uniform(0, 1), replaced=True),
    "scale": lambda c, rng: c.scale("STN", "GPe", rng.uniform(0.9, 1.1)),
    "dopamine": lambda c, rng: c.dopamine(rng.uniform(0.8, 1.2)),
    "delay": lambda c, rng: c.with_projection("STN", "GPe", delay_ms=int(rng.integers(1, 20))),
    "tau": lambda c, rng: c.with_projection("STN", "GPe", tau_ms=rng.uniform(0, 20)),
    "bias": lambda c, rng: c.with_population("D1", bias_nats=c.population("D1").bias_nats + 0.01),
    "neurons": lambda c, rng: c.with_neurons(int(rng.integers(1, 50))),
    "spread": lambda c, rng: c.with_spread(rng.uniform(0, 0.3)),
    "wires": lambda c, rng: c.with_connections(rng.uniform(0.1, 1)),
    "row": lambda c, rng: c.add(
        Population("TRN", pick(rng, Rate(), Phase(1.0), Phase(0.3)), 10.0),
        Projection("STN", "TRN", rng.uniform(0, 2), delay_ms=2),
    ),
    "text": lambda c, rng: c.edited(f"STN->GPe.tau_ms={rng.uniform(0, 20)}"),
    "row in text": lambda c, rng: c.add(f"STN->D1 weight={rng.uniform(0, 1)}"),
    "cite": lambda c, rng: c.with_population("STN", cite="mine"),
}
BAD_EDITS: dict[str, Callable[[Any, Rng], Any]] = {
    "no nucleus": lambda c, rng: c.lesion("thalamus"),
    "fraction": lambda c, rng: c.lesion("STN", pick(rng, 1.1, -0.1, np.nan, "half", None)),
    "input": lambda c, rng: c.lesion(pick(rng, "ctx", "SNr")),
    "no path": lambda c, rng: c.scale("SNr", "STN", 1.1),
    "factor": lambda c, rng: c.scale("STN", "GPe", pick(rng, -1, np.nan, np.inf, "2")),
    "channel": lambda c, rng: c.scale("D1", "SNr", 1.1, channel=pick(rng, 99, -1, "0")),
    "dopamine": lambda c, rng: c.dopamine(pick(rng, -0.1, 2.1, np.nan, "1")),
    "delay": lambda c, rng: c.with_projection(
        "STN", "GPe", delay_ms=pick(rng, -1, 1e9, "4", np.nan)
    ),
    "sign": lambda c, rng: c.with_projection("D1", "SNr", weight=0.5),
    "weight": lambda c, rng: c.with_projection(
        "STN", "GPe", weight=pick(rng, np.inf, "x", None, True)
    ),
    "text": lambda c, rng: c.edited(pick(rng, "STN.bias_nats", "STN.x=1", "", 3, "X.tau_ms=1")),
    "row in text": lambda c, rng: c.add(pick(rng, "X", "D1->X weight=-1", "X like=Y")),
    "field": lambda c, rng: c.with_population("STN", wieght=1.0),
    "neurons": lambda c, rng: c.with_neurons(pick(rng, 0, 2.5, "3", -1, np.nan)),
    "spread": lambda c, rng: c.with_spread(pick(rng, 5, -1, "a", np.nan)),
    "wires": lambda c, rng: c.with_connections(pick(rng, 0, 1.5, "a", np.nan)),
    "rows": lambda c, rng: c.add(pick(rng, "STN", None, 3, {"name": "a"})),
    "name": lambda c, rng: c.add(Population(pick(rng, "", " ", "a->b", 3), Rate())),
    "twice": lambda c, rng: c.add(c.population("STN")),
    "end": lambda c, rng: c.add(Projection("STN", "thalamus", 1.0)),
    "channels": lambda c, rng: c.with_channels(pick(rng, 0, 1, "2", 2.5, np.nan)),
    "cell": lambda c, rng: c.with_population("STN", cell=pick(rng, "Lif", None, 3)),
    "transfer": lambda c, rng: c.with_population("STN", transfer="cube"),
    "pattern": lambda c, rng: c.with_projection("STN", "GPe", pattern="ring"),
    "gain": lambda c, rng: c.with_population("STN", gain_hz_per_nat=pick(rng, 0, -1, "1", np.nan)),
    "engine": lambda c, rng: run(c, np.zeros((1, 1, c.channels)), engine="pen", step_ms=1.0),
    "spikes": lambda c, rng: run(
        c, np.zeros((1, 1, c.channels)), engine="algebra", step_ms=1.0, spikes=("STN",)
    ),
    "step": lambda c, rng: run(
        c, np.zeros((1, 1, c.channels)), engine="algebra", step_ms=pick(rng, 0, "1", np.nan)
    ),
    "drive": lambda c, rng: run(
        c,
        pick(
            rng, "abc", np.zeros((1, 1)), np.zeros((1, 1, 99)), np.full((1, 1, c.channels), np.nan)
        ),
        engine="algebra",
        step_ms=1.0,
    ),
}


def circuit_edit(rng: Rng, folder: Path) -> Case:
    """Return a circuit, to be edited several times and run at the fixed point."""
    name, channels = pick(rng, *anatomy.CIRCUITS), int(rng.integers(2, 7))
    valid = bool(rng.random() < 0.5)
    good = [pick(rng, *GOOD_EDITS) for _ in range(int(rng.integers(3)))]
    bad = pick(rng, *BAD_EDITS)
    drive = rng.uniform(-0.7, 0.7, (3, 1, channels))
    drive -= drive.mean(axis=2, keepdims=True)
    seed = int(rng.integers(2**31))

    def edited() -> Any:
        own = np.random.default_rng(seed)
        circuit = anatomy.load_circuit(name, channels)
        for edit in good:
            once = edit in ("row", "row in text", "lesion", "replaced") and good.count(edit) > 1
            absent = edit in ("neurons", "spread", "wires") and name != "spiking_msprt"
            circuit = circuit if once or absent else GOOD_EDITS[edit](circuit, own)
        return circuit

    def call() -> Any:
        circuit = edited()
        if not valid:
            return BAD_EDITS[bad](circuit, np.random.default_rng(seed))
        return circuit, run(circuit, drive, engine="algebra", step_ms=1.0).output_nats

    def check(found: Any) -> None:
        circuit, out = found
        assert out.shape == drive.shape
        assert np.isfinite(out).all()
        # Channels are alike: to exchange them exchanges their OUT.
        order = np.random.default_rng(seed).permutation(channels)
        turned = run(circuit, drive[:, :, order], engine="algebra", step_ms=1.0).output_nats
        assert np.abs(turned - out[:, :, order]).max() < 1e-6
        if circuit.exact:
            plain = logsumexp(drive, axis=2, keepdims=True) - drive
            assert np.abs(out - plain).max() < 1e-6

    return Case(valid, call=call, check=check)
