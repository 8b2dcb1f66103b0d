"""Commands that go from taps to decisions and to what reward teaches, also as taps arrive."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from cyclopts import Parameter

from bgmodel import from_taps
from bgmodel.commands.options import FLAT, MANY, TASK, Edited, Workers, like, task, task_of
from bgmodel.commands.output import (
    Files,
    Output,
    check_idle,
    check_whole,
    made_with,
    options_of,
    say,
)
from bgmodel.commands.touch_steps import Scale, check_settings, decode, simulate, train
from bgmodel.conditions import Setup
from bgmodel.from_images import COLUMNS, Watched
from bgmodel.names import MACAQUE, EngineName
from bgmodel.support import __version__, files
from bgmodel.tactile.decoder import Training
from bgmodel.tactile.pressing import PERIODS_MM
from bgmodel.tactile.source import Tactile, check_taps_per_yaw
from bgmodel.tactile.task import EdgeDirection, EdgeTurn, SameDifferent
from bgmodel.task import Task
from circuits.declaration.edits import Edits
from circuits.errors import InputError, require

USUAL = "same-different, or edge-turn with recordings"
LEARNED = (
    "at what reward taught, with 95 % intervals (criterion: nats of OUT; cost: readings; regret, "
    "above_test: %)"
)


@like(from_taps.touch, "trials", "folds", "seed")
@like(Setup, "circuit", "gain")
def touch(
    folder: Path = Path("touch"),
    /,
    *,
    recordings: Path | None = None,
    held_out: Path | None = None,
    mm_per_px: Scale = None,
    task: Annotated[tuple[str, ...], MANY, Parameter(help=f"{TASK} By default {USUAL}.")] = (),
    taps: int = 1000,
    held_out_taps: int = 1200,
    edits: Edited = Edits(),  # noqa: B008
    workers: Workers = 2,
    output: Annotated[Output, FLAT] = Output(),  # noqa: B008
    **options: Any,
) -> None:
    """Go from a sensor's taps to decisions, and to what reward teaches, on a single page.

    Taps are simulated on gratings or read from your recordings; a decoder is trained and read out,
    and its readings drive the decisions of the test and of the spiking circuit. Finished steps are
    kept in the folder, and the same command resumes where it stopped. Files there that it has not
    made, or with other settings, are overwritten only by --force.

    Examples: bgmodel touch;
    bgmodel touch mine --recordings my_taps/csv_train --held-out my_taps/csv_val --mm-per-px 0.33

    Parameters
    ----------
    folder
        Folder for all files; the page is index.html.
    recordings
        Folder of recorded taps of an edge, to train the decoder on.
    held_out
        Folder of other recorded taps, used as evidence.
    taps
        Simulated taps of each grating, to train the decoder on.
    held_out_taps
        Simulated taps of each grating and yaw, used as evidence.
    """
    grating, who = recordings is None, "Simulated TacTip"
    asked: Any = task_of(SameDifferent() if grating else EdgeTurn(), task)
    setup = {name: options.pop(name) for name in ("circuit", "gain")} | {"edits": edits}
    output.check(task=asked, recordings=recordings, held_out=held_out, **setup)
    check_whole(taps=taps, held_out_taps=held_out_taps, workers=workers)
    _check(asked, recordings, held_out, mm_per_px)
    model = Setup(**setup).model(len(asked.names))
    from_taps.check(asked, model, options["trials"], options["folds"])
    check_settings(asked, {"channels", "period_mm", "step_deg", "a_deg", "b_deg", "first_deg"})
    usual = {"mm_per_px": None} if grating else {"taps": 1000, "held_out_taps": 1200}
    given = {"mm_per_px": mm_per_px, "taps": taps, "held_out_taps": held_out_taps}
    check_idle("simulated taps" if grating else "recordings", given | usual, **given)
    seed = options["seed"]
    image: dict[str, Any] = {"edge": not grating, "mm_per_px": mm_per_px}
    places = {"recordings": recordings, "held_out": held_out, "mm_per_px": mm_per_px}
    source: dict[str, Any] = given if grating else places
    everything = {"task": asked, **source, **setup, **options}
    steps = []
    if recordings is not None and held_out is not None:
        who = f"Recordings {recordings.name}"
    else:
        Training().held_out(taps * len(PERIODS_MM))
        check_taps_per_yaw(held_out_taps, asked, options["folds"])
        yaws, same = asked.yaws_deg, {"periods_mm": PERIODS_MM, "seed": seed, "workers": workers}
        tapped = {"taps": held_out_taps * len(yaws), "yaw_deg": yaws, **same}
        recordings, held_out = folder / "training.npz", folder / "held_out.npz"
        steps += [
            Step(recordings, simulate, (), {"taps": taps, "yaw_deg": (), **same}),
            Step(held_out, simulate, (), tapped),
        ]
    decoder, decoded = folder / "decoder.safetensors", folder / "decoded.parquet"
    steps += [
        Step(decoder, train, (recordings,), {"seed": seed, **image}),
        Step(decoded, decode, (decoder, held_out), {} if grating else image),
    ]
    page = Step(folder / "index.html", touch, (), everything)
    files.check_writable(folder)
    for each in (*steps, page):
        each.check(output.force)
    try:
        for each in steps:
            each.make()
        say(f"deciding on {options['trials']} trials, learning from reward, and deciding in spikes")
        touched = from_taps.touch(asked, decoded, model, workers=workers, **options)
        title = f"{who}: {asked.text}"
        made = f"bgmodel {__version__}, {model.circuit.name}, seed {seed}, decoder and taps: "
        made += decoded.name
        with files.replacing(page.path) as partial:
            partial.write_text(from_taps.page(touched, title, made), encoding="utf-8")
            files.checksum_entry(page.path, page.key).put(files.checksum(partial))
    except KeyboardInterrupt:
        kept = "Finished steps are kept: the same command resumes there."
        raise KeyboardInterrupt(kept) from None
    for remark in touched.remarks:
        output.note(f"warning: {remark}")
    text = touched.summary().to_string(index=False, header=False, float_format="{:.4g}".format)
    if len(touched.learned):
        text += f"\n{LEARNED}\n{touched.learned_summary().to_string(index=False)}"
    output.show(f"{title}\n{text}\n-> {page.path}", touched.summary())
    output.write(touched.to_dataframe(), seed, command=options_of(**everything))
    output.draw(touched.plot)


def _check(
    task: Any, recordings: Path | None, held_out: Path | None, mm_per_px: float | None
) -> None:
    """Refuse contradictory options before long work starts."""
    if (recordings is None) != (held_out is None):
        raise InputError(
            "recordings need two folders: recordings, and held_out taps used as evidence",
            "held_out" if held_out is None else "recordings",
        )
    require(isinstance(task, Tactile), "task", "must be a tactile task", task.name)
    if (task.stimulus == "edge") == (recordings is None):
        made_of = "an edge: give recordings" if recordings is None else "gratings"
        raise InputError(f"task {task.name} needs taps of {made_of}", "task", task.name)
    if recordings is None:
        period: Any = getattr(task, task.main)
        require(period in PERIODS_MM, "period_mm", f"must be one of {PERIODS_MM}", period)
        return
    for name, path in (("recordings", recordings), ("held_out", held_out)):
        if path is not None and not path.is_dir():
            raise InputError(f"{name}: there is no folder {str(path)!r}", name, path)
    require(mm_per_px is not None, "mm_per_px", "must give the scale of recordings", None)


@dataclass(frozen=True)
class Step:
    """A file, and the command that makes it from others."""

    path: Path
    command: Callable[..., None]
    inputs: tuple[Path, ...]
    options: dict[str, Any]

    @property
    def key(self) -> list[Any]:
        """All that the file depends on."""
        read = [files.recorded(each) for each in self.inputs]
        places = [str(each.resolve()) for each in self.inputs if each.is_dir()]
        seed = self.options.get("seed")
        return [self.command.__name__, options_of(**self.options), read, places, seed]

    def check(self, force: bool) -> None:
        """Raise ValueError for another file of this name; ``force`` allows it to be overwritten."""
        files.check_new(self.path, force=True)
        there = self.path.exists() or self.path.is_symlink()
        if there and not force and not files.made_by(self.path, self.key):
            raise InputError(
                f"{str(self.path)!r} was not made by this command with these settings: give "
                "another folder, or --force to overwrite it",
                "folder",
            )

    def make(self) -> None:
        """Make the file, unless the same command has made it from the same inputs."""
        made = {**self.options, "output": Files(save=self.path, force=True)}
        if not files.made_once(self.path, self.key, lambda: self.command(*self.inputs, **made)):
            say(f"{self.path} already exists")


ARRIVING = EdgeDirection(step_ms=100.0, t_max=60)
"""Default task: a reading every 100 ms; at the last one a response is forced."""
SPIKES = EngineName("spikes")


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
        Engine of the circuit: spikes, population or rate.
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
