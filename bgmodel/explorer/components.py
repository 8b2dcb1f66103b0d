"""The explorer's own Panel components: the drawing that can be clicked, and the page."""

from __future__ import annotations

import io
from collections.abc import Callable
from html import escape
from typing import TYPE_CHECKING, Any, ClassVar

import panel as pn
import param
from panel.custom import JSComponent

from bgmodel.explorer.html import Panel, html_of
from bgmodel.explorer.style import NOTICE, PANEL

if TYPE_CHECKING:
    from bgmodel.experiments.experiment import Outcome
    from bgmodel.explorer.state import State


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

    def server_doc(self, doc: Any = None, title: str | None = None, location: Any = True) -> Any:
        """Add the page to a document, whose models are listed once instead of for every part."""
        doc = doc or pn.state.curdoc
        with doc.models.freeze():
            return super().server_doc(doc, title, location)


class Refusal:
    """Why the last change was refused: a sentence below the field in which it was typed."""

    def __init__(self) -> None:
        narrow = ":host { width: calc(100% - 20px); }"
        self.pane = pn.pane.HTML("", stylesheets=[NOTICE, narrow], margin=(0, 10))
        self._column: Any = None

    def show(self, sentence: str, widget: Any, columns: list[Any]) -> None:
        """Show a sentence below a widget, or at the top of the first column."""
        self.hide()
        why = f'<p class="refusal" role="alert">Refused: {escape(sentence)}</p>'
        self.pane.object = why
        self._column = next((column for column in columns if widget in column), columns[0])
        below = 1 + self._column.index(widget) if widget in self._column else 0
        self._column.insert(below, self.pane)

    def hide(self) -> None:
        """Remove the sentence."""
        if self._column is not None:
            self._column.remove(self.pane)
            self._column, self.pane.object = None, ""


class Ranking:
    """The panel of the ranking: a button that starts it, one that ends it, and its table."""

    def __init__(self, start: Callable[[], None], cancel: Callable[[], None]) -> None:
        self.begin = pn.widgets.Button(name="Rank losses of 10 %", button_type="primary")
        self.stop = pn.widgets.Button(name="Stop", disabled=True)
        self.begin.on_click(lambda _: start())
        self.stop.on_click(lambda _: cancel())
        self.table = pn.pane.HTML("", stylesheets=[PANEL], sizing_mode="stretch_width")
        self.layout = pn.Column(
            pn.Row(self.begin, self.stop), self.table, sizing_mode="stretch_width"
        )
        self._panel: Panel | None = None

    def start(self) -> None:
        """Show that the ranking is computed."""
        self.begin.disabled, self.stop.disabled = True, False
        self.table.object = '<p role="status">Computing…</p>'
        self._panel = None

    def end(self) -> None:
        """Show that the ranking has ended."""
        self.begin.disabled, self.stop.disabled = False, True

    def deliver(self, panel: Panel) -> None:
        """Show the losses that have been ranked so far."""
        self._panel = panel
        self.table.object = html_of(panel)
        self.table.css_classes = []

    def show(self, state: State) -> None:
        """Dim the ranking of another state, and say so."""
        self.end()
        if self._panel is None:
            self.table.object = ""
            return
        other = self._panel.key != state.key
        note = '<p class="refused">This ranking is of an earlier state.</p>' if other else ""
        self.table.object = note + html_of(self._panel)
        self.table.css_classes = ["busy"] if other else []


class Export:
    """What is taken along: the experiment as TOML, as Python and as a link, and tables."""

    def __init__(self, state: Callable[[], State], outcome: Callable[[], Outcome]) -> None:
        self._state, self._outcome = state, outcome
        area: dict[str, Any] = {"rows": 8, "sizing_mode": "stretch_width", "max_length": 100_000}
        self.toml = pn.widgets.TextAreaInput(name="The experiment's file (TOML)", **area)
        self.python = pn.widgets.TextAreaInput(name="Python", **area)
        self.link = pn.widgets.TextAreaInput(name="Link", **area | {"rows": 3})
        self.apply = pn.widgets.Button(name="Show this TOML", button_type="primary")
        saved = (
            (lambda: self.csv("trials"), "trials.csv", "Trials (CSV)"),
            (lambda: self.csv("measures"), "measures.csv", "Measures (CSV)"),
            (self.circuit, "circuit.toml", "Edited circuit (TOML)"),
        )
        downloads = [
            pn.widgets.FileDownload(callback=made, filename=name, label=label)
            for made, name, label in saved
        ]
        self.layout = pn.Column(
            pn.FlexBox(*downloads), self.toml, self.apply, self.python, self.link,
            sizing_mode="stretch_width",
        )  # fmt: skip

    def show(self, state: State, address: str) -> None:
        """Show the texts of a state, with the address of the page."""
        self.toml.value = state.experiment.to_toml()
        self.python.value = state.experiment.to_python()
        self.link.value = state.link(address)

    def csv(self, table: str) -> io.BytesIO:
        """Return a table of the outcome of the state that is shown."""
        return io.BytesIO(getattr(self._outcome(), table).to_csv(index=False).encode())

    def circuit(self) -> io.BytesIO:
        """Return the file of the edited circuit."""
        from circuits.declaration.table_files import text

        return io.BytesIO(text(self._state().circuit).encode())
