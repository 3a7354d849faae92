"""Fields of one browser: what is typed counts once Enter is pressed or the field is left.

viser reports every key. The page keeps what is being typed to itself (``static/fields.js``) and
sends the text as it stands when it is finished. It is read here, held against the limits of its
field and written into it, or refused; then the field shows what it held before, and why stands
below it. Beside each control its hint is kept for the page, which shows it where viser does not: on
buttons and on labels (``static/docks.js``).
"""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rona_core.errors import InvalidInputError
from rona_ui.viewer.bindings import Event, escape
from rona_ui.viewer.gateway import uuid_of
from rona_ui.viewer.hints import HINTS

DECIMALS = 6  # that a number field shows; viser takes those of its step
MOST_CHARS = 40  # of a refused text that are shown
TYPED = ("add_text", "add_number", "add_vector3", "add_slider")  # fields that text is typed into
OTHERS = ("add_button", "add_upload_button", "add_button_group", "add_checkbox", "add_dropdown")
_UNIT = re.compile(r"\(([^()]+)\)$")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(,\d{3})+")  # or a decimal comma: ambiguous


def read_number(text: str) -> float:
    """Return a typed text as a number; a comma may stand for the point.

    Raises:
        InvalidInputError: it is none, or 1,000 that may be one or a thousand.
    """
    plain = text.strip().replace("\N{MINUS SIGN}", "-")
    if not _THOUSANDS.fullmatch(plain):
        plain = plain.replace(",", ".") if plain.count(",") == 1 else plain
        if _NUMBER.fullmatch(plain) and abs(value := float(plain)) < float("inf"):
            return value
    raise InvalidInputError(f"expected a number such as 2.5, not {text.strip()[:MOST_CHARS]!r}")


@dataclass(frozen=True, slots=True)
class Typed:
    """Event of a finished field, in place of viser's event."""

    client: Any
    target: Any
    finished: bool = True  # nothing more comes: it need not settle


class Field:
    """A field of viser under the same names, which can be filled from a typed text.

    ``explain(words)`` shows words below it.
    """

    def __init__(
        self, handle: Any, label: str, beside: Any = None, hint: str | None = None
    ) -> None:
        """Take a handle; ``beside`` is the HTML that stands below it, with its hint."""
        self.__dict__.update(
            _handle=handle, _label=label, _beside=beside, _hint=hint, _words="", _calls=[]
        )

    def __getattr__(self, name: str) -> Any:
        return getattr(self._handle, name)

    def __setattr__(self, name: str, value: Any) -> None:
        moved = name == "value" and value != self._handle.value
        setattr(self._handle, name, value)
        if moved or (name == "visible" and not value):
            self.explain("")

    def explain(self, words: str) -> None:
        """Show words below the field, as why a text was refused; none with an empty text."""
        if self._beside is not None and words != self._words:
            self.__dict__["_words"] = words
            self._beside.content = _beside(uuid_of(self._handle), self._hint, words)

    def remove(self) -> None:
        """Remove the field and what stands below it."""
        self._handle.remove()
        if self._beside is not None:
            self._beside.remove()

    def on_update(self, call: Callable[[Any], Any]) -> Any:
        """Call ``await call(event)`` whenever the field changes."""
        self._calls.append(call)
        return self._handle.on_update(call)

    def take(self, text: str, part: int) -> bool:
        """Write a typed text into the field, or a component of it; return whether that changed it.

        Raises:
            InvalidInputError: no number where one is expected, or outside of the limits.
        """
        if self._handle.disabled:
            raise InvalidInputError(
                f"{self._label} cannot be changed now: wait for the job or cancel it"
            )
        held = self._handle.value
        if isinstance(held, tuple):
            value: Any = tuple(
                self._number(text, old, at) if at == part else old for at, old in enumerate(held)
            )
        else:
            value = text if isinstance(held, str) else self._number(text, held, None)
        self._handle.value = value
        return value != held

    def _number(self, text: str, held: float, part: int | None) -> float:
        try:
            value = read_number(text)
        except InvalidInputError as error:
            raise InvalidInputError(f"{self._label}: {error}") from None
        if isinstance(held, int) and value != int(value):
            raise InvalidInputError(f"{self._label}: expected a whole number, not {value:.12g}")
        low, high = (
            limit[part] if part is not None and isinstance(limit, tuple) else limit
            for limit in (self._handle.min, self._handle.max)
        )
        if (low is not None and value < low) or (high is not None and value > high):
            least = "any" if low is None else f"{low:.12g}"
            most = "any" if high is None else f"{high:.12g}"
            raise InvalidInputError(f"{self._label} must be {least} to {most}, not {value:.12g}")
        return type(held)(value)

    async def notify_listeners(self, client: Any) -> None:
        """Tell all who listen that ``client`` has finished typing."""
        for call in self._calls:
            await call(Typed(client, self))


