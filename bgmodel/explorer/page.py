"""The explorer's page: controls and panels, laid out with Panel."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from typing import Any

import panel as pn

from bgmodel.experiments.experiment import Experiment, Outcome
from bgmodel.explorer.components import Drawing, Export, Page, Ranking, Refusal
from bgmodel.explorer.controls import NUMBERS, Controls
from bgmodel.explorer.history import History
from bgmodel.explorer.html import (
    CIRCUIT,
    MEASURES,
    RANKING,
    TIMES,
    TITLES,
    TRADEOFF,
    TRIAL,
    Panel,
    html_of,
)
from bgmodel.explorer.panels import Memory
from bgmodel.explorer.runs import Runs
from bgmodel.explorer.state import State
from bgmodel.explorer.style import CHIP, NOTICE, PAGE, PANEL
from circuits.errors import quiet

COMPUTING = "Computing…"
FIRST = "Computing… Engines are compiled when they first run after an installation: a minute."
COLUMNS = ((CIRCUIT, TIMES, TRADEOFF), (MEASURES, TRIAL))
"""Panels of each column of a wide page, in the order in which an edit changes them."""


class Explorer:
    """One user's explorer: a history of states, the runs behind it, and its widgets."""

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
        self.controls = Controls(self.change)
        self._make_buttons()
        self._make_widgets()
        self.parts = self._make_parts()
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

    @quiet()  # the panels compute them again, and show them
    def change(self, made: Callable[[State], State], widget: Any = None) -> None:
        """Apply a change of the state; a refusal is shown by the widget, and the state stays."""
        before = self.state
        try:
            self.history.go(made(before))
        except (ValueError, OSError) as error:
            self.refuse(str(error), widget)
            return
        if self.state is not before:
            self._show()
        else:
            # The browser reports an Enter twice, with the text and as a key: keep the run.
            self.controls.show(before)
            self.refusal.hide()

    def stop(self) -> None:
        """End the runs: the page is closed."""
        self.runs.stop()

    def _step(self, move: Callable[[], None]) -> None:
        move()
        self._show()

    # ---- widgets

    def _make_buttons(self) -> None:
        self.undo = pn.widgets.Button(name="Undo", width=70)
        self.redo = pn.widgets.Button(name="Redo", width=70)
        self.reset = pn.widgets.Button(name="Reset", width=70)
        for button, move in (
            (self.undo, self.history.undo),
            (self.redo, self.history.redo),
            (self.reset, self.history.reset),
        ):
            button.on_click(lambda _, move=move: self._step(move))
        self.control = pn.widgets.Button(name="Use the edited circuit as the control")
        self.control.on_click(lambda _: self.change(State.as_control, self.control))

    def _make_widgets(self) -> None:
        self.status = pn.pane.HTML("", stylesheets=[NOTICE])
        self.notices = pn.pane.HTML("", stylesheets=[NOTICE], margin=0)
        self.refusal = Refusal()
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
        self.ranking = Ranking(self._rank, self._cancel)
        self.export = Export(lambda: self.state, self._outcome)
        self.export.apply.on_click(
            lambda _: self.change(
                lambda _: State(Experiment.from_text(self.export.toml.value)), self.export.apply
            )
        )

    @quiet()
    def _outcome(self) -> Outcome:
        """Return the outcome of the state that is shown, which is computed unless it is there."""
        key, outcome = self.runs.memory.outcome or ("", None)
        return outcome if outcome and key == self.state.key else self.state.experiment.run()

    def _rank(self) -> None:
        self.ranking.start()
        self.runs.rank(self.state)

    def _cancel(self) -> None:
        self.runs.cancel()
        self.ranking.end()

    # ---- showing

    @quiet()
    def _show(self) -> None:
        """Show the state, and have its panels computed; until then the old ones are dimmed."""
        with pn.io.hold():  # one message to the browser instead of fifty
            self._show_widgets(self.state)
        self.runs.show(self.state)

    def _show_widgets(self, state: State) -> None:
        self.refusal.hide()
        self._notice()
        self.controls.show(state)
        self.ranking.show(state)
        self.undo.disabled = not self.history.can_undo
        self.redo.disabled = not self.history.can_redo
        self.control.disabled = state.alike
        self.list[:] = self._edits(state)
        self.export.show(state, self._address)
        for pane in (*self.panes.values(), self.drawing):
            pane.css_classes = ["busy"]
        self._say(COMPUTING if self.shown else FIRST)

    def _edits(self, state: State) -> list[Any]:
        """Return a line for each edit, with a button that removes it."""
        if not state.edits:
            return [pn.pane.HTML("<p>None: the control is shown alone.</p>", stylesheets=[PANEL])]
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
        if panel.name == RANKING:
            self.ranking.deliver(panel)
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
        """Show the warnings of the panels of this state."""
        self.notices.object = "".join(
            f'<p class="warning" role="status">Warning: {escape(note)}</p>'
            for note in self._warnings()
        )

    def _warnings(self) -> list[str]:
        """Return the warnings of the panels of this state, each once."""
        key = self.state.key
        said = (note for p in self.shown.values() if p.key == key for note in p.warnings)
        return [*dict.fromkeys(said)]

    def refuse(self, sentence: str, widget: Any = None) -> None:
        """Show why a change was refused, by the widget in which it stays as it was typed."""
        self.refusal.show(sentence, widget, self.columns)

    def _ended(self, state: State) -> None:
        self.ranking.end()
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

    def _make_parts(self) -> dict[str, Any]:
        """Return the parts of the page by name."""
        c = self.controls
        column: Callable[..., Any] = lambda *of: pn.Column(*of, sizing_mode="stretch_width")  # noqa: E731
        of = {
            group: [c.numbers[n] for n in NUMBERS if NUMBERS[n][1] == group]
            for group in ("task", "run")
        }
        return {
            "tools": pn.Row(self.undo, self.redo, self.reset),
            "status": self.status,
            "edits": column(self.list, c.line, c.kind, c.dopamine, self.control),
            "row": column(c.row, *c.quick.values(), c.field, c.value, c.about_row),
            "pathway": column(c.source, c.target, c.weight, c.delay, c.add),
            "task": column(*of["task"], *of["run"], c.evidence),
            "stop": column(c.stops, *c.stop.values()),
            "open": c.open,
            "notices": column(self.notices),
            **self.panes,
            CIRCUIT: column(self.drawing, self.panes[CIRCUIT]),
            TRIAL: column(c.numbers["trial"], self.panes[TRIAL]),
            RANKING: self.ranking.layout,
            "export": self.export.layout,
        }

    @property
    def columns(self) -> list[Any]:
        """The columns in which a refusal can be shown, the one above the results first."""
        return [self.parts["notices"], *(p for p in self.parts.values() if hasattr(p, "insert"))]

    def template(self) -> Any:
        """Return the page for a server."""
        page = Page(PAGE)
        page.add_variable("titles", TITLES)
        page.add_variable("columns", COLUMNS)
        for name, part in self.parts.items():
            page.add_panel(name, part)
        return page

    def layout(self) -> Any:
        """Return the explorer for a notebook."""
        parts = self.parts
        left = ("edits", "row", "pathway", "task", "stop", "open")
        right = (*TITLES, RANKING, "export")
        return pn.Column(
            pn.Row(parts["tools"], parts["status"]),
            parts["notices"],
            pn.Row(
                pn.Column(*(parts[name] for name in left), width=320),
                pn.FlexBox(*(pn.Column(parts[name], width=470) for name in right)),
            ),
        )
