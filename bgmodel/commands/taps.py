"""Commands that simulate taps, train a decoder on taps, and decode taps."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from tyro.conf import Positional

from bgmodel.commands.checks import (
    Writes,
    check_ending,
    check_idle,
    check_whole,
    optional,
    options_of,
    say,
)
from bgmodel.support import files
from bgmodel.support.arrays import Reals
from bgmodel.tactile.decoder import Training
from bgmodel.tactile.grating import PERIODS_MM
from bgmodel.tactile.sensor import Nuisance
from bgmodel.tactile.skin import Skin
from bgmodel.tactile.task import Orientation, SameDifferent
from bgmodel.tactile.tips import Tip
from circuits.errors import InputError

if TYPE_CHECKING:
    from bgmodel.tactile.taps import Taps

    TrainingOptions = Training
else:
    TrainingOptions = optional(Training)


@dataclass(frozen=True, kw_only=True)
class Asks:
    """Options of a tactile task, shared by commands that take one."""

    channels: int = 2
    """Number of alternatives, 2..8."""
    period_mm: float = 2.0
    """Period of the grating, mm."""
    step_deg: float = 5.0
    """Angle between neighbouring alternatives of an edge task, degrees."""


@dataclass(frozen=True)
class Simulate(Writes):
    """Tap gratings with the simulated TacTip.

    Examples: bgmodel simulate taps.npz --taps 1000;
    bgmodel simulate held_out.npz --task orientation --channels 4 --taps 400
    """

    output: Positional[Path]
    """File for the taps, .npz."""
    taps: int = 1000
    """Number of taps per grating."""
    periods_mm: tuple[float, ...] = PERIODS_MM
    """Periods of the gratings, mm."""
    yaw_deg: tuple[float, ...] | None = None
    """Yaws, used in turn, degrees; by default those of the task or uniform in -90..90."""
    task: Literal["same-different", "orientation"] | None = None
    """Task for which to simulate held-out taps."""
    channels: int = 2
    """Number of orientations in the orientation task, 2..8."""
    tip: Tip = field(default_factory=Tip)
    skin: Skin = field(default_factory=Skin)
    nuisance: Nuisance = field(default_factory=Nuisance)
    workers: int = 1
    """Number of processes for the contact library; does not affect the results."""
    seed: int = 0

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.tactile.library import to_solve
        from bgmodel.tactile.pressing import LibraryPlan
        from bgmodel.tactile.sensor import check_taps, simulate_taps

        check_whole(taps=self.taps, workers=self.workers)
        check_ending("output", self.output, ".npz")
        if self.task != "orientation":
            check_idle(self, ["channels"], "a task other than orientation")
        check_taps(self.taps, self.periods_mm, self.tip)
        contacts = to_solve(LibraryPlan(skin=self.skin, radius_mm=self.tip.radius_mm))
        first = f"solving {contacts} contacts, once for all runs, and " if contacts else ""
        say(f"{first}simulating {self.taps * len(self.periods_mm)} taps")
        taps = simulate_taps(
            self.taps, self.periods_mm, self._yaws_deg(), seed=self.seed, tip=self.tip,
            skin=self.skin, nuisance=self.nuisance, workers=self.workers,
        )  # fmt: skip
        taps.save(self.output, files.provenance(self.seed, command=options_of(self)))
        print(f"{len(taps)} taps of {len(self.periods_mm)} gratings -> {self.output}")

    def _yaws_deg(self) -> tuple[float, ...]:
        """Return the yaws to use in turn; empty if yaws are drawn at random."""
        if self.task is None:
            return self.yaw_deg or ()
        if self.yaw_deg is not None:
            raise InputError("task and yaw_deg both set the yaws: give only one of them", "yaw_deg")
        if self.task == "orientation":
            return Orientation(self.channels).yaws_deg
        return SameDifferent().yaws_deg


@dataclass(frozen=True)
class Train(Writes):
    """Train a decoder on simulated taps, or on a folder of recordings.

    Examples: bgmodel train taps.npz decoder.onnx --training.epochs 4 --seed 1;
    bgmodel train my_recordings edge.safetensors --edge --mm-per-px 0.33
    """

    taps: Positional[Path]
    """Taps from `bgmodel simulate`, or a folder of recordings with its targets csv."""
    output: Positional[Path]
    """File for the decoder, .safetensors or .onnx; an .onnx file is read without PyTorch."""
    edge: bool = False
    """The taps are of an edge: decode its direction (-180..180) instead of a grating's orientation.
    Training options that are not given are then those tuned for edges."""
    mm_per_px: float | None = None
    """Scale of recordings, mm per pixel."""
    pins: int | None = None
    """Number of pins of the recorded sensor; printed with the number detected."""
    training: TrainingOptions = field(default_factory=TrainingOptions)
    device: Literal["cpu", "cuda", "mps"] = "cpu"
    """Device for training; a seed reproduces the weights only on the CPU."""
    seed: int = 0

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.tactile.decoder import EDGE, ENDINGS, check_device, train
        from bgmodel.tactile.onnx_file import import_onnx

        check_ending("output", self.output, *ENDINGS)
        check_device(self.device)
        if self.output.suffix == ".onnx":
            import_onnx()
        given = {name: each for name, each in vars(self.training).items() if each is not None}
        training = replace(EDGE if self.edge else Training(), **given)
        taps, about = _taps(self)
        say(f"training on {len(taps)} taps for at most {training.epochs} epochs")
        idle = ["device"] if self.device == "cpu" else []
        options = options_of(self, idle=idle, training=training)
        behind: dict[str, Any] = {"taps": about, "command": options}
        decoder = train(taps, seed=self.seed, training=training, about=behind, device=self.device)
        decoder.save(self.output)
        best = min(row["mae_deg"] for row in decoder.history)
        print(f"validation error {best:.1f} degrees -> {self.output}")


@dataclass(frozen=True)
class Decode(Writes):
    """Decode the angle of every tap, simulated or from a folder of recordings.

    Example: bgmodel decode decoder.safetensors taps.npz decoded.parquet
    """

    decoder: Positional[Path]
    """A decoder from `bgmodel train`."""
    taps: Positional[Path]
    """Taps from `bgmodel simulate`, or a folder of recordings with its targets csv."""
    output: Positional[Path]
    """File for the table, .parquet or .csv."""
    edge: bool = False
    """The taps are of an edge; without it, recordings are assumed to be of gratings."""
    mm_per_px: float | None = None
    """Scale of recordings, mm per pixel."""
    pins: int | None = None
    """Number of pins of the recorded sensor; printed with the number detected."""

    def __call__(self) -> None:
        """Run the command."""
        from bgmodel.tactile.decoder import Decoder

        check_ending("output", self.output, ".parquet", ".csv")
        decoder = Decoder.load(self.decoder)
        taps, about = _taps(self, decoder.rest_mm)
        table = decoder.decode(taps)
        if "trained_on" in table:
            known = table["trained_on"].sum()
            say(f"the decoder was trained on {known} of these taps: tasks refuse the table")
        if "image" in table:
            table["image"] = table["image"].map(lambda path: Path(path).name)
        behind: dict[str, Any] = {
            "taps": about,
            "decoder": {"sha256": files.checksum(self.decoder), **decoder.about},
            "command": options_of(self),
        }
        files.write_table(table, self.output, **behind)
        print(f"{len(table)} taps decoded -> {self.output}")


def _taps(command: Train | Decode, rest: Reals | None = None) -> tuple[Taps, dict[str, Any]]:
    """Return taps and their provenance, from a file or from a folder of recordings."""
    from bgmodel.tactile.decoder import taps_of

    path, pins = command.taps, command.pins
    if not path.is_dir():
        check_idle(command, ["mm_per_px", "pins"], "a file of taps")
    stimulus = "edge" if command.edge else "grating" if path.is_dir() else None
    taps, about = taps_of(
        path, stimulus=stimulus, mm_per_px=command.mm_per_px, rest=rest, pins=pins
    )
    if path.is_dir():
        from bgmodel.tactile.recordings import pins_found

        print(f"{path.name}: {pins_found(taps, pins)}")
    return taps, about
