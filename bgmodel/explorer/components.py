"""The explorer's own Panel components: the drawing that can be clicked, and the page."""

from __future__ import annotations

from typing import ClassVar

import panel as pn
import param
from panel.custom import JSComponent


class Drawing(JSComponent):
    """The drawing of the circuit; a click on a nucleus or a pathway reports its name."""

    svg = param.String(default="")
    chosen = param.String(default="")
    clicks = param.Integer(default=0)
    _esm = """
    export function render({ model }) {
      const box = document.createElement("div");
      const draw = () => {
        box.innerHTML = model.svg;
        const svg = box.querySelector("svg");
        if (!svg) return;
        svg.setAttribute("role", "img");
        svg.setAttribute("aria-label", "The circuit; a list below has its rows");
      };
      draw();
      model.on("svg", draw);
      box.addEventListener("click", (event) => {
        let at = event.target;
        while (at !== box && !at.id) at = at.parentNode;
        if (at === box) return;
        model.chosen = at.id;
        model.clicks += 1;
      });
      return box;
    }
    """
    _stylesheets: ClassVar[list[str]] = [
        ":host(.busy) { opacity: .45; } svg { width: 100%; height: auto; display: block; } "
        "g[id] > path, g[id] > text { cursor: pointer; }"
    ]


class Page(pn.Template):
    """A template whose text is short: Panel writes it anew for every part that is added."""

    def __repr__(self, depth: int = 0) -> str:
        """Return its kind."""
        return "Page"
