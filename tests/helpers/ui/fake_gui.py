"""A recording stand-in for viser's gui: handles hold what was written, and can be clicked."""

import asyncio
from contextlib import AbstractContextManager, suppress
from types import SimpleNamespace
from typing import Any


class FakeClient:
    """A browser that remembers what it was told."""

    def __init__(self) -> None:
        self.notices: list[tuple[str, str]] = []

    def add_notification(self, title: str, body: str, **options: Any) -> None:
        self.notices.append((title, body))


class FakeHandle(AbstractContextManager["FakeHandle"]):
    """A widget: any attribute can be written; clicks and changes call back."""

    def __init__(self, kind: str, label: str = "", **parts: Any) -> None:
        self.kind, self.label, self.visible, self.disabled = kind, label, True, False
        self.callbacks: list[Any] = []
        self.content, self.value, self.removed = "", None, False
        self.__dict__.update(parts)

    def __setattr__(self, name: str, value: Any) -> None:
        if name == "disabled" and value and self.kind == "button_group":
            raise AssertionError("viser refuses to disable a group of buttons")
        new = name == "value" and value != self.__dict__.get("value")
        super().__setattr__(name, value)
        if new and self.kind != "upload_button":
            for call in self.callbacks:  # viser calls back for what the program writes too
                with suppress(StopIteration):
                    call(SimpleNamespace(client=None, target=self)).send(None)

    def __exit__(self, *error: object) -> None:
        return None

    def _listen(self, call: Any) -> Any:
        self.callbacks.append(call)
        return call

    on_click = on_update = on_upload = on_trigger = _listen

    def remove(self) -> None:
        self.removed = True

    close = remove  # of a modal window

    def happen(self, client: Any) -> None:
        """Click or change the widget; ``client`` None is an echo of the program's own write."""
        for call in self.callbacks:
            asyncio.run(call(SimpleNamespace(client=client, target=self)))


class FakeGui:
    """Makes fake handles for every ``add_…`` and keeps them in order."""

    def __init__(self) -> None:
        self.handles: list[FakeHandle] = []

    def __getattr__(self, name: str) -> Any:
        if not name.startswith("add_"):
            raise AttributeError(name)

        def add(*arguments: Any, **options: Any) -> FakeHandle:
            return self._add(name.removeprefix("add_"), arguments, options)

        return add

    def _add(self, kind: str, arguments: tuple[Any, ...], options: dict[str, Any]) -> FakeHandle:
        handle = FakeHandle(kind)
        if arguments and kind == "html":
            handle.content = arguments[0]
        elif arguments:
            handle.label = arguments[0] or ""
        if kind in ("number", "text", "checkbox", "vector3", "progress_bar", "slider"):
            handle.value = arguments[-1]
        if kind in ("dropdown", "button_group"):
            handle.options = tuple(arguments[1])
            handle.value = options.get("initial_value", arguments[1][0])
        handle.visible = options.get("visible", True)
        self.handles.append(handle)
        return handle

    def find(self, kind: str, label: str) -> FakeHandle:
        """Return the newest handle of a kind with this label."""
        return next(h for h in reversed(self.handles) if h.kind == kind and h.label == label)

    def html(self) -> str:
        """Return all HTML that is shown."""
        return "".join(h.content for h in self.handles if h.kind == "html")
