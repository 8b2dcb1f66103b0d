"""Command that runs all tactile steps for one sensor, from taps to decisions."""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from tyro.conf import Positional

from bgmodel.commands.checks import Shows, check_idle, check_whole, options_of, say
from bgmodel.commands.taps import Asks, Decode, Simulate, Train, TrainingOptions
from bgmodel.support import files
from bgmodel.support.checks import whole
from bgmodel.tactile.grating import PERIODS_MM
from bgmodel.tactile.sensor import Nuisance
from bgmodel.tactile.skin import Skin
from bgmodel.tactile.source import Tactile
from bgmodel.tactile.task import tactile_task
from bgmodel.tactile.tips import Tip
from bgmodel.version import __version__
from circuits.errors import InputError


@dataclass(frozen=True)
class Touch(Asks, Shows):
    """Go from a sensor's taps to decisions, summarised on a single page.

    Taps are simulated on gratings or read from your recordings; a decoder is trained and read out,
    and its readings drive the decisions. Finished steps are kept in the folder, and the same
    command resumes where it stopped.

    Examples: bgmodel touch;
    bgmodel touch mine --training my_taps/csv_train --held-out my_taps/csv_val --mm-per-px 0.33
    """

    folder: Positional[Path] = Path("touch")
    """Folder for all files; the page is index.html."""
    training: Path | None = None
    """Folder of recorded taps of an edge, to train the decoder on."""
    held_out: Path | None = None
    """Folder of other recorded taps, used as evidence."""
    mm_per_px: float | None = None
    """Scale of recordings, mm per pixel."""
    task: Literal["same-different", "orientation", "edge-turn", "edge-direction"] | None = None
    """The task; by default same-different for gratings, edge-turn for an edge."""
    taps: int = 1000
    """Simulated taps of each grating, to train the decoder on."""
    held_out_taps: int = 1200
    """Simulated taps of each grating and yaw, used as evidence."""
    epochs: int | None = None
    """Maximum number of training epochs; by default 8 on gratings, 20 on an edge."""
    trials: int = 1200
    """Number of trials on which the test and the circuit decide."""
    folds: int = 10
    """Number of folds of taps: likelihoods are fitted on all but one, trials are drawn from that
    one, and intervals resample folds, for which ten or more are needed."""
    step_ms: float = 50.0
    """Time between readings, ms."""
    workers: int = 2
    """Number of processes and threads; does not affect the results."""
    seed: int = 0
    tip: Tip = field(default_factory=Tip)
    skin: Skin = field(default_factory=Skin)
    nuisance: Nuisance = field(default_factory=Nuisance)

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.from_taps import page, touch

        self._check()
        self.folder.mkdir(parents=True, exist_ok=True)
        decoded = self._decoded()
        say(f"deciding on {self.trials} trials, learning gap and threshold, and deciding in spikes")
        task = self._task
        found = touch(
            self._asked(),
            decoded,
            trials=self.trials,
            folds=self.folds,
            step_ms=self.step_ms,
            seed=self.seed,
            workers=self.workers,
        )
        stimulus = f"{self.period_mm:g} mm" if self._grating else f"{self.step_deg:g} degrees"
        title = f"{self._sensor}: {task}, {self.channels} alternatives, {stimulus}"
        made = f"bgmodel {__version__}, seed {self.seed}, decoder and taps: {decoded.name}"
        with files.replacing(self.folder / "index.html") as partial:
            partial.write_text(page(found, title, made), encoding="utf-8")
        behind: dict[str, Any] = {"command": options_of(self)}
        for name in ("psychometric", "curves", "table", "learned"):
            path = self.folder / f"{name}.csv"
            files.write_table(getattr(found, name), path, seed=self.seed, **behind)
        for remark in found.remarks:
            self.note(f"warning: {remark}")
        text = found.summary().to_string(index=False, header=False, float_format="{:.3f}".format)
        if len(found.learned):
            text += f"\nat what reward taught\n{found.learned_summary().to_string(index=False)}"
        self.show(f"{title}\n{text}\n-> {self.folder / 'index.html'}", found.summary())

    @property
    def _grating(self) -> bool:
        return self.training is None

    @property
    def _task(self) -> str:
        return self.task or ("same-different" if self._grating else "edge-turn")

    def _asked(self) -> Tactile:
        """Return the task."""
        stimulus = {"period_mm": self.period_mm, "step_deg": self.step_deg}
        return tactile_task(self._task, self.channels, **stimulus)

    @property
    def _simulated(self) -> dict[str, Any]:
        return {"tip": self.tip, "skin": self.skin, "nuisance": self.nuisance}

    @property
    def _sensor(self) -> str:
        return "Simulated TacTip" if self.training is None else f"Recordings {self.training.name}"

    def _check(self) -> None:
        """Refuse contradictory options before long work starts."""
        check_whole(taps=self.taps, held_out_taps=self.held_out_taps, trials=self.trials)
        whole("folds", self.folds, 2)
        if (self.training is None) != (self.held_out is None):
            raise InputError(
                "recordings need two folders: training, and held_out taps used as evidence",
                "held_out" if self.held_out is None else "training",
            )
        if self._task.startswith("edge") == self._grating:
            made_of = "an edge: give recordings" if self._grating else "gratings"
            raise InputError(f"task {self._task} needs taps of {made_of}", "task", self._task)
        if self._task == "same-different" and self.channels != 2:
            raise InputError("same-different has 2 alternatives", "channels", self.channels)
        if self.training is not None:
            for name in ("training", "held_out"):
                if not (path := getattr(self, name)).is_dir():
                    raise InputError(f"{name}: there is no folder {str(path)!r}", name, path)
            if self.mm_per_px is None:
                raise InputError(
                    "recordings need their scale: --mm-per-px, mm per pixel", "mm_per_px"
                )
            idle = ["taps", "held_out_taps", "period_mm", *self._simulated]
            check_idle(self, idle, "recordings")
        else:
            check_idle(self, ["mm_per_px", "step_deg"], "simulated taps of gratings")
            if self.period_mm not in PERIODS_MM:
                raise InputError.of("period_mm", f"must be one of {PERIODS_MM}", self.period_mm)
        self._asked()

    def _decoded(self) -> Path:
        """Return the table of decoded held-out taps; existing results are used."""
        steps = _Steps(self.folder)
        decoder, decoded = self.folder / "decoder.safetensors", self.folder / "decoded.parquet"
        epochs: Any = self.epochs
        fit: dict[str, Any] = {"training": TrainingOptions(epochs=epochs)}
        if self.training is not None and self.held_out is not None:
            own: dict[str, Any] = {"edge": True, "mm_per_px": self.mm_per_px}
            steps.make(decoder, Train(self.training, decoder, seed=self.seed, **fit, **own))
            steps.make(decoded, Decode(decoder, self.held_out, decoded, **own))
            return decoded
        training, held_out = self.folder / "training.npz", self.folder / "held_out.npz"
        yaws = self._asked().yaws_deg  # type: ignore[attr-defined]
        sensor: dict[str, Any] = {**self._simulated, "workers": self.workers, "seed": self.seed}
        steps.make(training, Simulate(training, taps=self.taps, **sensor))
        steps.make(decoder, Train(training, decoder, seed=self.seed, **fit))
        each = self.held_out_taps * len(yaws)
        steps.make(held_out, Simulate(held_out, taps=each, yaw_deg=yaws, **sensor))
        steps.make(decoded, Decode(decoder, held_out, decoded))
        return decoded


class _Steps:
    """Record of the finished files in a folder and the commands that made them."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "steps.json"
        self.known: dict[str, Any] = {}
        with suppress(OSError, ValueError, TypeError):  # damaged: all is made again
            self.known = dict(files.from_json(self.path.read_bytes()))

    def make(self, path: Path, command: Simulate | Train | Decode) -> None:
        """Make a file, unless the same command has already made it from the same inputs."""
        folders = [str(v.resolve()) for v in vars(command).values() if _is_folder(v)]
        seed = getattr(command, "seed", None)
        step = [__version__, type(command).__name__, options_of(command), folders, seed]
        step = json.loads(json.dumps(step))
        if path.is_file() and self.known.get(path.name) == [*step, files.checksum(path)]:
            say(f"{path} already exists")
            return
        command()
        self.known[path.name] = [*step, files.checksum(path)]
        with files.replacing(self.path) as partial:
            partial.write_text(json.dumps(self.known, indent=1), encoding="utf-8")


def _is_folder(value: Any) -> bool:
    return isinstance(value, Path) and value.is_dir()
