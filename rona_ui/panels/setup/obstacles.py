"""Obstacles and clearances of the work cell in step 1."""

from typing import Any

from rona_core.app.steps.setup.clearance import clearance_violations
from rona_core.app.steps.setup.messages import (
    AddObstacle,
    RemoveObstacle,
    SetWorkcell,
)
from rona_core.devices.workcell import RoomBox, Surroundings
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import Form, PanelContext, SettingsForm, on_change, on_click
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.viewer.bindings import Event, escape

NEW = "New obstacle"
EXAMPLE = RoomBox("cupboard", (300.0, 1000.0, 300.0), (600.0, 300.0, 1400.0))  # fields offer it
BOX = ("center_mm", "size_mm", "turn_deg")
EXPLANATION = (
    "The robot keeps clear of head, table, floor, tracker and the obstacles you add. "
    "Positions are in mm from the initial robot base: x forward, y left, z up."
)


class WorkcellFields:
    """Fields to show, add, update and remove obstacles."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._context = context
        self._obstacles = Surroundings()
        gui.add_html(style.text(EXPLANATION))
        self._list = gui.add_html("")
        self._show_all = gui.add_checkbox(
            "Show all", False, hint="Shows all obstacles in the scene, with table and head"
        )
        self._which = gui.add_dropdown("Obstacle", (NEW,))
        self._name = gui.add_text("Name", EXAMPLE.name)
        self._box = Form(gui)
        self._box.of(AddObstacle, *BOX, **_values(EXAMPLE))
        self._add = gui.add_button("Add obstacle", icon="plus", color="gray")
        self._remove = gui.add_button("Remove obstacle", icon="trash", color="gray", visible=False)
        self._warning = gui.add_html("")
        with gui.add_folder("Table, floor and clearances", expand_by_default=False):
            self._workcell = SettingsForm(
                gui, context, SetWorkcell, lambda session: session.setup.surroundings
            )
        on_change(
            self._show_all,
            lambda e: context.show_layer("obstacles", bool(self._show_all.value)),
        )
        on_change(self._which, lambda e: self._choose())
        on_click(self._add, self._on_add)
        on_click(self._remove, self._on_remove)

    def _choose(self) -> None:
        box = next((b for b in self._obstacles.boxes if b.name == self._which.value), None)
        if box is not None:
            self._name.value = box.name
            self._box.show(_values(box))
        self._offer()

    def _offer(self) -> None:
        """Name the button by what it does."""
        known = self._which.value != NEW
        self._add.label = "Update obstacle" if known else "Add obstacle"
        self._add.icon = "check" if known else "plus"
        self._remove.visible = known

    def _on_add(self, event: Event) -> None:
        name, values, chosen = self._name.value.strip(), self._box.values(), self._which.value
        before = None if chosen in (NEW, name) else chosen
        self._context.send(lambda: AddObstacle(name, **values, instead_of=before), event)

    def _on_remove(self, event: Event) -> None:
        name = self._which.value
        self._context.send(lambda: RemoveObstacle(name), event)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the session and the layers."""
        workcell, busy = new.session.setup.surroundings, new.busy
        self._show_all.value = "obstacles" not in new.view.hidden
        self._workcell.render(old, new)
        self._box.enable(not busy)
        for part in (self._add, self._remove, self._which, self._name):
            part.disabled = busy
        if changed(old, new, "session.setup"):
            self._follow(workcell)
        if changed(old, new, "session.setup", "static_scene"):
            self._warning.content = clearance_warning(new)

    def _follow(self, workcell: Surroundings) -> None:
        """Offer the boxes that there are; one that was just added or changed stays chosen."""
        before, self._obstacles = {box.name for box in self._obstacles.boxes}, workcell
        names = tuple(box.name for box in workcell.boxes)
        chosen = self._which.value
        fresh = [name for name in names if name not in before]
        self._which.options = (NEW, *names)
        self._which.value = fresh[-1] if fresh else chosen if chosen in names else NEW
        self._list.content = obstacle_table(workcell)
        self._offer()


def _values(box: RoomBox) -> dict[str, Any]:
    return {name: getattr(box, name) for name in BOX}


def obstacle_table(workcell: Surroundings) -> str:
    """Return what was added, as a table."""
    if not workcell.boxes:
        return style.note("No obstacles added.")
    rows: list[tuple[str, str]] = []
    for box in workcell.boxes:
        middle = ", ".join(f"{part:.0f}" for part in box.center_mm).replace("-", "−")
        size = " × ".join(f"{part:.0f}" for part in box.size_mm)
        turn = f", rotated by {box.turn_deg:.0f}°" if box.turn_deg else ""
        place = f'at ({middle}) mm<br><span class="g">{size} mm{turn}</span>'
        rows.append((f"<b>{escape(box.name)}</b>", place))
    return style.table(("", ""), (), rows)


def clearance_warning(snapshot: Snapshot) -> str:
    """Return a warning if the home pose violates a clearance: nothing can be planned then."""
    if snapshot.static_scene is None:
        return ""
    pairs = clearance_violations(snapshot.session, snapshot.static_scene.home_rad)
    names = sorted({pair.second for pair in pairs if pair.too_close})
    if not names:
        return ""
    return style.note(
        f"The home pose of the robot is too close to: {', '.join(names)}. Move the obstacle "
        "away, or lower the clearances below.",
        "warn",
    )
