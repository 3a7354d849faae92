"""What stands around the robot, in step 1: table and margins, and a list of boxes by name."""

from dataclasses import replace
from typing import Any

from rona_core.app.steps.setup.clearance import clearance_violations
from rona_core.app.steps.setup.workcell_messages import (
    STANDARD,
    AddObstacle,
    RemoveObstacle,
    SetWorkcell,
)
from rona_core.devices.workcell import RoomBox, Surroundings
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import Form
from rona_ui.panels.widgets.panel_context import Door, follow, listen
from rona_ui.view_state import Picture
from rona_ui.viewer.bindings import Event, escape

NEW = "A new one"
FIRST = RoomBox("cupboard", (300.0, 1000.0, 300.0), (600.0, 300.0, 1400.0))  # fields offer it
LAYER = frozenset(("obstacles",))
EXPLANATION = (
    "The robot keeps away from head, table, floor and tracker, and from what you add here. Places "
    "are in mm from the robot base as it stood at first: x forward, y to its left, z up."
)


class RoomFields:
    """A closed folder: see what stands around, add, change and take away."""

    def __init__(self, gui: Any, door: Door) -> None:
        self._door = door
        self._held = Surroundings()
        gui.add_html(style.text(EXPLANATION))
        self._list = gui.add_html("")
        self._seen = gui.add_checkbox(
            "Show all", False, hint="The layer Obstacles of the scene, table and head too"
        )
        self._which = gui.add_dropdown("Obstacle", (NEW,))
        self._name = gui.add_text("Name", FIRST.name)
        self._box = Form(gui)
        self._box.vector("center_mm", "Middle (mm)", FIRST.center_mm, "x, y, z in the room")
        self._box.vector("size_mm", "Size (mm)", FIRST.size_mm, "Along its own x, y and z")
        self._box.number(
            "turn_deg", "Turned by (deg)", 0.0, -180.0, 180.0, 5.0, "About the vertical"
        )
        self._put = gui.add_button("Add the obstacle", icon="plus", color="gray")
        self._remove = gui.add_button("Take it away", icon="trash", color="gray", visible=False)
        self._near = gui.add_html("")
        with gui.add_folder("Table, floor and distances", expand_by_default=False):
            self._room = self._room_form(gui)
        self._room.on_change(self._changed)
        follow(self._seen, lambda e: self._show(bool(self._seen.value)))
        follow(self._which, lambda e: self._choose())
        listen(self._put, self._on_put)
        listen(self._remove, self._on_remove)

    @staticmethod
    def _room_form(gui: Any) -> Form:
        form, now = Form(gui), STANDARD
        form.tick("table", "Table", now.table)
        form.vector("table_center_mm", "Table top (mm)", now.table_center_mm, "From the region")
        form.vector("table_size_mm", "Table size (mm)", now.table_size_mm, "x, y, thickness")
        form.number("floor_mm", "Floor (mm)", now.floor_mm, -5000.0, 5000.0, 10.0, "Its height")
        form.number(
            "head_below_mm", "Head (mm)", now.head_below_mm, -500.0, 500.0, 5.0,
            "Its middle below the region, until it is touched",
        )  # fmt: skip
        for name, label, most, step, hint in (
            ("head_margin_mm", "From the head (mm)", 200.0, 1.0, "All but the probe"),
            ("margin_mm", "From the rest (mm)", 200.0, 1.0, "Table, floor, tracker, your own"),
            ("self_margin_mm", "From itself (mm)", 50.0, 1.0, "Between parts of the robot"),
        ):
            form.number(name, label, getattr(now, name), 0.0, most, step, hint)
        form.number("stand_radius_mm", "Tracker pole (mm)", now.stand_radius_mm, 10.0, 1000.0, 10.0)
        return form

    def _changed(self, name: str, event: Event) -> None:
        self._door.send_settled("room", lambda: SetWorkcell(**self._room.values()), event)

    def _show(self, wanted: bool) -> None:
        self._door.view(
            lambda v: replace(v, hidden=v.hidden - LAYER if wanted else v.hidden | LAYER)
        )

    def _choose(self) -> None:
        box = next((b for b in self._held.boxes if b.name == self._which.value), None)
        if box is not None:
            self._name.value = box.name
            self._box.show(
                {"center_mm": box.center_mm, "size_mm": box.size_mm, "turn_deg": box.turn_deg}
            )
        self._offer()

    def _offer(self) -> None:
        """Name the button by what it does."""
        known = self._which.value != NEW
        self._put.label = "Change the obstacle" if known else "Add the obstacle"
        self._put.icon = "check" if known else "plus"
        self._remove.visible = known

    def _on_put(self, event: Event) -> None:
        name, values, chosen = self._name.value.strip(), self._box.values(), self._which.value
        old = None if chosen in (NEW, name) else chosen
        self._door.send(lambda: AddObstacle(name, **values, instead_of=old), event)

    def _on_remove(self, event: Event) -> None:
        name = self._which.value
        self._door.send(lambda: RemoveObstacle(name), event)

    def render(self, old: Picture | None, new: Picture) -> None:
        """Follow the session and the layers."""
        around, busy = new.session.setup.surroundings, new.busy
        shown = "obstacles" not in new.view.hidden
        if self._seen.value != shown:
            self._seen.value = shown
        if old is None or old.busy != busy:
            self._room.enable(not busy)
            self._box.enable(not busy)
            for part in (self._put, self._remove, self._which, self._name):
                part.disabled = busy
        changed = old is None or old.session.setup is not new.session.setup
        if changed or (old is not None and old.refused != new.refused):
            self._room.show({name: getattr(around, name) for name in self._room.values()})
        if changed:
            self._follow(around)
        if changed or (old is not None and old.backdrop is not new.backdrop):
            self._near.content = too_near(new)

    def _follow(self, around: Surroundings) -> None:
        """Offer the boxes that there are; one that was just added or changed stays chosen."""
        before, self._held = {box.name for box in self._held.boxes}, around
        names = tuple(box.name for box in around.boxes)
        chosen = self._which.value
        fresh = [name for name in names if name not in before]
        self._which.options = (NEW, *names)
        self._which.value = fresh[-1] if fresh else chosen if chosen in names else NEW
        self._list.content = listed(around)
        self._offer()


def listed(around: Surroundings) -> str:
    """Return what was added, as a table."""
    if not around.boxes:
        return style.note("Nothing was added.")
    rows = ""
    for box in around.boxes:
        middle = ", ".join(f"{part:.0f}" for part in box.center_mm).replace("-", "−")
        size = " × ".join(f"{part:.0f}" for part in box.size_mm)
        turn = f", turned by {box.turn_deg:.0f}°" if box.turn_deg else ""
        rows += (
            f"<tr><td><b>{escape(box.name)}</b></td>"
            f'<td>at ({middle}) mm<br><span class="g">{size} mm{turn}</span></td></tr>'
        )
    return f'<table class="r-table">{rows}</table>'


def too_near(picture: Picture) -> str:
    """Return what the robot at rest comes too close to: nothing can be planned then."""
    if picture.backdrop is None:
        return ""
    pairs = clearance_violations(picture.session, picture.backdrop.home_rad)
    names = sorted({pair.second for pair in pairs if pair.too_close})
    if not names:
        return ""
    return style.note(
        f"Where the robot rests it comes too close to: {', '.join(names)}. It cannot move so: put "
        "that farther away, or lower the distances below.",
        "warn",
    )
