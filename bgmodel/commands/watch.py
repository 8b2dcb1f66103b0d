"""The command that decides on images of taps as they arrive in a folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd

from bgmodel.commands.options import FLAT, like, task
from bgmodel.commands.output import Files, check_idle, made_with, options_of, say
from bgmodel.conditions import Setup
from bgmodel.from_images import COLUMNS, Watched
from bgmodel.names import MACAQUE, EngineName
from bgmodel.support import files
from bgmodel.tactile.source import Tactile
from bgmodel.tactile.task import EdgeDirection
from bgmodel.task import Task
from circuits.errors import require

ARRIVING = EdgeDirection(step_ms=100.0, t_max=60)
"""Default task: a reading every 100 ms; at the last one a response is forced."""
SPIKES = EngineName("ensemble")


@like(Setup, "circuit", "seed")
@like(Watched, "decoder", "taps", "mm_per_px", "posterior", "first_deg", "idle_s")
def watch(
    folder: Path,
    /,
    *,
    task: Annotated[Task, task(ARRIVING)] = ARRIVING,
    by: Literal["circuit", "test"] = "circuit",
    engine: EngineName = SPIKES,
    output: Annotated[Files, FLAT] = Files(),  # noqa: B008
    **options: Any,
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
    by
        Decision maker: the circuit or the test.
    engine
        Engine of the circuit: ensemble (spikes), population or rate.
    """
    output.unused("plot")
    output.check(folder=folder, **options)
    circuit, seed = options.pop("circuit"), options.pop("seed")
    if by == "test":
        usual = {"circuit": MACAQUE, "engine": SPIKES}
        check_idle("--by test", usual, circuit=circuit, engine=engine)
    require(isinstance(task, Tactile), "task", "must be a tactile task", task.name)
    assert isinstance(task, Tactile)
    model = None
    if by == "circuit":
        model = Setup(circuit, engine=engine, seed=seed).model(len(task.names))
    watched = Watched(folder=folder, task=task, model=model, skipped=say, **options)
    session = watched.session
    say(f"watching {folder}; stops {watched.idle_s:g} s after the last image")
    rows: list[dict[str, Any]] = []
    try:
        for row in watched.decisions():
            rows.append(row)
            forced = ", forced" if row["forced"] else ""
            after = f"after {row['readings']} readings, {row['time_ms']:.0f} ms{forced}"
            print(f"trial {row['trial']}: {row['choice']} {after}", flush=True)
    finally:  # write the decisions even if interrupted
        if output.save is not None:
            settings = {"folder": folder, "task": task, "by": by, **options}
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