def full_hint(hint: str | None, label: str, low: Any = None, high: Any = None) -> str | None:
    """Return a hint with the limits of a number and its unit, which the label ends with."""
    if not isinstance(low, int | float) or not isinstance(high, int | float):
        return hint
    unit = _UNIT.search(label)
    limits = f"{low:.12g} to {high:.12g}{f' {unit[1]}' if unit else ''}."
    return f"{hint.rstrip('.')}. {limits}" if hint else limits


def _beside(uuid: str, hint: str | None, words: str = "") -> str:
    """Return what stands below a control: its hint, which the page shows on hover, and words."""
    hidden = "" if not hint else f'<i hidden data-hint-for="{escape(uuid)}">{escape(hint)}</i>'
    return hidden + (f'<div class="r-wrong" role="note">{escape(words)}</div>' if words else "")


class Fields:
    """The gui of one browser; its fields for texts and numbers wait until the typing is finished.

    ``refuse(error, event, explained)`` reports what could not be taken.
    """

    def __init__(self, gui: Any, refuse: Callable[[Exception, Event, bool], None]) -> None:
        self._gui, self._refuse = gui, refuse
        self._fields: dict[str, Field] = {}
        self._explained: Field | None = None
        message = gui.add_text(
            "Typed", "{}", visible=False
        )  # what the page sends when it is finished
        message.on_update(self._typed)
        gui.add_html(f'<i hidden data-typed="{escape(uuid_of(message))}"></i>')

    def __getattr__(self, name: str) -> Any:
        """Return what the gui has; texts and numbers are added as fields that wait."""
        made = getattr(self._gui, name)
        if name not in (*TYPED, *OTHERS):
            return made

        def add(label: str, *rest: Any, **options: Any) -> Any:
            limits = rest[:2] if name == "add_slider" else (options.get("min"), options.get("max"))
            own = options.get("hint") or HINTS.get(label)
            hint = options["hint"] = full_hint(own, label, *limits)
            handle = made(label, *rest, **options)
            uuid = uuid_of(handle)
            if name in OTHERS:
                if hint:
                    self._gui.add_html(_beside(uuid, hint))
                return handle
            if name in ("add_number", "add_vector3") and not isinstance(handle.value, int):
                handle.precision = DECIMALS  # more than the step has
            beside = self._gui.add_html(_beside(uuid, hint))
            field = self._fields[uuid] = Field(handle, label, beside, hint)
            return field

        return add

    async def _typed(self, event: Any) -> None:
        if event.client is None:
            return
        if self._explained is not None:
            self._explained.explain("")
        try:
            field, part, text = self._read(event.target.value)
        except InvalidInputError as error:
            self._refuse(error, event, False)
            return
        try:
            changed = field.take(text, part)
        except InvalidInputError as error:
            self._explained = field
            field.explain(str(error))
            self._refuse(error, event, True)
            return
        if changed:
            await field.notify_listeners(event.client)

    def _read(self, message: str) -> tuple[Field, int, str]:
        """Return field, component and text of what the page sent."""
        try:
            sent = json.loads(message)
            field = self._fields[sent["field"]]
            part, text = sent["part"], sent["text"]
            if not isinstance(part, int) or not isinstance(text, str):
                raise TypeError
        except (ValueError, KeyError, TypeError, RecursionError):
            raise InvalidInputError(
                "expected a field of this page and a text: load the page again"
            ) from None
        return field, part, text
