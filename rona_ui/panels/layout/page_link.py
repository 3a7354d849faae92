"""Link to the page round the viewer: what its tool bar may show, and what is asked for there.

The page belongs to a browser, and so does the view. Both meet here: the page reads the state of the
view from a hidden element and writes its wishes into a hidden field (``static/page/link.js``), so
that they keep their order among what the fields of the docks send.
"""

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NoReturn, get_args

from rona_core.app.runtime.saving.session_files import recorded_captures
from rona_core.app.runtime.session_step import Redo, Undo
from rona_core.errors import InvalidInputError
from rona_ui.panels.widgets.form import PanelContext, on_change
from rona_ui.presentation.camera import HEAD, ROOM, TABLE
from rona_ui.presentation.mouse_input import NUDGES, held_point
from rona_ui.presentation.snapshot import Snapshot, changed, footprint
from rona_ui.presentation.view_state import EDITS, LAYERS, MODES, NEEDED, CutDirection, ViewState
from rona_ui.viewer.bindings import Event, escape
from rona_ui.viewer.gateway import uuid_of
from rona_ui.viewer.theme import set_theme

CHOSEN_IN_STEP_9 = ("outer", "inner", "fused")  # these layers have fields of their own
REACH_MM = 60.0  # of the cut to either side of the region's centre; no region is larger
NOTHING_WRITTEN = "{}"
LONGEST_PAGE_NAME = 64
SHOWN = (
    "view.step",
    "view.hidden",
    "view.all_layers",
    "view.cut_direction",
    "view.cut_offset_mm",
    "view.cut_maps",
    "view.drawing",
    "view.brush_mm",
    "view.moved_point",
    "static_scene",
    "session.id",
    "session.captures",
    "session.setup.devices.probe",
)


class PageLink:
    """Sends the page the view of this browser, and carries out the actions of its tool bar."""

    def __init__(
        self, gui: Any, context: PanelContext, buttons: Mapping[str, Any], tabs: Iterable[str]
    ) -> None:
        """Link the page to ``gui``.

        ``buttons`` are those of the docks that it has keys for, ``tabs`` those that it may open.
        """
        self._gui, self._context = gui, context
        self._buttons = {name: uuid_of(button) for name, button in buttons.items()}
        field = gui.add_text("Page", NOTHING_WRITTEN, visible=False)
        self._field = uuid_of(field)
        self._html = gui.add_html("")
        on_change(field, self._read)
        known = tuple(tabs)
        self._acts: dict[str, Callable[[Any, Event], None]] = {
            "undo": lambda value, event: context.send(Undo, event),
            "redo": lambda value, event: context.send(Redo, event),
            "save": lambda value, event: context.service("save", event, None),
            "escape": lambda value, event: context.service("escape", event, None),
            "resume": lambda value, event: context.service(
                f"resume:{_page_name(value)}", event, None
            ),
            "camera": lambda value, event: context.set_camera(_one_of(value, _cameras(None))),
            "nudge": lambda value, event: context.service(
                f"nudge:{_one_of(value, NUDGES)}", event, None
            ),
            "theme": lambda value, event: set_theme(gui, dark=_one_of(value, THEMES) == "dark"),
            "layer": lambda value, event: context.show_layer(
                _one_of(value["name"], LAYERS), _flag(value["shown"])
            ),
            "all_layers": lambda value, event: self._set_view(all_layers=_flag(value)),
            "cut": lambda value, event: self._set_view(cut_direction=_one_of(value, CUTS)),
            "flip": lambda value, event: self._change_view(FLIPS[_one_of(value, FLIPS)]),
            "cut_offset": lambda value, event: self._set_view(cut_offset_mm=_offset_mm(value)),
            "cut_maps": lambda value, event: self._set_view(cut_maps=_flag(value)),
            "tabs": lambda value, event: context.set_view(
                open_tabs=frozenset(_one_of(name, known) for name in value)
            ),
        }

    def _read(self, event: Any) -> None:
        """Do what the page has written."""
        try:
            wish = json.loads(event.target.value)
            self._acts[wish["act"]](wish["value"], event)
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            self._context.send(partial(_refuse, str(error)), event)

    def _set_view(self, **fields: Any) -> None:
        self._change_view(lambda view: replace(view, **fields))

    def _change_view(self, change: Callable[[ViewState], ViewState]) -> None:
        """Change the view; the skull is whole while it is drawn on."""
        self._context.change_view(lambda v: v if v.drawing is not None else change(v))

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Write the state of the view for the page."""
        if not changed(old, new, *SHOWN):
            return
        state = escape(json.dumps(self._state(new), separators=(",", ":")))
        self._html.content = f'<i hidden data-page="{self._field}" data-state="{state}"></i>'

    def _state(self, new: Snapshot) -> dict[str, Any]:
        view, scene = new.view, new.static_scene
        return {
            "session": new.session.id,
            "ready": scene is not None,
            "step": view.step,
            "buttons": self._buttons,
            "drawing": view.drawing is not None,
            "mode": "" if view.drawing is None else MODES[view.drawing],
            "pressed": next((words for words, mode in EDITS.items() if mode == view.drawing), ""),
            "footprint": footprint(new),
            "nudges": held_point(view, new.session) is not None,
            "cameras": _cameras(scene),
            "layers": [
                {
                    "name": name,
                    "title": title,
                    "shown": name not in view.hidden,
                    "needed": name in NEEDED[view.step],
                }
                for name, title in LAYERS.items()
                if name not in CHOSEN_IN_STEP_9
            ],
            "all_layers": view.all_layers,
            "cut": view.cut_direction,
            "cut_offset": view.cut_offset_mm,
            "cut_reach": REACH_MM,
            "cut_maps": view.cut_maps,
            "recordings": recorded_captures(new.session),
        }


CUTS: tuple[str, ...] = get_args(CutDirection)
THEMES = ("light", "dark")
# What a key asks for: it counts from the view as it is here, not from the page's last copy of it.
FLIPS: Mapping[str, Callable[[ViewState], ViewState]] = {
    "all_layers": lambda v: replace(v, all_layers=not v.all_layers),
    "cut": lambda v: replace(
        v, cut_direction="off" if v.cut_direction == "lengthwise" else "lengthwise"
    ),
}


def _cameras(scene: Any) -> tuple[str, ...]:
    """Return the presets that can be chosen; all of them without a scene."""
    if scene is None:
        return (*ROOM, *HEAD, *TABLE)
    return (*ROOM, *(TABLE if scene.head_axes_base is None else HEAD))


def _one_of(value: Any, known: Any) -> Any:
    if not isinstance(value, str) or value not in known:
        raise InvalidInputError(f"expected one of {', '.join(known)}")
    return value


def _page_name(value: Any) -> str:
    if not isinstance(value, str) or not 0 < len(value) <= LONGEST_PAGE_NAME:
        raise InvalidInputError(f"a page needs a name of at most {LONGEST_PAGE_NAME} characters")
    return value


def _flag(value: Any) -> bool:
    if not isinstance(value, bool):
        raise InvalidInputError("expected true or false")
    return value


def _offset_mm(value: Any) -> float:
    if not isinstance(value, int | float) or not -REACH_MM <= value <= REACH_MM:
        raise InvalidInputError(f"the cut must be {-REACH_MM:g} to {REACH_MM:g} mm off the centre")
    return float(value)


def _refuse(why: str) -> NoReturn:
    raise InvalidInputError(f"unknown request of the page: load it again ({why})")
