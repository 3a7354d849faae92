"""Step 1: specimen, region and devices. Every field sends its own command."""

from collections.abc import Callable
from dataclasses import asdict
from pathlib import PurePath
from typing import Any

from rona_core.app.steps.setup.messages import (
    MoveTracker,
    SetBoneModel,
    SetPointer,
    SetRegion,
    SetRobot,
    SetSeed,
    SetTracker,
    SetUseBaseMarker,
    SetWorld,
    StartSkullImport,
    UseSimulatedSkull,
)
from rona_core.app.steps.setup.step import robot_figures
from rona_core.devices.limits import limits_of
from rona_core.devices.settings import TrackerSettings
from rona_core.errors import InvalidInputError, RonaError
from rona_core.session.document import Session
from rona_ui.panels.setup.obstacles import WorkcellFields
from rona_ui.panels.setup.probe import ProbeFields
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import Make, PanelContext, SettingsForm, Show, on_change, on_click
from rona_ui.panels.widgets.step_panel import StepPanel
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.viewer.bindings import Event, escape
from rona_ui.viewer.fields import read_number

HELP = "Click the skull where the centre of the region is to be. Drag to rotate the view."


class RegionControls:
    """Buttons to pick the centre of the region, to leave that, and to take the program's again."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._context = context
        self._radius_mm = 25.0
        self.center_mesh_mm: tuple[float, float, float] | None = None
        hint = "Place the scan region by a click on the skull"
        self._pick = gui.add_button("Pick region", icon="target", color="gray", hint=hint)
        self._help = gui.add_html("")
        self._cancel = context.view_button(gui, "Cancel picking", "x", drawing=None, picks=())
        self._reset = context.send_button(
            gui, "Reset region", "restore", lambda: SetRegion(None, self._radius_mm)
        )
        on_click(self._pick, self._begin)

    def _begin(self, event: Any) -> None:
        self._context.set_view(drawing="region", picks=())

    def render(self, new: Snapshot) -> None:
        """Follow the session and what is being picked."""
        region, picking = new.session.setup.region, new.view.drawing == "region"
        self.center_mesh_mm, self._radius_mm = region.center_mesh_mm, region.radius_mm
        self._pick.visible, self._cancel.visible = not picking, picking
        self._reset.visible = not picking and region.center_mesh_mm is not None
        self._pick.disabled = self._reset.disabled = new.busy
        self._help.content = style.note(HELP) if picking else ""


DETAILS = (
    "stereo",
    "depth_ratio",
    "occlusion",
    "latency_ms",
    "dropped_share",
    "phantom_share",
    "drift_mm",
    "minutes_on",
)


class TrackerFields:
    """Profile, details and place of the tracker."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._gui, self._context = gui, context
        self._tracker = SettingsForm(
            gui,
            context,
            SetTracker,
            lambda session: session.setup.devices.tracker,
            "profile",
            "rate_hz",
            make=_message,
            show=lambda held: {**asdict(held), "latency_ms": 1000.0 * held.latency_s},
        )

    def build_details(self) -> None:
        """Add what makes the virtual tracker like a real one."""
        self._tracker.add(*DETAILS)

    def build_place(self) -> None:
        """Add where the tracker stands, and whether it is found again once it has moved."""
        self._place = SettingsForm(
            self._gui,
            self._context,
            MoveTracker,
            lambda session: session.setup.devices.tracker.place,
        )
        self._marker = SettingsForm(
            self._gui, self._context, SetUseBaseMarker, lambda session: session.setup
        )

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the session."""
        for form in (self._tracker, self._place, self._marker):
            form.render(old, new)


def _message(held: TrackerSettings, values: dict[str, Any]) -> SetTracker:
    """Return the command of the rows; the latency of the profile is left to the profile."""
    if values["profile"] != held.profile:
        values["latency_ms"] = None
    elif values["latency_ms"] == 1000.0 * held.latency_s:
        values["latency_ms"] = held.latency_ms
    return SetTracker(**values)


FILES = ".nrrd,.nii,.gz,.stl,.ply,.obj"
SIDES = limits_of(UseSimulatedSkull)["side"]["labels"]
SKULLS = {**{label: side for side, label in SIDES.items()}, "From a file": None}


class SetupPanel(StepPanel):
    """Specimen, region, tracker, robot, probe and pointer."""

    step = "setup"
    explanation = (
        "Choose the skull, the scan region and the devices. A change marks the later steps "
        "that depend on it as stale."
    )

    def build(self) -> None:
        """Add the fields in folders, the rarer ones closed."""
        gui = self.gui
        self._forms: list[SettingsForm] = []
        self._add(SetSeed, lambda session: session.setup)
        self._skull = gui.add_dropdown("Skull", tuple(SKULLS), hint="Load a file below")
        on_change(self._skull, self._choose_skull)
        self._add(SetBoneModel, lambda session: session.setup.bone)
        self._add(
            SetWorld,
            lambda session: session.setup.world,
            "profile",
            make=lambda world, values: SetWorld(**{**asdict(world), **values}),
        )
        self._disc = self._add(
            SetRegion,
            lambda session: session.setup.region,
            "radius_mm",
            make=lambda region, values: SetRegion(region.center_mesh_mm, **values),
        )
        self._region = RegionControls(gui, self.context)
        with gui.add_folder("Devices", expand_by_default=False):
            self._tracker = TrackerFields(gui, self.context)
            self._add(
                SetPointer,
                lambda session: session.setup.devices,
                show=lambda devices: {"kind": devices.pointer},
            )
        with gui.add_folder("Probe", expand_by_default=False):
            self._probe = ProbeFields(gui, self.context)
            with gui.add_folder("Probe parameters", expand_by_default=False):
                self._probe.build_details()
            with gui.add_folder("Delay line", expand_by_default=False):
                self._probe.build_block()
        with gui.add_folder("Tracker details", expand_by_default=False):
            self._tracker.build_details()
        with gui.add_folder("Tracker displacement", expand_by_default=False):
            self._tracker.build_place()
        with gui.add_folder("Robot", expand_by_default=False):
            self._add(SetRobot, lambda session: session.setup.devices.robot)
            with gui.add_folder("Sources of the parameters", expand_by_default=False):
                self._figures = gui.add_html("")
        with gui.add_folder("Obstacles", expand_by_default=False):
            self._room = WorkcellFields(gui, self.context)
        with gui.add_folder("Load a skull", expand_by_default=False):
            self._build_upload()

    def _build_upload(self) -> None:
        """Add what a skull is read from a file with."""
        gui = self.gui
        gui.add_html(
            style.text(
                "A mask or CT volume (NRRD, NIfTI) or a mesh (STL, PLY, OBJ), in mm. A "
                "CT volume needs a bone threshold, a map of several labels that of bone."
            )
        )
        hint = "Leave empty for masks and meshes"
        self._threshold = gui.add_text("Bone threshold", "", hint=hint)
        hint = "Value of bone in a map of several labels; leave empty for others"
        self._label = gui.add_text("Bone label", "", hint=hint)
        self._upload = gui.add_upload_button(
            "Load skull file…", icon="upload", mime_type=FILES, color="gray"
        )

        @self._upload.on_upload
        async def _(event: Any) -> None:
            self._read(event)

    def _add(
        self,
        kind: Callable[..., Any],
        held: Callable[[Session], Any],
        *names: str,
        make: Make | None = None,
        show: Show | None = None,
    ) -> SettingsForm:
        """Add the rows of a message, which follow the session."""
        form = SettingsForm(self.gui, self.context, kind, held, *names, make=make, show=show)
        self._forms.append(form)
        return form

    def _read(self, event: Any) -> None:
        uploaded = self._upload.value
        name = PurePath(uploaded.name.replace("\\", "/")).name
        wanted = self._threshold.value.strip()
        label = self._label.value.strip()
        self.context.service(f"upload:{name}", event, uploaded.content)
        radius_mm = self._disc.value("radius_mm")
        self.context.send(
            lambda: StartSkullImport(
                name,
                threshold=read_number(wanted) if wanted else None,
                radius_mm=radius_mm,
                label=_whole(read_number(label)) if label else None,
            ),
            event,
        )

    def _choose_skull(self, event: Event) -> None:
        side = SKULLS[self._skull.value]
        if side is not None:  # else nothing happens until a file has been read
            self.context.send_debounced("skull", lambda: UseSimulatedSkull(side), event)

    def update(self, old: Snapshot | None, new: Snapshot) -> None:
        """Write what the session holds into the fields where it has changed or was refused."""
        self._region.render(new)
        self._skull.disabled = new.busy
        for form in (*self._forms, self._tracker):
            form.render(old, new)
        if changed(old, new, "session.setup", "refused"):
            side = getattr(new.session.setup.specimen, "side", None)
            self._skull.value = next(label for label, held in SKULLS.items() if held == side)
            self._figures.content = figures_table(new.session.setup.devices.robot.model)
        self._room.render(old, new)
        self._probe.render(old, new)

    def remarks(self, snapshot: Snapshot) -> str:
        """Say what the region is."""
        static_scene = snapshot.static_scene
        if static_scene is None:
            return style.note("Placing the specimen …")
        x, y, z = static_scene.region_center_base
        return style.note(
            f"Region: centre ({x:.0f}, {y:.0f}, {z:.0f}) mm in the robot base, "
            f"radius {static_scene.region_radius_mm:.0f} mm (purple ring)"
        )


def figures_table(model: str) -> str:
    """Return the table as HTML; what has no source comes first and says so."""
    try:
        rows = robot_figures(model)
    except RonaError as error:
        return style.note(error, "warn")
    assumed = sum(not row.sourced for row in rows)
    cells: list[tuple[str]] = []
    for row in sorted(rows, key=lambda row: row.sourced):
        values = ", ".join(f"{value:.5g}" for value in row.values).replace("-", "−")
        trust = row.trust if row.sourced else f"▲ {row.trust}"
        value = f"{escape(row.name)}<br><b>{escape(values)}</b> {escape(row.unit)}"
        source = f'<span class="g">{escape(trust)}: {escape(row.source)}</span>'
        cells.append((f"{value}<br>{source}",))
    words = style.text(
        f"{len(rows)} parameters, {assumed} of them assumed (marked ▲). Override them in "
        "Python: robot_model(name, overrides)."
    )
    return words + style.table(("",), (), cells)


def _whole(number: float) -> int:
    """Return a label.

    Raises:
        InvalidInputError: it is no whole number.
    """
    if not number.is_integer():
        raise InvalidInputError(f"expected a whole number as bone label, not {number:g}")
    return int(number)
