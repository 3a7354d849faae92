"""Browser: docks, scene and view of one client.

Kept views: how each page last looked at its session, for when it connects anew. A page is drawn by
a new `Browser` whenever it was loaded anew, or its connection was lost; the name that it gives
itself (``static/page/link.js``) stays.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import Any, get_args

import numpy as np

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.runtime.session_registry import SessionRegistry
from rona_core.app.steps.implant.view import moved_bed
from rona_core.app.steps.setup.messages import SetRegion
from rona_core.errors import NotFoundError, RonaError
from rona_core.geometry.arrays import Floats
from rona_core.mapping.comparison.reference_bone import Registration
from rona_ui.panels.implant.implant import BED_LAYERS
from rona_ui.panels.layout.docks import Docks
from rona_ui.panels.maps.comparison import comparison_message
from rona_ui.panels.maps.maps import MAP_NAMES
from rona_ui.panels.widgets.form import PanelContext
from rona_ui.presentation.camera import (
    FOV_RAD,
    NARROWEST,
    UP,
    CameraPose,
    about_pointer,
    camera_pose,
)
from rona_ui.presentation.error_boundary import ErrorBoundary
from rona_ui.presentation.mouse_input import STROKES, held_move, nudged, with_pick, without_mode
from rona_ui.presentation.snapshot import Snapshot, opening_view, shown_preset
from rona_ui.presentation.view_state import ViewState
from rona_ui.scene.path.path import point_at
from rona_ui.scene.pointer import handle_rotation
from rona_ui.scene.renderer import SceneRenderer
from rona_ui.scene.viser_nodes import M_PER_MM, metres
from rona_ui.viewer.bindings import Bindings, Event, notify
from rona_ui.viewer.fields import Fields

KEPT = 8  # pages
WITH_FIELDS = MAP_NAMES | BED_LAYERS  # layers that panels have a field for, which begins anew


@dataclass(frozen=True, slots=True)
class _Held:
    client_id: int
    session_id: str
    view: ViewState


class KeptViews:
    """The last views of pages by their names, those of the latest pages only."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._held: dict[str, _Held] = {}

    def keep(self, page: str, client_id: int, session_id: str, view: ViewState) -> None:
        """Keep the view that a page has of a session, in place of an earlier one.

        Of an earlier connection of the page, which may not know yet that it is lost, nothing is
        kept any more; connections are numbered in the order they came.
        """
        with self._lock:
            held = self._held.get(page)
            if held is not None and held.client_id > client_id:
                return
            self._held.pop(page, None)
            self._held[page] = _Held(client_id, session_id, resumed_view(ViewState(), view))
            while len(self._held) > KEPT:
                del self._held[next(iter(self._held))]

    def of(self, page: str, session_id: str) -> ViewState | None:
        """Return the view that a page had; None if it is unknown, or last showed another session.

        Only what `resumed_view` takes of it is there.
        """
        with self._lock:
            held = self._held.get(page)
        return None if held is None or held.session_id != session_id else held.view


def resumed_view(opened: ViewState, kept: ViewState) -> ViewState:
    """Return the view that a page goes on with.

    Step, layers, cut and the strokes that are being drawn are as they were; strokes that were sent
    are not, or they would be recorded twice. Everything else has fields in the docks, which begin
    anew.

    Args:
        opened: The view that its session opens with.
        kept: The view that the page had.
    """
    view = replace(
        opened,
        step=kept.step,
        all_layers=kept.all_layers,
        hidden=(kept.hidden - WITH_FIELDS) | (opened.hidden & WITH_FIELDS),
        cut_direction=kept.cut_direction,
        cut_offset_mm=kept.cut_offset_mm,
        cut_maps=kept.cut_maps,
    )
    if kept.drawing not in STROKES:
        return view
    return replace(view, drawing=kept.drawing, picks=kept.picks, lifts=kept.lifts)


NEAR_M, FAR_M = 0.01, 20.0
COMPARE: dict[str, Registration] = {
    f"compare-{how}": how for how in get_args(Registration)
}  # services of the page


