"""The gallery of the site: every figure with its question, caption, answer and command.

The page and its pictures are generated whenever the site is built, and never committed.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
if str(ROOT) not in sys.path:
    # The figures are part of a checkout, not of the package.
    sys.path.insert(0, str(ROOT))

from figures.captions import Caption, captions  # noqa: E402
from figures.common import FAST, FULL  # noqa: E402

FOLDERS = (("figures/out", FULL, ""), ("figures/fast", FAST, "coarse run"))
"""Folders searched for pictures, in order: path, settings of the run, and a note for the page."""
HEAD = """# Gallery

Every figure of the project, with its question and answer. `bgmodel figures` draws all of them,
`bgmodel figures --fast` a coarse version within minutes.
"""


def write(docs: Path) -> None:
    """Write ``docs/gallery.md``, and copy existing pictures into ``docs/_figures``.

    Pictures of a full run take precedence over those of a coarse run. If there is no picture, the
    page shows the command that draws it.
    """
    parts = [HEAD, *(_entry(name, docs / "_figures") for name in captions(FULL))]
    (docs / "gallery.md").write_text("\n".join(parts), encoding="utf-8")


def _entry(name: str, pictures: Path) -> str:
    """Return the part of the page about one figure."""
    for folder, settings, words in FOLDERS:
        drawn = ROOT / folder / f"{name}.png"
        if drawn.is_file():
            text = captions(settings)[name]
            pictures.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(drawn, pictures / drawn.name)
            shown = f"![Figure {_number(name)}: {text.title}](_figures/{drawn.name})"
            return _page(name, text, f"{shown}\n\n({words})" if words else shown)
    text = captions(FULL)[name]
    return _page(name, text, f"Not drawn yet: `{text.command}` draws it.")


def _page(name: str, text: Caption, shown: str) -> str:
    blocks = [
        f"## Figure {_number(name)}. {text.title}",
        f"*{text.question}*",
        shown,
        text.caption,
        f"**Answer.** {text.answer}",
        f"```console\n$ {text.command}\n```",
    ]
    return "\n\n".join(blocks) + "\n"


def _number(name: str) -> str:
    return name.removeprefix("fig")
