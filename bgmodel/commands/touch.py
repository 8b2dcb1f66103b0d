"""The command that goes from taps to decisions and to what reward teaches."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from bgmodel import from_taps
from bgmodel.commands.options import FLAT, MANY, TASK, Workers, like, task_of
from bgmodel.commands.output import (
    Files,
    Output,
    check_idle,
    check_whole,
    options_of,
    recorded,
    say,
)
from bgmodel.commands.touch_steps import (
    NuisanceOption,
    SkinOption,
    TipOption,
    check_settings,
    decode,
    simulate,
    train,
)
from bgmodel.support import files
from bgmodel.support.checks import whole
from bgmodel.tactile.pressing import PERIODS_MM
from bgmodel.tactile.sensor import Nuisance
from bgmodel.tactile.skin import Skin, Tip
from bgmodel.tactile.source import Tactile
from bgmodel.tactile.task import EdgeTurn, SameDifferent
from bgmodel.task import Task
from bgmodel.version import __version__
from circuits.errors import InputError, require

USUAL = "same-different, or edge-turn with recordings"
"""Default task."""


@like(from_taps.touch, "trials", "folds", "step_ms", "seed")
def touch(
    folder: Path = Path("touch"),
    /,
    *,
    recordings: Path | None = None,
    held_out: Path | None = None,
    mm_per_px: float | None = None,
    task: Annotated[tuple[str, ...], MANY, Parameter(help=f"{TASK} By default {USUAL}.")] = (),
    taps: int = 1000,
    held_out_taps: int = 1200,
    epochs: int | None = None,
    tip: TipOption = Tip(),  # noqa: B008
    skin: SkinOption = Skin(),  # noqa: B008
    nuisance: NuisanceOption = Nuisance(),  # noqa: B008
    workers: Workers = 2,
    output: Annotated[Output, FLAT] = Output(),  # noqa: B008
    **options: Any,
) -> None:
    """Go from a sensor's taps to decisions, and to what reward teaches, on a single page.

    Taps are simulated on gratings or read from your recordings; a decoder is trained and read out,
    and its readings drive the decisions of the test and of the spiking circuit. Finished steps are
    kept in the folder, and the same command resumes where it stopped.

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
    mm_per_px
        Scale of recordings, mm per pixel.
    taps
        Simulated taps of each grating, to train the decoder on.
    held_out_taps
        Simulated taps of each grating and yaw, used as evidence.
    epochs
        Maximum number of training epochs; by default 8 on gratings, 20 on an edge.
    """
    grating = recordings is None
    asked: Any = task_of(SameDifferent() if grating else EdgeTurn(), task)
    sensor = {"tip": tip, "skin": skin, "nuisance": nuisance}
    output.check(task=asked, recordings=recordings, held_out=held_out)
    check_whole(taps=taps, held_out_taps=held_out_taps, trials=options["trials"])
    whole("folds", options["folds"], 2)
    _check(asked, recordings, held_out, mm_per_px)
    check_settings(asked, {"channels", "period_mm", "step_deg", "a_deg", "b_deg", "first_deg"})
    if not grating:
        usual = {"taps": 1000, "held_out_taps": 1200, "tip": Tip(), "skin": Skin(),
                 "nuisance": Nuisance()}  # fmt: skip
        check_idle("recordings", usual, taps=taps, held_out_taps=held_out_taps, **sensor)
    folder.mkdir(parents=True, exist_ok=True)
    steps = _Steps(folder)
    epoch = () if epochs is None else (f"epochs={epochs}",)
    seed = options["seed"]
    if recordings is not None and held_out is not None:
        decoded = steps.of_recordings(recordings, held_out, mm_per_px, epoch, seed)
    else:
        sizes = (taps, held_out_taps)
        decoded = steps.of_gratings(asked, sizes, epoch, seed, workers=workers, **sensor)
    say(f"deciding on {options['trials']} trials, learning from reward, and deciding in spikes")
    touched = from_taps.touch(asked, decoded, workers=workers, **options)
    who = "Simulated TacTip" if recordings is None else f"Recordings {recordings.name}"
    title = f"{who}: {asked.text}"
    made = f"bgmodel {__version__}, seed {seed}, decoder and taps: {decoded.name}"
    with files.replacing(folder / "index.html") as partial:
        partial.write_text(from_taps.page(touched, title, made), encoding="utf-8")
    for remark in touched.remarks:
        output.note(f"warning: {remark}")
    text = touched.summary().to_string(index=False, header=False, float_format="{:.3f}".format)
    if len(touched.learned):
        text += f"\nat what reward taught\n{touched.learned_summary().to_string(index=False)}"
    output.show(f"{title}\n{text}\n-> {folder / 'index.html'}", touched.summary())
    simulated = {"taps": taps, "held_out_taps": held_out_taps, **sensor} if grating else {}
    settings = {"task": asked, "recordings": recordings, "held_out": held_out,
                "mm_per_px": mm_per_px, "epochs": epochs, **simulated, **options}  # fmt: skip
    output.write(touched.to_dataframe(), seed, command=options_of(**settings))
    output.draw(touched.plot)


def _check(
    task: Task, recordings: Path | None, held_out: Path | None, mm_per_px: float | None
) -> None:
    """Refuse contradictory options before long work starts."""
    if (recordings is None) != (held_out is None):
        raise InputError(
            "recordings need two folders: recordings, and held_out taps used as evidence",
            "held_out" if held_out is None else "recordings",
        )
    require(isinstance(task, Tactile), "task", "must be a tactile task", task.name)
    assert isinstance(task, Tactile)
    if (task.stimulus == "edge") == (recordings is None):
        made_of = "an edge: give recordings" if recordings is None else "gratings"
        raise InputError(f"task {task.name} needs taps of {made_of}", "task", task.name)
    if recordings is None:
        check_idle("simulated taps", {"mm_per_px": None}, mm_per_px=mm_per_px)
        period: Any = getattr(task, task.main)
        require(period in PERIODS_MM, "period_mm", f"must be one of {PERIODS_MM}", period)
        return
    for name, path in (("recordings", recordings), ("held_out", held_out)):
        if path is not None and not path.is_dir():
            raise InputError(f"{name}: there is no folder {str(path)!r}", name, path)
    if mm_per_px is None:
        raise InputError("recordings need their scale: --mm-per-px, mm per pixel", "mm_per_px")


class _Steps:
    """The steps from taps to their decoded angles, in a folder; finished ones are kept."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.path = folder / "steps.json"
        self.known: dict[str, Any] = {}
        with suppress(OSError, ValueError, TypeError):  # damaged: all is made again
            self.known = dict(files.from_json(self.path.read_bytes()))

    def of_recordings(
        self, recordings: Path, held_out: Path, mm_per_px: float | None, epochs: Any, seed: int
    ) -> Path:
        """Return the table of decoded held-out recordings of an edge."""
        image_options: dict[str, Any] = {"edge": True, "mm_per_px": mm_per_px}
        fit = {"seed": seed, "training": epochs, **image_options}
        decoder = self._make("decoder.safetensors", train, recordings, **fit)
        return self._make("decoded.parquet", decode, decoder, held_out, **image_options)

    def of_gratings(
        self, task: Any, sizes: tuple[int, int], epochs: Any, seed: int, **sensor: Any
    ) -> Path:
        """Return the table of decoded held-out taps, which are simulated at the task's yaws."""
        periods, yaws = PERIODS_MM, task.yaws_deg
        same = {"periods_mm": periods, "seed": seed, **sensor}
        for_training: dict[str, Any] = {"taps": sizes[0], "yaw_deg": (), **same}
        taps = self._make("training.npz", simulate, **for_training)
        fit = {"edge": False, "mm_per_px": None, "seed": seed, "training": epochs}
        decoder = self._make("decoder.safetensors", train, taps, **fit)
        for_testing = {"taps": sizes[1] * len(yaws), "yaw_deg": yaws, **same}
        held_out = self._make("held_out.npz", simulate, **for_testing)
        return self._make("decoded.parquet", decode, decoder, held_out)

    def _make(self, name: str, command: Callable[..., None], *inputs: Path, **options: Any) -> Path:
        """Return a file, made unless the same command has made it from the same inputs."""
        path = self.folder / name
        places = [str(each.resolve()) for each in inputs if each.is_dir()]
        read = [recorded(each) for each in inputs]
        made = [__version__, command.__name__, options_of(**options), read, places]
        step = [*made, options.get("seed")]
        step = json.loads(json.dumps(step))
        if path.is_file() and self.known.get(name) == [*step, files.checksum(path)]:
            say(f"{path} already exists")
            return path
        command(*inputs, **options, output=Files(save=path, force=True))
        self.known[name] = [*step, files.checksum(path)]
        with files.replacing(self.path) as partial:
            partial.write_text(json.dumps(self.known, indent=1), encoding="utf-8")
        return path
