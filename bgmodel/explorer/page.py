"""The explorer's page: controls and panels, laid out with Panel."""

from __future__ import annotations

import io
from collections.abc import Callable
from html import escape
from typing import Any

import panel as pn

from bgmodel.experiments.experiment import Experiment
from bgmodel.explorer.components import Drawing, Page
from bgmodel.explorer.controls import NUMBERS, Controls
from bgmodel.explorer.history import History
from bgmodel.explorer.html import html_of
from bgmodel.explorer.panels import CIRCUIT, MEASURES, TIMES, TITLES, TRADEOFF, TRIAL, Memory, Panel
from bgmodel.explorer.runs import Runs
from bgmodel.explorer.state import State, opened
from bgmodel.explorer.style import CHIP, NOTICE, PAGE, PANEL

COMPUTING = "Computing…"
FIRST = "Computing… Engines are compiled when they first run after an installation: a minute."
COLUMNS = ((CIRCUIT, TIMES, TRADEOFF), (MEASURES, TRIAL))
"""Panels of each column of a wide page, in the order in which an edit changes them."""


class Explorer:
    """One user's explorer: a history of states, the runs behind it, and its widgets.

    Parameters
    ----------
    state : State
        The first state.
    address : str
        The address of the page, to which links lead; empty in a notebook.
    later : function, optional
        Runs a function in the thread of the page; by default at once.
    memory : Memory, optional
        Results that are known already.

    Raises
    ------
    ValueError
        If the state is refused.
    """

    def __init__(
        self,
        state: State,
        address: str = "",
        later: Callable[[Callable[[], None]], None] | None = None,
        memory: Memory | None = None,
    ) -> None:
        self.history = History(state)
        self._address, self._later = address, later or (lambda call: call())
        self.shown: dict[str, Panel] = {}
        self.controls = Controls(self.change, self.open)
        self._make_widgets()
        self.runs = Runs(
            lambda panel: self._later(lambda: self._deliver(panel)),
            lambda state: self._later(lambda: self._ended(state)),
            memory=memory,
        )
        self._show()

    @property
    def state(self) -> State:
        """The state that is shown."""
        return self.history.state

    # ---- what a user does

    def change(self, made: Callable[[State], State]) -> None:
        """Apply a change of the state; a refusal is shown, and the state stays."""
        before = self.state
        try:
            self.history.go(made(before))
        except (ValueError, OSError) as error:
            self.refuse(str(error))
            return
        if self.state is not before:
            self._show()
        else:
            # The browser reports an Enter twice, with the text and as a key: keep the run.
            self.controls.show(before)

    def open(self, name: str) -> None:
        """Open a circuit, an experiment or a link."""
        self.change(lambda _: opened(name))

    def stop(self) -> None:
        """End the runs: the page is closed."""
        self.runs.stop()

    def _step(self, move: Callable[[], None]) -> None:
        move()
        self._show()

    # ---- widgets

    def _make_widgets(self) -> None:
        self.undo = pn.widgets.Button(name="Undo", width=70)
        self.redo = pn.widgets.Button(name="Redo", width=70)
        self.reset = pn.widgets.Button(name="Reset", width=70)
        for button, move in (
            (self.undo, self.history.undo),
            (self.redo, self.history.redo),
            (self.reset, self.history.reset),
        ):
            button.on_click(lambda _, move=move: self._step(move))
        self.baseline = pn.widgets.Button(name="Use the edited circuit as the baseline")
        self.baseline.on_click(lambda _: self.change(State.as_baseline))
        self.status = pn.pane.HTML("", stylesheets=[NOTICE])
        self.notices = pn.pane.HTML("", stylesheets=[NOTICE], margin=0)
        self.refused = ""
        self.drawing = Drawing()
        self.drawing.param.watch(lambda _: self.controls.choose(self.drawing.chosen), "clicks")
        self.panes = {
            name: pn.pane.HTML(
                f'<p class="waiting">{COMPUTING}</p>',
                stylesheets=[PANEL],
                sizing_mode="stretch_width",
            )
            for name in TITLES
        }
        self.list = pn.Column(sizing_mode="stretch_width")
        self._make_export()

    def _make_export(self) -> None:
        area: dict[str, Any] = {"rows": 8, "sizing_mode": "stretch_width", "max_length": 100_000}
        self.toml = pn.widgets.TextAreaInput(name="The experiment's file (TOML)", **area)
        self.python = pn.widgets.TextAreaInput(name="Python", **area)
        self.link = pn.widgets.TextAreaInput(name="Link", **area | {"rows": 3})
        self.apply = pn.widgets.Button(name="Show this TOML", button_type="primary")
        self.apply.on_click(
            lambda _: self.change(lambda _: State(Experiment.from_text(self.toml.value)))
        )
        self.trials_csv = pn.widgets.FileDownload(
            callback=lambda: self._csv("trials"), filename="trials.csv", label="Trials (CSV)"
        )
        self.measures_csv = pn.widgets.FileDownload(
            callback=lambda: self._csv("measures"), filename="measures.csv", label="Measures (CSV)"
        )
        self.circuit_toml = pn.widgets.FileDownload(
            callback=self._circuit_file, filename="circuit.toml", label="Edited circuit (TOML)"
        )

    def _csv(self, table: str) -> io.BytesIO:
        """Return a table of the state that is shown, which is computed unless it is there."""
        key, outcome = self.runs.memory.outcome or ("", None)
        if outcome is None or key != self.state.key:
            outcome = self.state.experiment.run()
        return io.BytesIO(getattr(outcome, table).to_csv(index=False).encode())

    def _circuit_file(self) -> io.BytesIO:
        from circuits.declaration.table_files import text

        return io.BytesIO(text(self.state.circuit).encode())

    # ---- showing

    def _show(self) -> None:
        """Show the state, and have its panels computed; until then the old ones are dimmed."""
        with pn.io.hold():  # one message to the browser instead of fifty
            self._show_widgets(self.state)
        self.runs.show(self.state)

    def _show_widgets(self, state: State) -> None:
        self.refused = ""
        self._notice()
        self.controls.show(state)
        self.undo.disabled = not self.history.can_undo
        self.redo.disabled = not self.history.can_redo
        self.baseline.disabled = state.alike
        self.list[:] = self._edits(state)
        self.toml.value = state.experiment.to_toml()
        self.python.value = state.experiment.to_python()
        self.link.value = state.link(self._address)
        for pane in (*self.panes.values(), self.drawing):
            pane.css_classes = ["busy"]
        self._say(COMPUTING if self.shown else FIRST)

    def _edits(self, state: State) -> list[Any]:
        """Return a line for each edit, with a button that removes it."""
        if not state.edits:
            return [pn.pane.HTML("<p>None: the baseline is shown alone.</p>", stylesheets=[PANEL])]
        found = []
        for line in state.edits:
            remove = pn.widgets.Button(
                name=f"Remove {line}", stylesheets=[CHIP], sizing_mode="stretch_width"
            )
            remove.on_click(lambda _, line=line: self.change(lambda s: s.without(line)))
            found.append(remove)
        return found

    def _deliver(self, panel: Panel) -> None:
        """Show a panel, unless the state has changed since."""
        if panel.key != self.state.key:
            return
        self.shown[panel.name] = panel
        with pn.io.hold():
            self._show_panel(panel)

    def _show_panel(self, panel: Panel) -> None:
        pane = self.panes[panel.name]
        pane.object = html_of(panel)
        pane.css_classes = []
        if panel.name == CIRCUIT:
            self.drawing.svg = panel.svg
            self.drawing.css_classes = []
        self._notice()

    def _notice(self) -> None:
        """Show why the last change was refused, and the warnings of the panels of this state."""
        parts = [
            f'<p class="warning" role="status">Warning: {escape(note)}</p>'
            for note in self._warnings()
        ]
        if self.refused:
            why = escape(self.refused)
            parts.insert(0, f'<p class="refusal" role="alert">Refused: {why}</p>')
        self.notices.object = "".join(parts)

    def _warnings(self) -> list[str]:
        """Return the warnings of the panels of this state, each once."""
        key = self.state.key
        said = (note for p in self.shown.values() if p.key == key for note in p.warnings)
        return [*dict.fromkeys(said)]

    def refuse(self, sentence: str) -> None:
        """Show why a change was refused, and the state that stays."""
        self.controls.show(self.state)
        self.refused = sentence
        self._notice()

    def _ended(self, state: State) -> None:
        if state == self.state:
            count = len(self._warnings())
            above = f" {count} warning{'s' if count > 1 else ''} above the results."
            self._say("Up to date." + (above if count else ""))

    def _say(self, text: str) -> None:
        name, circuit = self.state.experiment.name, self.state.experiment.circuit
        self.status.object = (
            '<p class="status" role="status" aria-live="polite">'
            f"<strong>{escape(circuit)}</strong>, {escape(name)}. {escape(text)}</p>"
        )

    # ---- layout

    def parts(self) -> dict[str, Any]:
        """Return the parts of the page by name."""
        c = self.controls
        column: Callable[..., Any] = lambda *of: pn.Column(*of, sizing_mode="stretch_width")  # noqa: E731
        of = {
            group: [c.numbers[n] for n in NUMBERS if NUMBERS[n][1] == group]
            for group in ("task", "run")
        }
        circuit = column(self.drawing, self.panes[CIRCUIT])
        return {
            "tools": pn.Row(self.undo, self.redo, self.reset),
            "status": self.status,
            "edits": column(self.list, c.line, c.kind, c.dopamine, self.baseline),
            "row": column(c.row, *c.quick.values(), c.field, c.value, c.about_row),
            "pathway": column(c.source, c.target, c.weight, c.delay, c.add),
            "task": column(*of["task"], *of["run"], c.evidence),
            "stop": column(c.stops, *c.stop.values()),
            "open": c.open,
            "notices": self.notices,
            **self.panes,
            CIRCUIT: circuit,
            TRIAL: column(c.numbers["trial"], self.panes[TRIAL]),
            "export": column(
                pn.FlexBox(self.trials_csv, self.measures_csv, self.circuit_toml),
                self.toml, self.apply, self.python, self.link,
            ),
        }  # fmt: skip

    def template(self) -> Any:
        """Return the page for a server."""
        page = Page(PAGE)
        page.add_variable("titles", TITLES)
        page.add_variable("columns", COLUMNS)
        for name, part in self.parts().items():
            page.add_panel(name, part)
        return page

    def layout(self) -> Any:
        """Return the explorer for a notebook."""
        parts = self.parts()
        left = ("edits", "row", "pathway", "task", "stop", "open")
        return pn.Column(
            pn.Row(parts["tools"], parts["status"]),
            parts["notices"],
            pn.Row(
                pn.Column(*(parts[name] for name in left), width=320),
                pn.FlexBox(*(pn.Column(parts[name], width=470) for name in (*TITLES, "export"))),
            ),
        )
