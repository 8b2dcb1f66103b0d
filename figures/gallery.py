"""The gallery of the site: every figure with its question, picture, caption, answer and command.

Small pictures of the released version are kept in ``docs/pictures``. ``make pictures`` copies them
there from a full run of the figures. The page is written whenever the site is built, and lists what
has changed since a picture was drawn.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from PIL import Image, PngImagePlugin

from bgmodel.support.files import replacing
from figures.common import FULL, captions
from figures.rooms import ROOT, Caption, rooms
from figures.stamps import KEY, outdated, read_stamp

DRAWN = ROOT / "figures" / "out"
"""Pictures of a full run."""
KEPT = ROOT / "docs" / "pictures"
"""Small pictures, under version control."""
WIDTH, COLOURS = 1100, 96
"""Of a small picture: pixels, and entries of its palette."""
HEAD = """# Gallery

Every figure of the project, with its question and answer. `make figures` draws all of them at full
size, as PNG and PDF, with the tables behind them; `bgmodel figures fig3` draws one.
"""


def main() -> None:
    """Copy the pictures of a full run, made small, to the documentation."""
    missing = [name for name in captions(FULL) if not (DRAWN / f"{name}.png").is_file()]
    if missing:
        raise SystemExit(f"not drawn yet: {', '.join(missing)}; run make figures first")
    KEPT.mkdir(exist_ok=True)
    for name in captions(FULL):
        shrink(DRAWN / f"{name}.png", KEPT / f"{name}.png")
    print(f"{KEPT}: {sum(path.stat().st_size for path in KEPT.glob('*.png')) / 1e6:.2f} MB")


def shrink(drawn: Path, kept: Path) -> None:
    """Write a small copy of a picture with its stamp; ValueError if it has none."""
    stamp = read_stamp(drawn)
    if stamp is None:
        raise ValueError(f"{drawn} does not say which version drew it: draw it again")
    stamped = PngImagePlugin.PngInfo()
    stamped.add_text(KEY, stamp.text())
    with Image.open(drawn) as picture, replacing(kept) as partial:
        size = (min(WIDTH, picture.width), round(picture.height * min(1, WIDTH / picture.width)))
        small = picture.convert("RGB").resize(size, Image.Resampling.LANCZOS)
        # Few pixels of a line have its colour: the usual choice of colours would change it.
        every = Image.Quantize.MAXCOVERAGE
        palette = small.quantize(COLOURS, method=every, kmeans=2, dither=Image.Dither.NONE)
        palette.save(partial, "PNG", optimize=True, pnginfo=stamped)


def write(docs: Path) -> None:
    """Write ``gallery.md`` into a folder that has the pictures in ``pictures``."""
    (docs / "gallery.md").write_text("\n".join(_parts(docs / "pictures")), encoding="utf-8")


def _parts(pictures: Path) -> Iterator[str]:
    every = captions(FULL)
    yield HEAD
    for room in rooms():
        if room.figures():
            yield f"## {room.about['question']}\n"
        for name in room.about.get("figures", {}):
            yield _entry(every[name], name, pictures / f"{name}.png")


def _entry(text: Caption, name: str, picture: Path) -> str:
    """Return the part of the page about one figure."""
    title = f"Figure {name.removeprefix('fig')}. {text.title}"
    if picture.is_file():
        shown = f"![{title}](pictures/{picture.name})"
        note = outdated(picture, FULL)
        shown += f"\n\n({note})" if note else ""
    else:
        shown = f"There is no picture yet: `bgmodel figures {name}` draws it."
    blocks = (
        f"### {title}",
        f"*{text.question}*",
        shown,
        text.caption,
        f"**Answer.** {text.answer}",
        f"```console\n$ bgmodel figures {name}\n```",
    )
    return "\n\n".join(blocks) + "\n"


if __name__ == "__main__":
    main()
