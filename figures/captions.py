"""The captions of all figures: `captions.toml`, with the numbers of a run filled in."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, fields
from pathlib import Path

from figures.common import Settings

CAPTIONS = Path(__file__).with_name("captions.toml")


@dataclass(frozen=True)
class Caption:
    """What a reader of one figure is told; MyST Markdown, without line breaks."""

    title: str
    """A few words."""
    question: str
    """What somebody who studies the brain would ask."""
    caption: str
    """Panels (``**a**``), marks, numbers of trials and intervals."""
    answer: str
    """What the figure says to the question."""
    command: str
    """What draws it."""


def captions(settings: Settings) -> dict[str, Caption]:
    """Return the caption of each figure, by the name of its script, in the order of the file.

    Parameters
    ----------
    settings : Settings
        The numbers that are filled in.

    Raises
    ------
    KeyError
        If a placeholder is no field of ``Settings``.
    TypeError
        If a figure lacks a key or has one too many.
    """
    numbers = {field.name: _shown(getattr(settings, field.name)) for field in fields(settings)}
    every = tomllib.loads(CAPTIONS.read_text(encoding="utf-8"))
    return {
        name: Caption(**{key: _line(text, numbers) for key, text in texts.items()})
        for name, texts in every.items()
    }


def _line(text: str, numbers: dict[str, str]) -> str:
    return " ".join(text.split()).format_map(numbers)


def _shown(value: float | tuple[float, ...]) -> str:
    """Return a number, or several, as text: thousands apart, no trailing zeros."""
    if isinstance(value, tuple):
        return ", ".join(map(_shown, value))
    # No-break spaces: a line's end cuts no number.
    return f"{value:,}".replace(",", "\u202f") if isinstance(value, int) else f"{value:g}"
