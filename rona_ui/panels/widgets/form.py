"""Forms of declared fields, and the callbacks through which a panel sends and changes the view."""

from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields, replace
from functools import partial
from typing import Any

from rona_core.devices.limits import heading, limits_of
from rona_core.session.document import Session
from rona_ui.panels.widgets import style
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.presentation.view_state import ViewState
from rona_ui.viewer.bindings import Event


@dataclass(frozen=True, slots=True)
class PanelContext:
    """Callbacks of a panel."""

    send: Callable[[Callable[[], Any], Event], None]
    send_debounced: Callable[[object, Callable[[], Any], Event], None]
    change_view: Callable[[Callable[[ViewState], ViewState]], None]
    # save, upload, export, compare, finish, cancel, escape, resume
    service: Callable[[str, Event, str | bytes | None], None]
    set_camera: Callable[[str], None]  # preset by name

    def set_view(self, **fields: Any) -> None:
        """Set fields of the view of this browser."""
        self.change_view(lambda view: replace(view, **fields))

    def send_button(
        self, gui: Any, label: str, icon: str, make: Callable[[], Any], **options: Any
    ) -> Any:
        """Add a button that sends the message ``make()``; grey unless ``color`` says otherwise."""
        button = gui.add_button(label, icon=icon, **{"color": "gray", **options})
        on_click(button, lambda event: self.send(make, event))
        return button

    def view_button(
        self, gui: Any, label: str, icon: str, *, color: str | None = "gray", **fields: Any
    ) -> Any:
        """Add a button that sets fields of the view."""
        button = gui.add_button(label, icon=icon, color=color)
        on_click(button, lambda event: self.set_view(**fields))
        return button

    def show_layer(self, name: str, shown: bool) -> None:
        """Switch a layer of the scene on or off."""
        layer = frozenset((name,))
        self.change_view(
            lambda v: replace(v, hidden=v.hidden - layer if shown else v.hidden | layer)
        )


def on_click(handle: Any, call: Callable[[Any], None]) -> None:
    """Call ``call(event)`` when a button is clicked, in the order of the clicks."""

    @handle.on_click
    async def _(event: Any) -> None:
        call(event)


def on_change(handle: Any, call: Callable[[Any], None]) -> None:
    """Call ``call(event)`` when a user changes a field; our own writes are ignored."""

    @handle.on_update
    async def _(event: Any) -> None:
        if event.client is not None:
            call(event)


Make = Callable[[Any, dict[str, Any]], Any]  # of settings and values a message
Show = Callable[[Any], Mapping[str, Any]]  # of settings the values of rows


@dataclass(frozen=True, slots=True)
class Row:
    """A field by its declaration, and the widget that shows it: in words, in per cent, or as is."""

    words: Mapping[str, Any]
    options: Mapping[str, Any]  # of a choice: label -> value
    widget: Any

    def read(self) -> Any:
        """Return the value of the field."""
        shown: Any = self.widget.value
        if self.options:
            return self.options[shown]
        if isinstance(shown, str):
            shown = shown.strip()
        if "none" in self.words and not shown:
            return None
        return round(shown / 100.0, 9) if self.words.get("percent") else shown

    def show(self, value: Any) -> None:
        """Write a value of the field into the widget; one that it cannot show is left out."""
        shown = _shown(value, self.words, self.options)
        if shown is not None:
            self.widget.value = shown


