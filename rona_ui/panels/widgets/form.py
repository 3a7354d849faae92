"""Form: named fields of a step whose values become the arguments of a message."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from rona_ui.labels import note_label
from rona_ui.panels.widgets.panel_context import on_change
from rona_ui.viewer.bindings import Event


class Form:
    """Named fields; ``values()`` returns the arguments of a message."""

    def __init__(self, gui: Any) -> None:
        self._gui = gui
        self._fields: dict[str, Any] = {}
        self._words: dict[str, dict[str, Any]] = {}  # choice -> words to values

    def _add(self, name: str, label: str, field: Any) -> Any:
        note_label(name, label)
        self._fields[name] = field
        return field

    def number(
        self,
        name: str,
        label: str,
        value: float,
        low: float,
        high: float,
        step: float,
        hint: str | None = None,
    ) -> None:
        """Add a number; the core checks the limits once more."""
        limits = {"min": low, "max": high, "step": step}
        self._add(name, label, self._gui.add_number(label, value, **limits, hint=hint))

    def numbers(self, *rows: tuple[Any, ...]) -> None:
        """Add numbers, each by the arguments of ``number``."""
        for row in rows:
            self.number(*row)

    def slider(
        self, name: str, label: str, value: float, low: float, high: float, step: float
    ) -> Any:
        """Add a number that is dragged, and return its widget."""
        return self._add(name, label, self._gui.add_slider(label, low, high, step, value))

    def vector(
        self, name: str, label: str, value: tuple[float, float, float], hint: str | None = None
    ) -> None:
        """Add three numbers."""
        self._add(name, label, self._gui.add_vector3(label, value, step=1.0, hint=hint))

    def choice(
        self, name: str, label: str, options: Mapping[str, Any], value: Any, hint: str | None = None
    ) -> None:
        """Add a choice among words that stand for values."""
        self._words[name] = dict(options)
        word = next(w for w, v in options.items() if v == value)
        field = self._gui.add_dropdown(label, tuple(options), initial_value=word, hint=hint)
        self._add(name, label, field)

    def tick(self, name: str, label: str, value: bool, hint: str | None = None) -> None:
        """Add a tick box."""
        self._add(name, label, self._gui.add_checkbox(label, value, hint=hint))

    def on_change(self, call: Callable[[str, Event], None]) -> None:
        """Call ``call(name, event)`` when a user changes a field; our own writes are ignored."""
        for name, field in self._fields.items():
            on_change(field, partial(call, name))

    def values(self, *names: str) -> dict[str, Any]:
        """Return what the fields hold (all, or those named)."""
        wanted = names or tuple(self._fields)
        return {name: self.value(name) for name in wanted}

    def value(self, name: str) -> Any:
        """Return what a field holds."""
        value = self._fields[name].value
        return self._words[name][value] if name in self._words else value

    def show(self, values: Mapping[str, Any]) -> None:
        """Write values into the fields, without sending anything."""
        for name, value in values.items():
            if name in self._words:
                value = next((w for w, v in self._words[name].items() if v == value), None)
            if value is not None:
                self._fields[name].value = value

    def enable(self, enabled: bool) -> None:
        """Let the fields be changed, or not."""
        for field in self._fields.values():
            field.disabled = not enabled
