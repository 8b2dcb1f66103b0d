"""The explorer as one Panel layout, which a template and a notebook show."""

from __future__ import annotations

import io
from collections.abc import Callable
from functools import partial
from html import escape
from typing import Any, ClassVar

import panel as pn
import param
from panel.custom import JSComponent

from bgmodel.explorer.controls import TABLE, WIDE, Controls
from bgmodel.explorer.panels import CIRCUIT, MEASURES, TIMES, TITLES, TRADEOFF, TRIAL, Panel
from bgmodel.explorer.runs import RANKING, PanelRuns
from bgmodel.explorer.state import ExplorerState, History
from circuits.errors import quiet

LOSSES = "Which loss slows decisions?"
COMPUTING = "Computing…"
FIRST = "Computing… After an installation, engines are first compiled, which takes a minute."
COLUMNS = ((CIRCUIT, TIMES, TRADEOFF, RANKING), (MEASURES, TRIAL))
"""Panels of each column of a wide page."""
FILES = {
    "trials.csv": "Trials (CSV)",
    "measures.csv": "Measures (CSV)",
    "circuit.toml": "Edited circuit (TOML)",
}
"""Files that can be saved, and their labels."""


class Drawing(JSComponent):
    """The drawing of the circuit; a click on a nucleus or a pathway reports its name."""

    object = param.String(default="")
    chosen = param.String(default="")
    clicks = param.Integer(default=0)
    _esm = """
    export function render({ model }) {
      const box = document.createElement("div");
      box.setAttribute("role", "img");
      box.setAttribute("aria-label", "The circuit; its rows are in the table below");
      const draw = () => { box.innerHTML = model.object; };
      draw();
      model.on("object", draw);
      box.addEventListener("click", (event) => {
        const row = event.target.closest("g[id*='_'], g[id]");
        if (!row) return;
        model.chosen = row.id;
        model.clicks += 1;
      });
      return box;
    }
    """
    _stylesheets: ClassVar[list[str]] = ["svg { width: 100%; height: auto; }"]


class View:
    """A card with the figure, the tables and the words of one panel."""

    def __init__(self, name: str, title: str, *above: Any) -> None:
        self.panel: Panel | None = None
        self._title = title
        self.figure = Drawing(**WIDE) if name == CIRCUIT else pn.pane.SVG(None, **WIDE)
        self.tables = pn.Column(styles={"overflow-x": "auto"}, **WIDE)
        self.words = pn.pane.HTML("", **WIDE)
        rows = pn.pane.HTML("", **WIDE)
        self.folded = pn.Card(rows, title="All rows as tables", collapsed=True, visible=False)
        self.save = pn.widgets.FileDownload(
            callback=lambda: io.BytesIO(self.panel.svg.encode() if self.panel else b""),
            filename=f"{name}.svg",
            label="Save as SVG",
            visible=False,
        )
        parts = (self.figure, self.tables, self.words, self.folded, self.save)
        self.body = pn.Column(*parts, loading=name != RANKING, **WIDE)
        self.card = pn.Card(*above, self.body, title=title, collapsible=False, **WIDE)

    def show(self, panel: Panel) -> None:
        """Show a panel."""
        self.panel = panel
        self.card.title = f"{self._title} (circuit {panel.digest[:8]})"
        if isinstance(self.figure, Drawing):
            self.figure.object = panel.svg
        else:
            self.figure.param.update(object=panel.svg or None, alt_text=panel.text)
        self.tables[:] = [pn.pane.DataFrame(table, **TABLE) for table in panel.tables]
        refused = "Refused: " if panel.refused else ""
        self.words.object = "".join(
            f"<p>{escape(x)}</p>" for x in (refused + panel.text).split("\n")
        )
        self.folded[0].object, self.folded.visible = panel.folded, bool(panel.folded)
        self.save.visible = bool(panel.svg)
        self.body.loading = False