class Browser:
    """Draws snapshots for one client and executes its clicks."""

    def __init__(
        self,
        client: Any,
        hub: SessionRegistry,
        bindings: Bindings,
        wake: Callable[[], None],
        kept: KeptViews,
    ) -> None:
        self.client = client
        self._hub, self._bindings, self._wake = hub, bindings, wake
        self._lock = threading.Lock()
        self._view = ViewState()
        self._opened: ViewState | None = self._view  # as long as it is unchanged
        self._kept, self._page, self._session_id = kept, "", ""  # names, once they are known
        self._drawn: Snapshot | None = None
        self._in_scene: Snapshot | None = None
        self._listening = False
        self._pivot_handles: Any = None
        context = PanelContext(
            bindings.send,
            bindings.send_debounced,
            self.change_view,
            self._service,
            self._set_camera,
        )
        with client.atomic():
            boundary = ErrorBoundary()
            self._docks = Docks(Fields(client.gui, bindings.refuse), context, boundary)
            self._scene = SceneRenderer(client.scene, boundary)
        client.camera.up_direction = UP
        client.camera.near, client.camera.far = NEAR_M, FAR_M
        client.camera.fov = FOV_RAD
        self._set_camera("Overview", settled=False)

    @property
    def view(self) -> ViewState:
        """How this browser looks at the session now."""
        return self._view

    def change_view(self, change: Callable[[ViewState], ViewState]) -> None:
        """Replace the view by ``change(view)`` and have it drawn."""
        with self._lock:
            self._view = change(self._view)
            self._keep()
        self._wake()

    def _keep(self) -> None:
        if self._page and self._session_id:
            self._kept.keep(self._page, self.client.client_id, self._session_id, self._view)

    def _open(self, old: Snapshot | None, new: Snapshot) -> ViewState:
        """Return the view of a session that is drawn for the first time."""
        with self._lock:
            untouched = self._view is self._opened
            self._session_id = new.session.id
            self._view = opening_view(old, new, self._view)
            self._opened = self._view if untouched else None
            self._keep()
            return self._view

    def _resume(self, page: str) -> None:
        """Go on as a page was left, unless there was a click here since it opened."""
        with self._lock:
            self._page = page
            kept = self._kept.of(page, self._session_id)
            if kept is not None and self._view is self._opened:
                self._view = resumed_view(self._view, kept)
            self._keep()
        self._wake()

    def draw(self, new: Snapshot) -> None:
        """Bring this browser to ``new``, in one go."""
        old = self._drawn
        if old is None or old.session.id != new.session.id:
            new = replace(new, view=self._open(old, new))
        self._listen(new)
        with self.client.atomic():
            self._draw_scene(new)
            self._docks.render(old, new)
        self._drawn = new
        self._listen_to_pivot_handles()
        if new.static_scene is not None:
            before = None if old is None or old.static_scene is None else shown_preset(old)
            if before != shown_preset(new):
                self._set_camera(shown_preset(new), settled=before is not None)

    def _draw_scene(self, new: Snapshot) -> None:
        """Draw the scene, from when it is known where everything in it stands."""
        if new.static_scene is not None or self._in_scene is not None:
            self._scene.render(self._in_scene, new)
            self._in_scene = new

    # -------------------------------------------------------------- camera

    def _set_camera(self, name: str, *, settled: bool = True) -> None:
        """Look as a preset does; until the docks are ``settled`` the canvas is still wider."""
        static_scene = None if self._drawn is None else self._drawn.static_scene
        aspect = max(self.client.camera.aspect, NARROWEST) if settled else NARROWEST
        tip_base = self._scene.pivot_tip_base() if name == "Pointer" else None
        sight = (
            camera_pose(name, static_scene, aspect)
            if tip_base is None
            else about_pointer(tip_base, aspect)
        )
        with self.client.atomic():
            self.client.camera.position = metres(sight.eye_base)
            self.client.camera.look_at = metres(sight.target_base)
            self.client.camera.up_direction = sight.up_base

    # -------------------------------------------------------------- drawing on the skull

    def _listen(self, new: Snapshot) -> None:
        """Listen to the mouse on the skull while it is drawn on, and only then."""
        skull, wanted = self._scene.skull(), new.view.drawing is not None
        if skull is None or wanted == self._listening:
            return
        self._listening = wanted
        if not wanted:
            skull.remove_click_callback()
            skull.remove_drag_callback()
            return

        @skull.on_click
        async def _(event: Any) -> None:
            self._point(event, event.ray_origin, event.ray_direction, "click")

        @skull.on_drag("left")
        async def _(event: Any) -> None:
            eye = np.asarray(event.client.camera.position)
            self._point(event, eye, np.asarray(event.end_position) - eye, event.phase)

    def _point(self, event: Event, origin_m: Any, direction: Any, phase: str) -> None:
        origin_base = np.asarray(origin_m, dtype=np.float64) / M_PER_MM
        ray = np.asarray(direction, dtype=np.float64)

        def draw() -> None:
            place = self._hub.get().rig().display.pick(origin_base, ray)
            if place is not None and self._view.drawing is not None:
                x, y, z = (float(v) for v in place)
                self.change_view(lambda v: with_pick(v, (x, y, z), phase))

        def edit() -> None:
            bench, before = self._hub.get(), self._view
            after, command = point_at(bench.session, before, origin_base, ray, phase)
            if after is not before:
                self.change_view(lambda v: after if v is before else v)
            if command is not None:
                bench.dispatch(command)

        def choose_region() -> None:
            bench = self._hub.get()
            display = bench.rig().display
            place = display.pick(origin_base, ray)
            if place is not None and phase == "click":
                x, y, z = (float(v) for v in display.point_mesh(place))
                bench.dispatch(SetRegion((x, y, z), bench.session.setup.region.radius_mm))
                self.change_view(lambda v: replace(v, drawing=None))

        def move_bed() -> None:
            place = self._hub.get().rig().display.pick(origin_base, ray)
            if place is None or self._view.drawing != "implant":
                return
            x, y, z = (float(v) for v in place)
            self.change_view(lambda v: replace(v, move_target=(x, y, z)))
            self._bindings.send_debounced(
                "bed", lambda: moved_bed(self._hub.get().session, place), event
            )

        modes = {"region": choose_region, "implant": move_bed}
        drawing = self._view.drawing or ""
        work = draw if drawing in STROKES else modes.get(drawing, edit)
        self._bindings.call(work, event)

    # -------------------------------------------------------------- the pointer in the hand

    def _listen_to_pivot_handles(self) -> None:
        """Listen to the pivot handles while they are shown."""
        handles = self._scene.pivot_handles()
        if handles is self._pivot_handles:
            return
        self._pivot_handles = handles
        if handles is None:
            return

        @handles.on_update
        async def _(event: Any) -> None:
            turn = handle_rotation(event.target.wxyz)  # as it is now, not when its turn comes
            self._bindings.call(lambda: self._turn(turn), event)

    def _turn(self, wxyz: Floats) -> None:
        bench = self._hub.get()
        if bench.pointer_in_hand():  # a drag may end after the capture has
            bench.turn_pointer(wxyz)

    # -------------------------------------------------------------- the service

    def _service(self, what: str, event: Event, data: str | bytes | None) -> None:
        if what == "escape":
            self._bindings.escape(lambda: self.change_view(without_mode), event)
        elif what == "finish":
            self._bindings.call(lambda: self._hub.get().finish_pointer(), event)
        elif what == "cancel":
            self._bindings.call(self._cancel, event)
        elif what.startswith("resume:"):
            self._resume(what.removeprefix("resume:"))
        elif what.startswith("nudge:"):
            self._nudge(what.removeprefix("nudge:"), event)
        else:
            self._bindings.call(lambda: self._serve(what, data), event)

    def _nudge(self, way: str, event: Event) -> None:
        """Move the point of the path that is held; what was moved in a row is one command."""
        camera, session = self.client.camera, self._hub.get().session
        eye_base, target_base = (np.array(p) / M_PER_MM for p in (camera.position, camera.look_at))
        pose = CameraPose(eye_base, target_base, np.array(camera.up_direction))
        try:
            self.change_view(lambda v: nudged(v, session, pose, way))
        except RonaError as error:
            self._bindings.refuse(error, event)
        else:
            self._bindings.send_debounced("nudge", lambda: held_move(self._view), event)

    def _cancel(self) -> None:
        bench = self._hub.get()
        for status in bench.jobs.all():
            if not status.finished:
                bench.jobs.cancel(status.id)

    def _serve(self, what: str, data: str | bytes | None) -> None:
        verb, _, name = what.partition(":")
        if verb == "save":
            path = self._hub.save()
            notify(self.client, "Saved", path.name, "green")
        elif verb == "export":
            data = REGISTRY.export(self._hub.get().session, name)
            self.client.send_file_download(name, data, save_immediately=True)
        elif verb in COMPARE and isinstance(data, bytes):
            view = self._view
            file = self._hub.files.store_upload(name, data).name
            job = self._hub.get().start(comparison_message(file, COMPARE[verb], view)).id
            self.change_view(lambda now: replace(now, comparison=job, compared_pairs=view.pairs))
        elif verb == "upload" and isinstance(data, bytes):
            self._hub.files.store_upload(PurePath(name).name, data)
        else:
            raise NotFoundError(f"there is no service {what!r}")
