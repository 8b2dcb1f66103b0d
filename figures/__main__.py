"""Run rooms: ``python -m figures [measure|draw|page] [ROOM...] [--fast] [--only NAME]``.

Without a step all three are run, in this order; without a room all of them. Options are those of
``figures.pieces.measure`` and of ``bgmodel figures``.
"""

from __future__ import annotations

import argparse
from importlib import import_module
from pathlib import Path

from bgmodel.commands.pictures import figures as draw
from figures import pages
from figures.pieces import Score, measure
from figures.rooms import FOLDER, Room, rooms

STEPS = ("measure", "draw", "page")


def scores(some: list[Room]) -> list[Score]:
    """Return the scores of the modules of rooms."""
    names = [f"figures.{room.name}.{module}" for room in some for module in room.modules("measure")]
    return [import_module(name).SCORE for name in names]


def main(
    arguments: list[str] | None = None, folder: Path = FOLDER, results: Path = pages.RESULTS
) -> None:
    """Check the rooms (InputError for what is missing), then measure, draw and write pages."""
    every = {room.name: room for room in rooms(folder)}
    parser = argparse.ArgumentParser()
    parser.add_argument("what", nargs="*", choices=[*STEPS, *every, []], metavar="STEP or ROOM")
    parser.add_argument("--fast", action="store_true", help="fewer trials")
    parser.add_argument("--only", default="", help="pieces whose file's name contains this")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args(arguments)
    steps = [step for step in STEPS if step in options.what] or list(STEPS)
    some = [every[name] for name in options.what if name in every] or list(every.values())
    for room in some:
        room.check(measured="measure" not in steps)
    if "measure" in steps:
        measure(*scores(some), fast=options.fast, only=options.only, workers=options.workers)
        for room in some:
            room.check()
    if "draw" in steps:
        draw(*(name for room in some for name in room.figures()), fast=options.fast)
    if "page" in steps:
        templates = [room.page for room in some if room.page.is_file()]
        for template in [*templates, folder / "index.md.j2"]:
            print(pages.write_page(template, folder, results))


if __name__ == "__main__":
    main()