class Form:
    """Rows by the names of their fields; ``changed(name, event)`` is called when a user edits."""

    def __init__(self, gui: Any, changed: Callable[[str, Event], None] | None = None) -> None:
        self._gui, self._changed = gui, changed
        self._rows: dict[str, Row] = {}

    def of(self, kind: Any, /, *names: str, **start: Any) -> None:
        """Add rows as a dataclass declares its fields.

        Args:
            kind: The dataclass.
            names: Of its fields, in the order of the rows; without any, all that have a label.
            start: Values shown at first, where they are not the defaults.
        """
        declared = limits_of(kind)
        for name in names or [name for name, words in declared.items() if "label" in words]:
            self._add(kind, name, self._widget, start)

    def slider(self, kind: Any, name: str, /, **start: Any) -> Any:
        """Add a number of a dataclass that is dragged, and return its widget."""
        return self._add(kind, name, self._slider, start)

    def _add(self, kind: Any, name: str, make: Any, start: Mapping[str, Any]) -> Any:
        words = limits_of(kind)[name]
        options = _options(words)
        value = start.get(name, next(part.default for part in fields(kind) if part.name == name))
        shown = None if value is MISSING else _shown(value, words, options)
        if shown is None:
            raise TypeError(f"{kind.__name__}.{name} has no default: give the row a start")
        row = self._rows[name] = Row(words, options, make(words, options, shown))
        if self._changed is not None:
            on_change(row.widget, partial(self._changed, name))
        return row.widget

    def _widget(self, words: Mapping[str, Any], options: Mapping[str, Any], shown: Any) -> Any:
        label, hint = heading(words), words["hint"]
        if options:
            return self._gui.add_dropdown(label, tuple(options), initial_value=shown, hint=hint)
        if isinstance(shown, bool):
            return self._gui.add_checkbox(label, shown, hint=hint)
        if isinstance(shown, str):
            return self._gui.add_text(label, shown, hint=_with_none(hint, "Empty", words))
        low, high, step = form_range(words)
        if isinstance(shown, tuple):
            limits = {"min": (low,) * 3, "max": (high,) * 3, "step": step}
            return self._gui.add_vector3(label, shown, **limits, hint=hint)
        hint = _with_none(hint, "0", words)
        return self._gui.add_number(label, shown, min=low, max=high, step=step, hint=hint)

    def _slider(self, words: Mapping[str, Any], _options: Mapping[str, Any], shown: Any) -> Any:
        low, high, step = form_range(words)
        return self._gui.add_slider(heading(words), low, high, step, shown, hint=words["hint"])

    def values(self, *names: str) -> dict[str, Any]:
        """Return the values of the fields (all, or those named)."""
        return {name: self.value(name) for name in names or self._rows}

    def value(self, name: str) -> Any:
        """Return the value of a field."""
        return self._rows[name].read()

    def show(self, values: Mapping[str, Any]) -> None:
        """Write values into the rows, without sending anything."""
        for name, value in values.items():
            self._rows[name].show(value)

    def enable(self, enabled: bool) -> None:
        """Let the rows be changed, or not."""
        for row in self._rows.values():
            row.widget.disabled = not enabled


class SettingsForm(Form):
    """Rows of a message that is sent at each change, and that show what the session holds."""

    def __init__(
        self,
        gui: Any,
        context: PanelContext,
        kind: Callable[..., Any],
        held: Callable[[Session], Any],
        *names: str,
        make: Make | None = None,
        show: Show | None = None,
    ) -> None:
        """Add the rows of a message.

        Args:
            gui: Where they are added.
            context: Through which the message is sent.
            kind: The message.
            held: Returns the settings that a session holds in its place.
            names: Of the fields, as for ``of``.
            make: Returns the message from the settings and the values, where it has further fields.
            show: Returns what the rows show of the settings, where they are not their fields.
        """
        super().__init__(gui, self._send)
        self._context, self._kind, self._held = context, kind, held
        self._make, self._show = make, show
        self._settings: Any = held(Session())
        self.add(*names)

    def add(self, *names: str) -> None:
        """Add rows of the message, as for ``of``."""
        self.of(self._kind, *names, **self._shown())

    def _shown(self) -> Mapping[str, Any]:
        held = self._settings
        if self._show is not None:
            return self._show(held)
        return {name: getattr(held, name) for name in limits_of(self._kind) if hasattr(held, name)}

    def _send(self, name: str, event: Event) -> None:
        self._context.send_debounced(self, self._message, event)

    def _message(self) -> Any:
        values = self.values()
        return self._kind(**values) if self._make is None else self._make(self._settings, values)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Write what the session holds into the rows where it has changed or was refused."""
        self.enable(not new.busy)
        if changed(old, new, "session.setup", "refused"):
            self._settings = self._held(new.session)
            self.show({name: v for name, v in self._shown().items() if name in self._rows})


def form_range(words: Mapping[str, Any]) -> tuple[float, float, float]:
    """Return minimum, maximum and step of a row; 0 stands for null where that means something."""
    low, high, step = words["minimum"], words["maximum"], words["step"]
    if words.get("percent"):
        return 100.0 * low, 100.0 * high, 100.0 * step
    return min(low, 0.0) if "none" in words else low, high, step


def _options(words: Mapping[str, Any]) -> dict[str, Any]:
    """Return the labels of a choice with their values; none where the field is no choice."""
    options = {label: value for value, label in words.get("labels", {}).items()}
    options |= {f"{value:g} {words['unit']}": value for value in words.get("offered", ())}
    return (
        {style.sentence(words["none"]): None, **options} if options and "none" in words else options
    )


def _with_none(hint: str, shown: str, words: Mapping[str, Any]) -> str:
    """Return a hint with what an empty field means, where it means something."""
    none = f"{shown}: {words['none']}" if "none" in words else ""
    return ". ".join(filter(None, (hint, none)))


def _shown(value: Any, words: Mapping[str, Any], options: Mapping[str, Any]) -> Any:
    """Return what a widget shows for a value; None where it cannot show it."""
    if options:
        return next((label for label, option in options.items() if option == value), None)
    if value is None:
        return None if "none" not in words else "" if "maxLength" in words else 0.0
    return round(100.0 * value, 7) if words.get("percent") else value
