"""The command that decides on images of taps as they arrive in a folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd

from bgmodel.commands.options import FLAT, task
from bgmodel.commands.output import Files, check_idle, made_with, options_of, say
from bgmodel.conditions import Setup
from bgmodel.from_images import COLUMNS, Watched
from bgmodel.names import MACAQUE, CircuitName, EngineName
from bgmodel.support import files
from bgmodel.tactile.source import Tactile
from bgmodel.tactile.task import EdgeDirection
from bgmodel.task import Task
from circuits.errors import require

ARRIVING = EdgeDirection(step_ms=100.0, t_max=60)
"""Default task: a reading every 100 ms; at the last one a response is forced."""
SPIKES = EngineName("ensemble")


def watch(
    folder: Path,
    /,
    *,
    decoder: Path,
    taps: Path,
    mm_per_px: float,
    task: Annotated[Task, task(ARRIVING)] = ARRIVING,
    first_deg: float = 0.0,
    by: Literal["circuit", "test"] = "circuit",
    circuit: CircuitName = MACAQUE,
    engine: EngineName = SPIKES,
    posterior: float = 0.82,
    idle_s: float = 10.0,
    seed: int = 0,
    output: Annotated[Files, FLAT] = Files(),  # noqa: B008
) -> None:
    """Decide on images of taps as they arrive in a folder, with the circuit or the test.

    Each image is decoded and its log-likelihoods are added to the trial. As soon as OUT crosses the
    threshold, the decision is printed and the next trial begins. In a task with two taps, each
    pair of images is one reading. The command ends when no image has arrived for some time.

    Example: bgmodel touch watch camera --save decisions.csv --decoder edge.safetensors
    --taps decoded.parquet --task edge-direction --mm-per-px 0.33

    Parameters
    ----------
    folder
        Folder to which the sensor writes its images; existing images are read first.
    decoder
        A decoder from `bgmodel touch train`.
    taps
        Taps of the same sensor, decoded with it, used to estimate the likelihoods.
    mm_per_px
        Scale of the images, mm per pixel.
    first_deg
        Direction of the first alternative of edge-direction, degrees.
    by
        Decision maker: the circuit or the test.
    circuit
        Name of a circuit table, or path of a .toml file.
    engine
        Engine of the circuit: ensemble (spikes), population or rate.
    posterior
        Posterior at which to decide.
    idle_s
        Stop when no image has arrived for this time, s.
    seed
        Seed of the noise of cells.
    """
    output.unused("plot")
    output.check(folder=folder, decoder=decoder, taps=taps, circuit=circuit)
    if by == "test":
        usual = {"circuit": MACAQUE, "engine": SPIKES}
        check_idle("--by test", usual, circuit=circuit, engine=engine)
    require(isinstance(task, Tactile), "task", "must be a tactile task", task.name)
    assert isinstance(task, Tactile)
    model = None
    if by == "circuit":
        model = Setup(circuit, engine=engine, seed=seed).model(len(task.names))
    watched = Watched(
        folder=folder, decoder=decoder, taps=taps, mm_per_px=mm_per_px, task=task, model=model,
        posterior=posterior, first_deg=first_deg, idle_s=idle_s, skipped=say,
    )  # fmt: skip
    session = watched.session
    say(f"watching {folder}; stops {idle_s:g} s after the last image")
    rows: list[dict[str, Any]] = []
    try:
        for row in watched.decisions():
            rows.append(row)
            forced = ", forced" if row["forced"] else ""
            print(
                f"trial {row['trial']}: {row['choice']} after {row['readings']} readings, "
                f"{row['time_ms']:.0f} ms{forced}",
                flush=True,
            )
    finally:  # write the decisions even if interrupted
        if output.save is not None:
            settings = {"folder": folder, "decoder": decoder, "taps": taps, "mm_per_px": mm_per_px,
                        "task": task, "first_deg": first_deg, "by": by, "posterior": posterior,
                        "idle_s": idle_s}  # fmt: skip
            behind = {"command": options_of(**settings)}
            if model is not None:
                behind = made_with(model, circuit=circuit, engine=engine, **settings)
            table = pd.DataFrame(rows, columns=COLUMNS)
            files.write_table(table, output.save, seed=seed, **behind)
    if session.readings:
        say(f"the last trial ended undecided after {len(session.readings)} steps")
    latency = watched.latency_ms
    middle = f", {np.median(latency):.0f} ms from image to OUT (median)" if latency else ""
    print(f"{len(rows)} decisions on {len(latency)} readings{middle}")
    if output.save is not None:
        print(f"-> {output.save}")
