"""The explorer's controls: widgets that change the state, and show it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import panel as pn

from bgmodel.bootstrap import FEWEST_TRIALS
from bgmodel.experiments.experiment import shipped_names
from bgmodel.explorer import rows
from bgmodel.explorer.state import MOST_TRIALS, State, opened
from bgmodel.explorer.style import TABLE
from circuits.anatomy import CIRCUITS

Change = Callable[[Callable[[State], State], Any], None]
"""Applies a change to the state that is shown; a refusal is shown by the widget."""
CHOOSE = "(choose)"
NUMBERS: dict[str, tuple[str, str, type, float]] = {
    "d_prime": ("Discriminability d′ per reading", "task", float, 0.05),
    "channels": ("Alternatives N", "task", int, 1),
    "conflict": ("Conflict (0 none, below 1)", "task", float, 0.1),
    "t_max": ("Readings until the deadline", "task", int, 10),
    "step_ms": ("Time between readings (ms)", "task", float, 10),
    "trials": (f"Trials ({FEWEST_TRIALS} to {MOST_TRIALS})", "task", int, 100),
    "seed": ("Seed", "run", int, 1),
    "posterior": ("Stopping posterior", "run", float, 0.01),
    "threshold": ("Or threshold on OUT", "run", float, 0.05),
    "gain": ("Gain (empty: the circuit's)", "run", float, 0.05),
    "trial": ("Trial shown in spikes", "trial", int, 1),
}
"""Numbers of the state: label, group, type and step."""
STOP = {"share": "Share of stop trials", "delay_ms": "Delay to the nucleus (ms)"}


class Controls:
    """Widgets of the task and of the circuit."""

    def __init__(self, change: Change) -> None:
        self._change, self._showing = change, False
        self.open = self._opening()
        self.numbers = {name: self._number(name) for name in NUMBERS}
        self.evidence = pn.widgets.TextInput(
            name="Evidence table instead (.csv, .parquet)", placeholder="path, then Enter"
        )
        self._on(
            self.evidence, lambda text: lambda s: s.with_setting("evidence", text.strip() or None)
        )
        self._circuit_widgets()
        self._stop_widgets()

    # ---- making widgets

    def _on(self, widget: Any, made: Callable[[Any], Callable[[State], State]]) -> None:
        """Change the state when a widget changes, but not when the state changes the widget."""

        def changed(event: Any) -> None:
            if not self._showing:
                self._change(made(event.new), widget)

        widget.param.watch(changed, "value")

    def _number(self, name: str) -> Any:
        label, _, kind, step = NUMBERS[name]
        widget = (pn.widgets.IntInput if kind is int else pn.widgets.FloatInput)(
            name=label, step=kind(step), value=None, sizing_mode="stretch_width"
        )
        self._on(widget, partial(_setting, name))
        return widget

    def _opening(self) -> Any:
        groups = {
            "": [CHOOSE],
            "Circuits": [*CIRCUITS],
            "Experiments": shipped_names(),
        }
        self.preset = pn.widgets.Select(name="Circuit or included experiment", groups=groups)
        self.file = pn.widgets.TextInput(
            name="Or a file of either (.toml), or a link", placeholder="path, then Enter"
        )
        for widget in (self.preset, self.file):
            self._on(widget, lambda name: lambda s: s if name in ("", CHOOSE) else opened(name))
        return pn.Column(self.preset, self.file, sizing_mode="stretch_width")

    def _circuit_widgets(self) -> None:
        self.row = pn.widgets.Select(
            name="Nucleus or pathway (or click it in the drawing)", groups={"": [""]}
        )
        self.row.param.watch(lambda _: self._show_row(), "value")
        self.about_row = pn.pane.HTML("", stylesheets=[TABLE])
        self.quick = {
            "lesion": pn.widgets.FloatInput(name="Lesion: cells lost (%)", step=5),
            "cut": pn.widgets.FloatInput(name="Cut: axons lost (%)", step=5),
            "scale": pn.widgets.FloatInput(name="Scale: weight times", step=0.1),
        }
        for verb, widget in self.quick.items():
            self._on(widget, partial(self._amount, verb))
        self.field = pn.widgets.Select(name="Set a field", options=[])
        self.field.param.watch(lambda _: self._show_field(), "value")
        self.value = pn.widgets.TextInput(name="to (then Enter)")
        self._on(
            self.value,
            lambda text: lambda s: s.edited(f"set {self.row.value}.{self.field.value} {text}"),
        )
        self.dopamine = pn.widgets.FloatInput(name="Dopamine level (1 is normal)", step=0.05)
        self._on(self.dopamine, lambda x: lambda s: rows.with_dopamine(s, x))
        self.kind = pn.widgets.Select(
            name="Examples of edits", options={CHOOSE: "", **rows.EXAMPLES}
        )
        self.line = pn.widgets.TextInput(name="New edit (then Enter)", placeholder="lesion STN 10%")
        self.kind.param.watch(
            lambda event: self.line.param.update(
                value_input=event.new, placeholder=event.new or "lesion STN 10%"
            ),
            "value",
        )
        self._on(self.line, lambda text: lambda s: s.edited(text) if text.strip() else s)
        self.line.param.watch(lambda _: self._take_example(), "enter_pressed")
        self.source = pn.widgets.Select(name="From", options=[])
        self.target = pn.widgets.Select(name="To", options=[])
        self.weight = pn.widgets.FloatInput(
            name="Weight (negative: inhibits)", value=-0.1, step=0.05
        )
        self.delay = pn.widgets.FloatInput(name="Delay (ms)", value=4.0, step=1, start=0)
        self.add = pn.widgets.Button(name="Add pathway", button_type="primary")
        self.add.on_click(lambda _: self._change(self._added, self.add))

    def _amount(self, verb: str, number: float) -> Callable[[State], State]:
        """Return the change by a lesion, a cut or a scaling of the chosen row."""
        return lambda state: rows.with_amount(state, verb, self.row.value, number)

    def _added(self, state: State) -> State:
        return state.edited(
            rows.new_pathway(
                self.source.value,
                self.target.value,
                self.weight.value or 0.0,
                self.delay.value or 0.0,
            )
        )

    def _take_example(self) -> None:
        """Apply an example as it stands; browsers report a text only where it was typed in."""
        if self.kind.value and self.line.value_input == self.kind.value:
            text, self.kind.value = self.kind.value, ""
            self.line.value = text

    def _stop_widgets(self) -> None:
        options = {"in no trial": False, "in a share of the trials": True}
        self.stops = pn.widgets.Select(name="Stop signals", options=options)
        self._on(self.stops, lambda on: lambda s: s.with_setting("stop", on or None))
        self.stop = {
            name: pn.widgets.FloatInput(name=label, step=0.05 if name == "share" else 10)
            for name, label in STOP.items()
        }
        for name, widget in self.stop.items():
            self._on(widget, partial(_setting, f"stop.{name}"))

    # ---- showing a state

    def show(self, state: State) -> None:
        """Set every widget to a state, without changing it."""
        self._showing, self._state = True, state
        try:
            self._show(state)
        finally:
            self._showing = False

    def _show(self, state: State) -> None:
        task, experiment = state.experiment.task, state.experiment
        for name, widget in self.numbers.items():
            record = {"task": task, "run": experiment, "trial": state}[NUMBERS[name][1]]
            widget.value = getattr(record, name)
            drawn = NUMBERS[name][1] != "task" or name == "step_ms" or task.file is None
            widget.disabled = not drawn
        self.evidence.value = str(task.file or "")
        self.preset.value, self.file.value, self.line.value = CHOOSE, "", ""
        self.dopamine.value = rows.dopamine(state)
        stop = experiment.stop
        self.stops.value = stop is not None
        for name, widget in self.stop.items():
            widget.visible = stop is not None
            widget.value = None if stop is None else getattr(stop, name)
        groups = rows.names(state)
        if self.row.groups != groups:
            kept = self.row.value
            self.row.param.update(groups=groups, value=self._row_in(groups, kept))
            nuclei = groups["Nuclei"]
            for widget in (self.source, self.target):
                kept = widget.value if widget.value in nuclei else nuclei[0]
                widget.param.update(options=nuclei, value=kept)
        self._show_row()

    @staticmethod
    def _row_in(groups: dict[str, list[str]], kept: str) -> str:
        known = [name for names in groups.values() for name in names]
        return kept if kept in known else "STN" if "STN" in known else known[0]

    def choose(self, name: str) -> None:
        """Choose a row of the circuit."""
        if name in self._state.circuit:
            self.row.value = name

    def _show_row(self) -> None:
        state, name = self._state, self.row.value
        was, self._showing = self._showing, True
        try:
            self.about_row.object = rows.table(state, name)
            for verb, widget in self.quick.items():
                widget.visible = (verb == "lesion") != ("->" in name)
                if widget.visible:
                    widget.value = rows.amount(state, verb, name)
            fields = list(rows.values(state.circuit.row(name)))
            if self.field.options != fields:
                self.field.param.update(options=fields, value=_usual(fields))
            self._show_field()
        finally:
            self._showing = was

    def _show_field(self) -> None:
        was, self._showing = self._showing, True
        row = rows.values(self._state.circuit.row(self.row.value))
        self.value.value = row.get(self.field.value, "")
        self._showing = was


def _setting(name: str, value: Any) -> Callable[[State], State]:
    """Return the change of a setting."""
    return lambda state: state.with_setting(name, value)


def _usual(fields: list[str]) -> str:
    """Return the field that is set most often: the weight of a pathway, the bias of a nucleus."""
    return next(name for name in ("weight", "bias_nats", *fields) if name in fields)
