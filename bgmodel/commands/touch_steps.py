"""Commands that simulate taps, train a decoder on taps, and decode taps."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from bgmodel.commands.options import FLAT, MANY, Workers, like, record, record_of, task
from bgmodel.commands.output import Files, check_idle, check_whole, options_of, say
from bgmodel.support import files
from bgmodel.tactile import sensor
from bgmodel.tactile.decoder import EDGE, ENDINGS, Training, load_decoder, taps_of, train_decoder
from bgmodel.tactile.decoder import train as fitted
from bgmodel.tactile.networks import NETWORKS, OwnNetwork
from bgmodel.tactile.sensor import Nuisance
from bgmodel.tactile.skin import Skin, Tip
from bgmodel.tactile.taps import Taps
from bgmodel.tactile.task import SameDifferent
from bgmodel.task import Task
from circuits.arrays import Reals
from circuits.errors import InputError, require

Pins = Annotated[int | None, Parameter(help="Number of pins of the sensor, to check those found.")]
Scale = Annotated[float | None, Parameter(help="Scale of recordings, mm per pixel.")]
ABOUT = "Taps from `bgmodel touch simulate`, or a folder of recordings with its targets csv."
TapsOption = Annotated[Path, Parameter(help=ABOUT)]


@like(sensor.simulate_taps, "taps", "periods_mm", "yaw_deg", "seed")
def simulate(
    *,
    task: Annotated[Task | None, task(SameDifferent())] = None,
    tip: Annotated[Tip, record(Tip(), "The sensor's tip.")] = Tip(),  # noqa: B008
    skin: Annotated[Skin, record(Skin(), "Its skin and gel.")] = Skin(),  # noqa: B008
    nuisance: Annotated[Nuisance, record(Nuisance(), "What varies between taps.")] = Nuisance(),  # noqa: B008
    workers: Workers = 1,
    output: Annotated[Files, FLAT] = Files(),  # noqa: B008
    **options: Any,
) -> None:
    """Tap gratings with the simulated TacTip.

    Examples: bgmodel touch simulate --save taps.npz --taps 1000;
    bgmodel touch simulate --save held_out.npz --task orientation channels=4 --taps 400
    """
    from bgmodel.tactile.library import to_solve
    from bgmodel.tactile.pressing import LibraryPlan

    path = output.needed(".npz")
    check_whole(taps=options["taps"], workers=workers)
    sensor.check_taps(options["taps"], options["periods_mm"], tip)
    if task is not None:
        if options["yaw_deg"]:
            reason = "task and yaw_deg both set the yaws: give only one of them"
            raise InputError(reason, "yaw_deg")
        yaws = getattr(task, "yaws_deg", None)
        require(yaws, "task", "must be of gratings, same-different or orientation", task.name)
        check_settings(task, {"channels", "a_deg", "b_deg"})
        options = {**options, "yaw_deg": yaws}
    contacts = to_solve(LibraryPlan(skin=skin, radius_mm=tip.radius_mm))
    first = f"solving {contacts} contacts, once for all runs, and " if contacts else ""
    say(f"{first}simulating {options['taps'] * len(options['periods_mm'])} taps")
    settings = {"tip": tip, "skin": skin, "nuisance": nuisance, **options}
    taps = sensor.simulate_taps(**settings, workers=workers)
    taps.save(path, files.provenance(options["seed"], command=options_of(**settings)))
    print(f"{len(taps)} taps of {len(options['periods_mm'])} gratings -> {path}")


@like(train_decoder, "edge", "mm_per_px", "seed")
def train(
    taps: TapsOption,
    /,
    *,
    pins: Pins = None,
    training: Annotated[tuple[str, ...], MANY] = (),
    device: Literal["cpu", "cuda", "mps"] = "cpu",
    output: Annotated[Files, FLAT] = Files(),  # noqa: B008
    **options: Any,
) -> None:
    """Train a decoder on simulated taps, or on a folder of recordings.

    Examples: bgmodel touch train taps.npz --save decoder.onnx --training epochs=4 --seed 1;
    bgmodel touch train my_recordings --save edge.safetensors --edge --mm-per-px 0.33

    Parameters
    ----------
    training
        Settings of the training, name=value: network, epochs, patience, batch, learning_rate,
        width, dropout, l2, validation; by default those tuned for gratings, or for edges.
    device
        Device for training; a seed reproduces the weights only on the CPU.
    """
    path = output.needed(*ENDINGS, taps=taps)
    if path.suffix == ".onnx":
        from bgmodel.tactile.networks import import_onnx

        import_onnx()
    how = record_of(EDGE if options["edge"] else Training(), training)
    loaded, about = _taps(taps, options["edge"], options["mm_per_px"], pins)
    say(f"training on {len(loaded)} taps for at most {how.epochs} epochs")
    where = {} if device == "cpu" else {"device": device}
    made = options_of(taps=taps, training=how, pins=pins, **options, **where)
    behind, seed = {"taps": about, "command": made}, options["seed"]
    decoder = fitted(loaded, seed=seed, training=how, about=behind, device=device)
    decoder.save(path)
    best = min(row["mae_deg"] for row in decoder.history)
    print(f"validation error {best:.1f} degrees -> {path}")


def decode(
    decoder: Path,
    taps: TapsOption,
    /,
    *,
    edge: bool = False,
    mm_per_px: Scale = None,
    pins: Pins = None,
    own: Annotated[tuple[str, ...], MANY] = (),
    output: Annotated[Files, FLAT] = Files(),  # noqa: B008
) -> None:
    """Decode the angle of every tap, simulated or from a folder of recordings.

    Example: bgmodel touch decode decoder.safetensors taps.npz --save decoded.parquet

    Parameters
    ----------
    decoder
        A decoder from `bgmodel touch train`, or an .onnx file with another network.
    edge
        The taps are of an edge; without it, recordings are assumed to be of gratings.
    own
        What another network takes and gives, name=value: stimulus (grating or edge), takes
        (maps or displacements), gives (angle or vector).
    """
    path = output.needed(".parquet", ".csv", decoder=decoder, taps=taps)
    loaded = load_decoder(decoder, record_of(OwnNetwork(), own) if own else None)
    rest = loaded.rest_mm if len(loaded.rest_mm) else None
    scale = loaded.scale(mm_per_px) if taps.is_dir() else mm_per_px
    loaded_taps, about = _taps(taps, edge, scale, pins, rest)
    table = loaded.decode(loaded_taps)
    if "trained_on" in table:
        known = table["trained_on"].sum()
        say(f"the decoder was trained on {known} of these taps: tasks refuse the table")
    if "image" in table:
        table["image"] = table["image"].map(lambda image: Path(image).name)
    made = options_of(decoder=decoder, taps=taps, edge=edge, mm_per_px=mm_per_px, pins=pins,
                      own=own or None)  # fmt: skip
    network: Any = {"sha256": files.checksum(decoder), **loaded.about}
    files.write_table(table, path, taps=about, decoder=network, command=made)
    error = ""
    if "yaw_deg" in table:
        read = {str(name): table[name].to_numpy() for name in table}
        errors = NETWORKS[loaded.training.network].errors(read, read["yaw_deg"])
        error = f", mean absolute error {errors['mae_deg']:.1f} degrees"
    print(f"{len(table)} taps decoded{error} -> {path}")


def check_settings(task: Task, used: set[str]) -> None:
    """Raise ValueError for a setting of a task that has no effect on taps."""
    usual = type(task)()
    for each in fields(task):
        value = getattr(task, each.name)
        must = "has no effect here as a setting of --task: leave it out"
        require(each.name in used or value == getattr(usual, each.name), each.name, must, value)


def _taps(
    path: Path, edge: bool, mm_per_px: float | None, pins: int | None, rest: Reals | None = None
) -> tuple[Taps, dict[str, Any]]:
    """Return taps and their provenance, from a file or from a folder of recordings."""
    if not path.is_dir():
        usual = {"mm_per_px": None, "pins": None}
        check_idle("a file of taps", usual, mm_per_px=mm_per_px, pins=pins)
    stimulus = "edge" if edge else "grating" if path.is_dir() else None
    taps, about = taps_of(path, stimulus=stimulus, mm_per_px=mm_per_px, rest=rest, pins=pins)
    if path.is_dir():
        from bgmodel.tactile.recordings import pins_found

        print(f"{path.name}: {pins_found(taps, pins)}")
    return taps, about
