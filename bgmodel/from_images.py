"""Online decisions: images of taps that arrive in a folder are readings of a trial."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.session import Session
from bgmodel.integrators.sprt import Msprt
from bgmodel.support.files import IMAGES
from bgmodel.tactile.decoder import Decoder
from bgmodel.tactile.recordings import Tracker
from bgmodel.tactile.source import Tactile, check_decoder, load_taps, source
from circuits.arrays import Array
from circuits.errors import InputError, require

POLL_S = 0.004
COLUMNS = ["trial", "choice", "time_ms", "forced", "readings", "last_image", "latency_ms"]


@dataclass(frozen=True, kw_only=True)
class Watched:
    """A folder of images and how they are decided on."""

    folder: Path
    """Folder to which the sensor writes its images; existing images are read first."""
    decoder: Path
    """A decoder from `bgmodel touch train`."""
    taps: Path
    """Taps of the same sensor, decoded with it, used to estimate the likelihoods."""
    mm_per_px: float
    """Scale of the images, mm per pixel."""
    task: Tactile  # with the time between readings and the deadline of a trial
    model: BasalGanglia | None  # without a circuit, the test decides
    posterior: float = 0.82
    """Posterior at which to decide."""
    first_deg: float = 0.0
    """Direction of the first alternative of edge-direction, degrees."""
    idle_s: float = 10.0
    """Stop when no image has arrived for this time, s."""
    skipped: Callable[[str], None] = print  # called with the reason
    latency_ms: list[float] = field(default_factory=list)  # of each reading

    def __post_init__(self) -> None:
        if not self.folder.is_dir():
            raise InputError(f"there is no folder {str(self.folder)!r}", "folder", self.folder)
        network = self._loaded.training.network
        if network != self.task.stimulus:
            raise InputError(
                f"task {self.task.name} needs a decoder of taps of a {self.task.stimulus}, got one "
                f"of {network}s",
                "decoder",
                self.decoder,
            )
        check_decoder(self.taps, self.decoder, self._loaded.about)
        self._loaded.scale(self.mm_per_px)
        direction = self.task.name == "edge-direction"
        must = "is for edge-direction"
        require(direction or not self.first_deg, "first_deg", must, self.first_deg)
        self._known.warn_if_silent()

    @cached_property
    def _loaded(self) -> Decoder:
        return Decoder.load(self.decoder)

    @cached_property
    def _known(self) -> Any:
        return source(load_taps(self.taps), self.task)

    @cached_property
    def session(self) -> Session:
        """The decision maker, reading by reading."""
        settings: dict[str, Any] = {
            "posterior": self.posterior, "step_ms": self.task.step_ms, "t_max": self.task.t_max,
        }  # fmt: skip
        if self.model is None:
            return Msprt().session(len(self._known.names), **settings)
        seed = self.model.seed or 0
        usual = self._known.draw(200, 10, rng=seed, step_ms=self.task.step_ms)
        self.model.check_strength(usual)
        self.model.warn_beyond_range(usual)
        return self.model.session(baseline=self._known.baseline, **settings)

    def decisions(self) -> Iterator[dict[str, Any]]:
        """Yield one row per decision, with ``COLUMNS``, as images arrive."""
        read, session, names = self._reader(), self.session, self._known.names
        begun: float | None = None
        readings = 0
        for path in images(self.folder, self.idle_s):
            now = time.monotonic()
            begun = now if begun is None else begun
            reading = read(path)
            if reading is None:
                continue
            due_ms = (len(session.readings) + 1) * self.task.step_ms
            at_ms = max(1000 * (now - begun) + self.task.step_ms, due_ms)
            decision = session.add(reading, at_ms=at_ms)
            readings += 1
            self.latency_ms.append(1000 * (time.monotonic() - now))
            if decision is None:
                continue
            choice = int(decision.choice[0])
            row = (
                session.trial, names[choice] if choice >= 0 else "none",
                float(decision.time_ms[0]), bool(decision.forced[0]), readings,
                path.name, self.latency_ms[-1],
            )  # fmt: skip
            yield dict(zip(COLUMNS, row, strict=True))
            session.next()
            begun, readings = None, 0

    def _reader(self) -> Callable[[Path], Array | None]:
        """Return a function that maps an image to log-likelihoods.

        It returns None within a reading, and for one of which an image could not be read.
        """
        decoder, task = self._loaded, self.task
        tracker = Tracker(decoder.rest_mm, self.mm_per_px, decoder.training.network)
        angles: list[float] = []
        partner = ", and so is the other one of its pair" if task.taps_per_reading > 1 else ""

        def read(path: Path) -> Array | None:
            try:
                seen = decoder.decode(tracker.read(path))[task.column]
                angles.append(float(seen[0]) - self.first_deg)
            except ValueError as error:
                self.skipped(f"{error}: this image is skipped{partner}")
                angles.append(np.nan)
            if len(angles) < task.taps_per_reading:
                return None
            reading = task.reading(angles)
            angles.clear()
            nats: Array | None = self._known.likelihood(reading) if np.isfinite(reading) else None
            return nats

        return read


def images(folder: Path, idle_s: float) -> Iterator[Path]:
    """Yield the images of a folder in order of modification time; wait up to ``idle_s`` for more.

    An image is yielded once its size is unchanged between two polls, so that images still being
    written are not read.
    """
    seen: set[str] = set()
    sizes: dict[str, int] = {}
    last = time.monotonic()
    while time.monotonic() - last < idle_s:
        begun = time.monotonic()
        new = sorted(_new_images(folder, seen))
        looked_s = time.monotonic() - begun
        looked: dict[str, int] = {}
        complete = True
        for _, name, size in new:
            looked[name] = size
            # Images after an unfinished one wait too, to keep them in order.
            complete = complete and size > 0 and sizes.get(name) == size
            if complete:
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
            status = os.stat(folder / name)
            if name.lower().endswith(IMAGES):
                yield status.st_mtime_ns, name, status.st_size
