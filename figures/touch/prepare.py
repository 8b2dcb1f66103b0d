"""Prerequisites of all figures: contact library, trained decoder, decoded held-out taps."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from bgmodel import stream
from bgmodel.support.files import provenance, replacing, write_table
from bgmodel.tactile.decoder import Decoder, Training, train
from bgmodel.tactile.library import contact_library
from bgmodel.tactile.sensor import Nuisance, simulate
from bgmodel.tactile.skin import Skin, Tip
from bgmodel.tactile.task import Orientation, SameDifferent
from figures.common import Settings

SENSOR: dict[str, Any] = {"tip": Tip(), "skin": Skin(), "nuisance": Nuisance()}
TRAINING = Training()


def library(settings: Settings, *, output: Path) -> None:
    """Compute the contact library into the cache, and write a marker file."""
    plan = contact_library(workers=1).plan
    with replacing(output) as partial:
        partial.write_text(f"{plan}\n")


def decoder(settings: Settings, done: Path, *, output: Path) -> None:
    """Simulate the training taps and train the decoder."""
    rng = stream(settings.seed, "training taps")
    periods = np.repeat(settings.periods_mm, settings.training_taps)
    taps = simulate(periods, rng.uniform(-90, 90, len(periods)), rng=rng, **SENSOR)
    about = {"taps": provenance(settings.seed, periods_mm=settings.periods_mm, **SENSOR)}
    training = replace(TRAINING, epochs=settings.epochs)
    train(taps, seed=settings.seed, training=training, about=about).save(output)


def yaws() -> dict[float, bool]:
    """Return every yaw used by a task; True for the two of same/different."""
    both = set(SameDifferent().yaws_deg)
    every = {yaw for count in range(2, 9) for yaw in Orientation(count).yaws_deg}
    # The last digits of thirds and sevenths depend on the number of alternatives.
    exact = {float(Fraction(yaw).limit_denominator(1000)) for yaw in every | both}
    return {yaw: yaw in both for yaw in sorted(exact)}


def held_out(settings: Settings, done: Path, stored: Path, *, output: Path) -> None:
    """Simulate fresh taps at the yaws of the tasks and decode them."""
    network, contacts = Decoder.load(stored), contact_library()
    parts = []
    for period in settings.periods_mm:
        for yaw, often in yaws().items():
            count = settings.held_out_taps if often else settings.orientation_taps
            rng = stream(settings.seed, "held-out taps", period, yaw)
            taps = simulate(np.full(count, period), yaw, rng=rng, library=contacts, **SENSOR)
            decoded = network.decode(taps)
            parts.append(decoded[["period_mm", "yaw_deg", "psi_deg", "orientation_deg"]])
    table = pd.concat(parts, ignore_index=True)
    # A tenth of a degree is far below any decoder error, and compresses well.
    for name in ("psi_deg", "orientation_deg"):
        table[name] = table[name].round(1).astype(np.float32)
    for name in ("period_mm", "yaw_deg"):
        table[name] = table[name].astype(np.float32)
    about = {k: v for k, v in network.about.items() if k != "taps"}
    write_table(
        table,
        output,
        seed=settings.seed,
        command="make shipped-taps",
        decoder=about,
        training=network.training,
        validation_mae_deg=min(row["mae_deg"] for row in network.history),
        **SENSOR,
    )
