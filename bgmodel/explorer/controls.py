"""The explorer's settings: widgets that show the state and change it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import pandas as pd
import panel as pn

from bgmodel.bootstrap import FEWEST_TRIALS
from bgmodel.experiments.experiment import shipped_names
from bgmodel.explorer import circuit
from bgmodel.explorer.state import MOST_TRIALS, ExplorerState, opened
from circuits.anatomy import CIRCUITS

Change = Callable[[Callable[[ExplorerState], ExplorerState], Any], None]
"""Changes the state; the second argument is the widget below which an error is shown."""
Read = Callable[[ExplorerState], Any]
"""Returns what a widget shows of a state."""
Write = Callable[[ExplorerState, Any], ExplorerState]
"""Returns the state after a new value of a widget."""
CHOOSE = "(choose)"
NUMBERS: dict[str, tuple[str, type, float]] = {
    "d_prime": ("Discriminability d′ per reading", float, 0.05),
    "channels": ("Alternatives N", int, 1),
    "conflict": ("Conflict (0 none, below 1)", float, 0.1),
    "t_max": ("Readings until the deadline", int, 10),
    "step_ms": ("Time between readings (ms)", float, 10),
    "trials": (f"Trials ({FEWEST_TRIALS} to {MOST_TRIALS})", int, 100),
    "seed": ("Seed", int, 1),
    "posterior": ("Stopping posterior", float, 0.01),
    "threshold": ("Or threshold on OUT", float, 0.05),
    "gain": ("Gain (empty: the circuit's)", float, 0.05),
    "trial": ("Trial shown in spikes", int, 1),
    "stop.share": ("Share of stop trials", float, 0.05),
    "stop.delay_ms": ("Delay to the nucleus (ms)", float, 10),
}
"""Settings that are numbers: label, type and step."""
OF_DRAWN = ("d_prime", "channels", "conflict", "t_max", "trials")
"""Settings without an effect on an evidence table."""
OF_TASK = (*OF_DRAWN[:4], "step_ms", "trials", "seed", "posterior", "threshold", "gain", "evidence")
OF_STOP = ("stop", "stop.share", "stop.delay_ms")
QUICK = {
    "lesion": ("Lesion: cells lost (%)", 5.0),
    "cut": ("Cut: axons lost (%)", 5.0),
    "scale": ("Scale: weight times", 0.1),
}
"""Edits of the chosen row by a number: label and step."""
OF_ROW = (*QUICK, "value")
HINT = "Edits add up. Together they are the manipulation, which is compared with the control."
CONFLICT = (
    "Conflict: the evidence also supports one wrong alternative, by this fraction of its support "
    "for the true one."
)
WIDE: dict[str, Any] = {"sizing_mode": "stretch_width"}
TABLE: dict[str, Any] = {
    "index": False,
    "text_align": "start",
    "stylesheets": [".panel-df th { text-align: start; }"],
    **WIDE,
}


class Controls:
    """The widgets of the settings, by name, and the cards that contain them."""

    def __init__(self, change: Change) -> None:
        self._change, self._showing = change, False
        self.widgets: dict[str, Any] = {}
        self._reads: dict[str, Read] = {}
        for name, (label, kind, step) in NUMBERS.items():
            number = pn.widgets.IntInput if kind is int else pn.widgets.FloatInput
            self._setting(name, number(name=label, step=kind(step), value=None, **WIDE))
        self._setting("evidence", _text("Evidence table instead (.csv, .parquet)"))
        options = {"in no trial": False, "in some trials": True}
        self._setting("stop", pn.widgets.Select(name="Stop signals", options=options, **WIDE))
        self._open()
        self._edits()
        self._row()
        w = self.widgets
        self.cards = [
            _card("Open", w["preset"], w["file"]),
            _card(
                "Edits of the circuit", pn.pane.HTML(HINT), self.edits, w["line"], self.examples,
                w["dopamine"], self.control,
            ),
            _card(
                "A row of the circuit", self.row, *(w[name] for name in QUICK), self.field,
                w["value"], self.about_row,
            ),
            _card("Task and decision", *(w[name] for name in OF_TASK), pn.pane.HTML(CONFLICT)),
            _card("Stop signals", *(w[name] for name in OF_STOP), collapsed=True),
        ]  # fmt: skip

    # ---- making widgets

    def _add(self, name: str, widget: Any, read: Read, write: Write) -> None:
        """Add a widget: it changes the state, but not when it is set to show a state."""

        def changed(event: Any) -> None:
            if not self._showing:
                self._change(lambda state: write(state, event.new), widget)

        widget.param.watch(changed, "value")
        self.widgets[name], self._reads[name] = widget, read

    def _setting(self, name: str, widget: Any) -> None:
        """Add the widget of a setting."""
        read, write = lambda s: s.setting(name), lambda s, x: s.with_setting(name, x)
        self._add(name, widget, read, write)

    def _open(self) -> None:
        groups = {"": [CHOOSE], "Circuits": [*CIRCUITS], "Experiments": shipped_names()}
        label = "Circuit or included experiment"
        preset = pn.widgets.Select(name=label, groups=groups, **WIDE)
        self._add("preset", preset, lambda _: CHOOSE, _opened)
        file = _text("Or a file of either (.toml), or a link")
        self._add("file", file, lambda _: "", _opened)

    def _edits(self) -> None:
        line = _text("New edit (then Enter)", "lesion STN 10%")
        self._add("line", line, lambda _: "", lambda s, x: s.edited(x) if x.strip() else s)
        table = pd.DataFrame(circuit.EXAMPLES.items(), columns=["Edit", "Effect"])
        examples = pn.pane.DataFrame(table, **TABLE)
        self.examples = _card("Examples of edits", examples, collapsed=True)
        dopamine = pn.widgets.FloatInput(name="Dopamine level (1 is normal)", step=0.05, **WIDE)
        self._add("dopamine", dopamine, circuit.dopamine, circuit.with_dopamine)
        self.edits = pn.Column(**WIDE)
        self.control = pn.widgets.Button(name="Use the edited circuit as the control")
        self.control.on_click(lambda _: self._change(ExplorerState.as_control, self.control))

    def _row(self) -> None:
        label = "Nucleus or pathway (or click it in the drawing)"
        self.row = pn.widgets.Select(name=label, groups={"": [""]}, **WIDE)
        self.row.param.watch(lambda _: self._show_row(), "value")
        self.about_row = pn.pane.DataFrame(None, **TABLE)
        for verb, (label, step) in QUICK.items():
            widget = pn.widgets.FloatInput(name=label, step=step, **WIDE)
            self._add(verb, widget, partial(self._amount, verb), partial(self._with_amount, verb))
        self.field = pn.widgets.Select(name="Set a field", options=[], **WIDE)
        self.field.param.watch(lambda _: self._show_row(), "value")
        self._add("value", _text("to (then Enter)"), self._field_value, self._with_field)

    # ---- what widgets of the chosen row read and write

    def _amount(self, verb: str, state: ExplorerState) -> float:
        return circuit.amount(state, verb, self.row.value)

    def _with_amount(self, verb: str, state: ExplorerState, number: float | None) -> ExplorerState:
        return circuit.with_amount(state, verb, self.row.value, number)

    def _field_value(self, state: ExplorerState) -> str:
        return circuit.values(state.circuit.row(self.row.value)).get(self.field.value, "")

    def _with_field(self, state: ExplorerState, text: str) -> ExplorerState:
        return state.edited(f"set {self.row.value}.{self.field.value} {text}")

    # ---- showing a state

    def show(self, state: ExplorerState) -> None:
        """Set every widget to a state, without changing it."""
        self._state, self._showing = state, True
        try:
            groups = circuit.names(state)
            if self.row.groups != groups:
                known = [name for names in groups.values() for name in names]
                kept = next(n for n in (self.row.value, "STN", known[0]) if n in known)
                self.row.param.update(groups=groups, value=kept)
            for name, read in self._reads.items():
                if name not in OF_ROW:
                    self.widgets[name].value = read(state)
            for name in OF_DRAWN:
                self.widgets[name].disabled = state.experiment.task.file is not None
            for name in OF_STOP[1:]:
                self.widgets[name].visible = state.experiment.stop is not None
            self.control.disabled = state.alike
            self.edits[:] = [self._remove(line) for line in state.edits]
        finally:
            self._showing = False
        self._show_row()

    def choose(self, name: str) -> None:
        """Choose a row of the circuit."""
        if name in self._state.circuit:
            self.row.value = name

    def _show_row(self) -> None:
        """Show the chosen row."""
        if self._showing:
            return
        state, name = self._state, self.row.value
        self._showing = True
        try:
            self.about_row.object = circuit.table(state, name)
            fields = list(circuit.values(state.circuit.row(name)))
            if self.field.options != fields:
                usual = next(one for one in ("weight", "bias_nats", *fields) if one in fields)
                self.field.param.update(options=fields, value=usual)
            for of_row in OF_ROW:
                self.widgets[of_row].value = self._reads[of_row](state)
            for verb in QUICK:
                self.widgets[verb].visible = (verb == "lesion") != ("->" in name)
        finally:
            self._showing = False

    def _remove(self, line: str) -> Any:
        """Return a button that removes an edit."""
        button = pn.widgets.Button(name=f"Remove {line}", **WIDE)
        button.on_click(lambda _: self._change(lambda state: state.without(line), button))
        return button


def _opened(state: ExplorerState, name: str) -> ExplorerState:
    return state if name in ("", CHOOSE) else opened(name)


def _text(label: str, placeholder: str = "path, then Enter") -> Any:
    return pn.widgets.TextInput(name=label, placeholder=placeholder, **WIDE)


def _card(title: str, *widgets: Any, collapsed: bool = False) -> Any:
    return pn.Card(*widgets, title=title, collapsed=collapsed, **WIDE)