class Explorer:
    """One user's explorer: the history of states, the runs, and the widgets.

    ``address`` begins the links; ``later`` executes a call in the thread of the page.
    """

    def __init__(
        self,
        state: ExplorerState,
        address: str = "",
        later: Callable[[Callable[[], None]], None] | None = None,
    ) -> None:
        self.history = History(state)
        self._address, self._later = address, later or (lambda call: call())
        self.controls = Controls(self.change)
        trial = self.controls.widgets["trial"]
        self.views = {n: View(n, t, *([trial] if n == TRIAL else [])) for n, t in TITLES.items()}
        drawing = self.views[CIRCUIT].figure
        drawing.param.watch(lambda _: self.controls.choose(drawing.chosen), "clicks")
        self._ranking()
        self._export()
        self._head()
        results = [pn.Column(*(self.views[n].card for n in names), **WIDE) for names in COLUMNS]
        results[-1].append(self.export)
        columns = [pn.Column(*self.controls.cards, **WIDE), *results]
        for column, width in zip(columns, (300, 400, 400), strict=True):
            column.styles = {"flex": f"1 1 {width}px", "min-width": "0"}
        self.body = pn.Column(self.notices, pn.FlexBox(*columns), **WIDE)
        self.runs = PanelRuns(
            lambda panel: self._later(lambda: self._deliver(panel)),
            lambda state, ranked: self._later(lambda: self._ended(state, ranked)),
        )
        self._show()

    @property
    def state(self) -> ExplorerState:
        """The state that is shown."""
        return self.history.state

    @property
    def panels(self) -> list[Panel]:
        """The panels of the state that are computed."""
        every = (self.views[name].panel for name in TITLES)
        return [panel for panel in every if panel and panel.key == self.state.key]

    # ---- widgets

    def _head(self) -> None:
        """Make the buttons of the history, the status and the notices."""
        self.buttons = {
            name: pn.widgets.Button(name=name, width=70) for name in ("Undo", "Redo", "Reset")
        }
        for name, button in self.buttons.items():
            button.on_click(lambda _, name=name: self._step(name))
        self.status = pn.pane.HTML("", **WIDE)
        self.tools = pn.Row(*self.buttons.values())
        self.warnings = pn.pane.Alert("", alert_type="warning", visible=False, **WIDE)
        self.refusal = pn.pane.Alert("", alert_type="danger", **WIDE)
        self.notices = pn.Column(self.status, self.warnings, **WIDE)

    def _ranking(self) -> None:
        """Make the panel of the ranking."""
        self.begin = pn.widgets.Button(name="Rank losses of 10 %", button_type="primary")
        self.cancel = pn.widgets.Button(name="Stop", disabled=True)
        self.begin.on_click(lambda _: self._rank())
        self.cancel.on_click(lambda _: self._cancel())
        self.views[RANKING] = View(RANKING, LOSSES, pn.Row(self.begin, self.cancel))

    def _export(self) -> None:
        """Make the texts and downloads that save the state."""
        self.texts = {
            name: pn.widgets.TextAreaInput(name=name, rows=8, max_length=100_000, **WIDE)
            for name in ("The experiment's file (TOML)", "Python", "Link")
        }
        saves = [
            pn.widgets.FileDownload(callback=partial(self.file, name), filename=name, label=label)
            for name, label in FILES.items()
        ]
        parts = (pn.FlexBox(*saves), *self.texts.values())
        self.export = pn.Card(*parts, title="Save", collapsible=False, **WIDE)

    @quiet()
    def file(self, name: str) -> io.BytesIO:
        """Return a file of the state; the outcome is computed if it is not known."""
        if name == "circuit.toml":
            return io.BytesIO(self.state.circuit.to_toml().encode())
        key, outcome = self.runs.memory.outcome or ("", None)
        if outcome is None or key != self.state.key:
            outcome = self.state.experiment.run()
        table = getattr(outcome, name.removesuffix(".csv"))
        return io.BytesIO(table.to_csv(index=False).encode())

    # ---- what a user does

    @quiet()  # the panels show warnings
    def change(self, make: Callable[[ExplorerState], ExplorerState], widget: Any = None) -> None:
        """Change the state; an error is shown below the widget, and the state stays."""
        before = self.state
        try:
            self.history.go(make(before))
        except (ValueError, OSError) as error:
            self.refuse(str(error), widget)
            return
        if self.state is not before:
            self._show()
        else:
            # Browsers report Enter twice, as text and as a key: the run continues.
            self.controls.show(before)
            self._accept()

    def stop(self, *, wait: bool = False) -> None:
        """Cancel the runs when the page is closed."""
        self.runs.stop(wait=wait)

    def _step(self, name: str) -> None:
        """Undo, redo or reset."""
        getattr(self.history, name.lower())()
        self._show()

    def _rank(self) -> None:
        self.begin.disabled, self.cancel.disabled = True, False
        self.runs.rank(self.state)

    def _cancel(self) -> None:
        self.begin.disabled, self.cancel.disabled = False, True
        self.runs.cancel()

    # ---- showing

    @quiet()
    def _show(self) -> None:
        """Show the state and compute its panels; until then the old ones are dimmed."""
        state = self.state
        with pn.io.hold():  # one message to the browser instead of fifty
            self._accept()
            self._notice()
            self.controls.show(state)
            self._cancel()
            self.buttons["Undo"].disabled = not self.history.past
            self.buttons["Redo"].disabled = not self.history.undone
            experiment = state.experiment
            texts = experiment.to_toml(), experiment.to_python(), state.link(self._address)
            for area, text in zip(self.texts.values(), texts, strict=True):
                area.value = text
            for name in TITLES:
                self.views[name].body.loading = True
            if (ranking := self.views[RANKING]).panel:
                earlier = "" if ranking.panel.key == state.key else " (ranking of another state)"
                ranking.card.title = LOSSES + earlier
            self._say(COMPUTING if self.views[MEASURES].panel else FIRST)
        self.runs.show(state)

    def _deliver(self, panel: Panel) -> None:
        """Show a panel, unless the state has changed since."""
        if panel.key == self.state.key:
            with pn.io.hold():
                self.views[panel.name].show(panel)
                self._notice()

    def _notice(self) -> None:
        """Show the warnings of the panels of the state."""
        notes = dict.fromkeys(note for panel in self.panels for note in panel.warnings)
        self.warnings.object = "\n\n".join(f"Warning: {escape(note)}" for note in notes)
        self.warnings.visible = bool(notes)

    def refuse(self, sentence: str, widget: Any = None) -> None:
        """Show the error below the widget, which keeps the rejected input, or above the results."""
        self._accept()
        self.refusal.object = f'<span role="alert">Refused: {escape(sentence)}</span>'
        cards = [*self.controls.cards, self.views[TRIAL].card, self.export]
        card = next((one for one in cards if widget in one.objects), self.notices)
        below = 1 + card.objects.index(widget) if widget in card.objects else 0
        card.insert(below, self.refusal)
        self._refused = card

    def _accept(self) -> None:
        """Remove the error."""
        if (card := getattr(self, "_refused", None)) is not None:
            card.remove(self.refusal)
            self._refused = None

    def _ended(self, state: ExplorerState, ranked: bool) -> None:
        if ranked:  # else a ranking may be waiting, which can be stopped
            self.begin.disabled, self.cancel.disabled = False, True
        if state == self.state:
            self._say("Up to date.")

    def _say(self, text: str) -> None:
        name, circuit = self.state.experiment.name, self.state.experiment.circuit
        self.status.object = (
            '<span role="status" aria-live="polite">'
            f"<b>{escape(circuit)}</b>, {escape(name)}. {escape(text)}</span>"
        )

    # ---- layouts

    def template(self) -> Any:
        """Return the page for a server."""
        return pn.template.BootstrapTemplate(
            title="bgmodel explorer", header=[self.tools], main=[self.body]
        )

    def layout(self) -> Any:
        """Return the page for a notebook."""
        return pn.Column(self.tools, self.body, **WIDE)
