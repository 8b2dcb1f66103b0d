"""Online decisions: monitor a folder of images and treat each image as a reading."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from tyro.conf import Positional

from bgmodel.commands.checks import Writes, check_ending, options_of, say
from bgmodel.commands.taps import Asks
from bgmodel.names import MACAQUE, CircuitName, EngineName
from bgmodel.support import files
from bgmodel.support.arrays import Array
from circuits.errors import InputError

if TYPE_CHECKING:
    from bgmodel.integrators.session import Session

POLL_S = 0.004
SPIKES = EngineName("ensemble")
COLUMNS = ["trial", "choice", "time_ms", "forced", "readings", "last_image", "latency_ms"]
IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")


@dataclass(frozen=True)
class Watch(Asks, Writes):
    """Decide on images of taps as they arrive in a folder, with the circuit or the test.

    Each image is decoded and its log-likelihoods are added to the trial. As soon as OUT crosses the
    threshold, the decision is printed and the next trial begins. In a task with two taps, each
    pair of images is one reading. The command ends when no image has arrived for some time.

    Example: bgmodel watch camera decisions.csv --decoder edge.safetensors --taps decoded.parquet
    --task edge-direction --mm-per-px 0.33
    """

    folder: Positional[Path]
    """Folder to which the sensor writes its images; existing images are read first."""
    output: Positional[Path]
    """File for the table of decisions, .csv or .parquet."""
    decoder: Path
    """A decoder from `bgmodel train`."""
    taps: Path
    """Taps of the same sensor, decoded with it, used to estimate the likelihoods."""
    mm_per_px: float
    """Scale of the images, mm per pixel."""
    task: Literal["same-different", "orientation", "edge-turn", "edge-direction"] = "edge-direction"
    """The tactile task."""
    first_deg: float = 0.0
    """Direction of the first alternative of edge-direction, degrees."""
    by: Literal["circuit", "test"] = "circuit"
    """Decision maker: the circuit or the test."""
    circuit: CircuitName = MACAQUE
    """Name of a circuit table, or path of a .toml file."""
    engine: EngineName = SPIKES
    """Engine of the circuit: ensemble (spikes), population or rate."""
    posterior: float = 0.82
    """Posterior at which to decide."""
    step_ms: float = 100.0
    """Time between readings, ms; late readings raise a warning."""
    t_max: int = 60
    """Maximum number of steps per trial; at this deadline a response is forced."""
    idle_s: float = 10.0
    """Stop when no image has arrived for this time, s."""
    seed: int = 0

    def __call__(self) -> None:
        """Run the command."""
        import pandas as pd

        check_ending("output", self.output, ".csv", ".parquet")
        if not self.folder.is_dir():
            raise InputError(f"there is no folder {str(self.folder)!r}", "folder", self.folder)
        read, names, session = self._begin()
        say(f"watching {self.folder}; stops {self.idle_s:g} s after the last image")
        rows: list[dict[str, Any]] = []
        latency: list[float] = []
        try:
            for row in self._decisions(read, names, session, latency):
                rows.append(row)
                forced = ", forced" if row["forced"] else ""
                print(
                    f"trial {row['trial']}: {row['choice']} after {row['readings']} readings, "
                    f"{row['time_ms']:.0f} ms{forced}",
                    flush=True,
                )
        finally:  # write the decisions even if interrupted
            table = pd.DataFrame(rows, columns=COLUMNS)
            files.write_table(table, self.output, seed=self.seed, command=options_of(self))
        if session.readings:
            say(f"the last trial ended undecided after {len(session.readings)} steps")
        middle = f", {np.median(latency):.0f} ms from image to OUT (median)" if latency else ""
        print(f"{len(rows)} decisions on {len(latency)} readings{middle} -> {self.output}")

    def _decisions(
        self,
        read: Callable[[Path], Array | None],
        names: tuple[str, ...],
        session: Session,
        latency: list[float],
    ) -> Iterator[dict[str, Any]]:
        """Yield one row per decision; append the latency of each reading, ms."""
        begun: float | None = None
        readings = 0
        for path in images(self.folder, self.idle_s):
            now = time.monotonic()
            begun = now if begun is None else begun
            try:
                reading = read(path)
            except ValueError as error:
                say(f"{error}: this image is skipped")
                continue
            if reading is None:
                continue
            due_ms = (len(session.readings) + 1) * self.step_ms
            at_ms = max(1000 * (now - begun) + self.step_ms, due_ms)
            decision = session.add(reading, at_ms=at_ms)
            readings += 1
            latency.append(1000 * (time.monotonic() - now))
            if decision is None:
                continue
            choice = int(decision.choice[0])
            found = (
                session.trial, names[choice] if choice >= 0 else "none",
                float(decision.time_ms[0]), bool(decision.forced[0]), readings,
                path.name, latency[-1],
            )  # fmt: skip
            yield dict(zip(COLUMNS, found, strict=True))
            session.next()
            begun, readings = None, 0

    def _begin(self) -> tuple[Callable[[Path], Array | None], tuple[str, ...], Session]:
        """Return the reader of images, the names of alternatives, and the session."""
        from bgmodel.integrators.basal_ganglia import BasalGanglia
        from bgmodel.integrators.sprt import Msprt
        from bgmodel.tactile.decoder import Decoder
        from bgmodel.tactile.recordings import Tracker
        from bgmodel.tactile.source import check_decoder, load_taps, source
        from bgmodel.tactile.task import tactile_task
        from circuits.anatomy import load_circuit

        decoder = Decoder.load(self.decoder)
        stimulus = {"period_mm": self.period_mm, "step_deg": self.step_deg}
        task = tactile_task(self.task, self.channels, **stimulus)
        if decoder.training.network != task.stimulus:
            raise InputError(
                f"task {self.task} needs a decoder of taps of a {task.stimulus}, got one of "
                f"{decoder.training.network}s",
                "decoder",
                self.decoder,
            )
        check_decoder(self.taps, self.decoder, decoder.about)
        known = source(load_taps(self.taps), task)
        known.warn_if_silent()
        tracker = Tracker(decoder.rest_mm, self.mm_per_px, decoder.training.network)
        zero_deg = self.first_deg if self.task == "edge-direction" else 0.0
        angles: list[float] = []

        def read(path: Path) -> Array | None:
            angles.append(float(decoder.decode(tracker.read(path))[task.column][0]) - zero_deg)
            if len(angles) < task.taps_per_reading:
                return None
            reading = task.reading(angles)
            angles.clear()
            return known.likelihood(reading)

        given: dict[str, Any] = {
            "posterior": self.posterior, "step_ms": self.step_ms, "t_max": self.t_max,
        }  # fmt: skip
        if self.by == "test":
            return read, known.names, Msprt().session(len(known.names), **given)
        table = load_circuit(self.circuit, len(known.names))
        model = BasalGanglia(table, self.engine, seed=self.seed)
        usual = known.draw(200, 10, rng=self.seed, step_ms=self.step_ms)
        model.check_strength(usual)
        model.warn_beyond_range(usual)
        return read, known.names, model.session(baseline=known.baseline, **given)


def images(folder: Path, idle_s: float) -> Iterator[Path]:
    """Yield the images of a folder in order of modification time, and wait for more.

    An image is yielded once its size is unchanged between two polls, so that images still being
    written are not read.

    Parameters
    ----------
    folder : Path
        Folder to which images are written.
    idle_s : float
        Stop when no image has arrived for this time, s.
    """
    seen: set[str] = set()
    sizes: dict[str, int] = {}
    last = time.monotonic()
    while time.monotonic() - last < idle_s:
        begun = time.monotonic()
        new = sorted(_new_images(folder, seen))
        looked_s = time.monotonic() - begun
        looked: dict[str, int] = {}
        whole = True
        for _, name, size in new:
            looked[name] = size
            # Images after an unfinished one wait too, to keep them in order.
            whole = whole and size > 0 and sizes.get(name) == size
            if whole:
                seen.add(name)
                yield folder / name
                last = time.monotonic()
        sizes = looked
        # Listing a folder of many thousands of images takes a while.
        time.sleep(max(POLL_S, looked_s))


def _new_images(folder: Path, seen: set[str]) -> Iterator[tuple[int, str, int]]:
    """Yield modification time, name and size of the images not yet seen."""
    for name in set(os.listdir(folder)) - seen:
        with suppress(FileNotFoundError):  # it may have been deleted
            found = os.stat(folder / name)
            if name.lower().endswith(IMAGES):
                yield found.st_mtime_ns, name, found.st_size
