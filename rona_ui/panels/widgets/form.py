"""Form: named fields of a step whose values become the arguments of a message."""

from collections.abc import Callable, Mapping
from typing import Any

from rona_ui.labels import note_label
from rona_ui.viewer.bindings import Event


class Form:
    """Named fields; ``values()`` returns the arguments of a message."""

    def __init__(self, gui: Any) -> None:
        self._gui = gui
        self._fields: dict[str, Any] = {}
        self._words: dict[str, dict[str, Any]] = {}  # choice -> words to values

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
        note_label(name, label)
        self._fields[name] = self._gui.add_number(
            label, value, min=low, max=high, step=step, hint=hint
        )

    def numbers(self, *rows: tuple[Any, ...]) -> None:
        """Add numbers, each by the arguments of ``number``."""
        for row in rows:
            self.number(*row)

    def slider(
        self, name: str, label: str, value: float, low: float, high: float, step: float
    ) -> Any:
        """Add a number that is dragged, and return its widget."""
        note_label(name, label)
        self._fields[name] = self._gui.add_slider(label, low, high, step, value)
        return self._fields[name]

    def vector(
        self, name: str, label: str, value: tuple[float, float, float], hint: str | None = None
    ) -> None:
        """Add three numbers."""
        note_label(name, label)
        self._fields[name] = self._gui.add_vector3(label, value, step=1.0, hint=hint)

    def choice(
        self, name: str, label: str, options: Mapping[str, Any], value: Any, hint: str | None = None
    ) -> None:
        """Add a choice among words that stand for values."""
        note_label(name, label)
        self._words[name] = dict(options)
        word = next(w for w, v in options.items() if v == value)
        self._fields[name] = self._gui.add_dropdown(
            label, tuple(options), initial_value=word, hint=hint
        )

    def tick(self, name: str, label: str, value: bool, hint: str | None = None) -> None:
        """Add a tick box."""
        note_label(name, label)
        self._fields[name] = self._gui.add_checkbox(label, value, hint=hint)

    def on_change(self, call: Callable[[str, Event], None]) -> None:
        """Call ``call(name, event)`` whenever a field changes, in order."""
        for name, field in self._fields.items():
            self._listen(name, field, call)

    @staticmethod
    def _listen(name: str, field: Any, call: Callable[[str, Event], None]) -> None:
        @field.on_update
        async def _(event: Any) -> None:
            call(name, event)

    def values(self, *names: str) -> dict[str, Any]:
        """Return what the fields hold (all, or those named)."""
        wanted = names or tuple(self._fields)
        return {name: self._value(name) for name in wanted}

    def _value(self, name: str) -> Any:
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
