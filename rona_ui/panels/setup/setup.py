"""Step 1: specimen, region and devices. Every field sends its own command."""

from dataclasses import asdict
from pathlib import PurePath
from typing import Any

from rona_core.app.steps.setup.messages import (
    SetBoneModel,
    SetPointer,
    SetRegion,
    SetRobot,
    SetSeed,
    SetUseBaseMarker,
    SetWorld,
    StartSkullImport,
    UseSimulatedSkull,
)
from rona_core.app.steps.setup.robot_parameters import robot_figures
from rona_core.devices.robots import ROBOTS
from rona_core.devices.world_settings import REALISTIC_WORLD
from rona_core.errors import InvalidInputError, RonaError
from rona_core.session.document import Session
from rona_ui.panels.setup.obstacles import WorkcellFields
from rona_ui.panels.setup.probe import ProbeFields
from rona_ui.panels.setup.region import RegionControls
from rona_ui.panels.setup.tracker import NAMES, PLACE, TrackerFields
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.step_panel import StepPanel
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.viewer.bindings import Event, escape
from rona_ui.viewer.fields import read_number

FILES = ".nrrd,.nii,.gz,.stl,.ply,.obj"
BONE = ("kind", "own_speed")
ROBOT = ("model", "errors", "scan_speed_mm_per_s", "base_shift_mm", "base_turn_deg")
BONES = {"Normal": "normal", "Sharp diploe": "sharp", "Hard: sharp, more scatter": "hard"}
WORLDS = {"Nominal: as specified": "nominal", "Realistic": "realistic", "Hard": "hard"}
SKULLS = {"Simulated, left side": "left", "Simulated, right side": "right", "From a file": "file"}


class SetupPanel(StepPanel):
    """Specimen, region, tracker, robot, probe and pointer."""

    step = "setup"
    explanation = (
        "Choose the skull, the scan region and the devices. A change marks the later steps "
        "that depend on it as stale."
    )

    def build(self) -> None:
        """Add the fields in folders, the rarer ones closed."""
        form, gui = self.form, self.gui
        self._tracker = TrackerFields(form)
        self._probe = ProbeFields(form, gui, self.context)
        self._world = REALISTIC_WORLD
        form.number("seed", "Seed", 0, 0, 2**31 - 1, 1, "For patient, placement and noise")
        form.choice("skull", "Skull", SKULLS, "left", "Load a file below")
        form.choice("kind", "Bone", BONES, "normal", "Known only to the virtual probe")
        hint = "Sound speed of bone differs by 3 % between patients"
        form.tick("own_speed", "Patient-specific speed", True, hint)
        hint = "How far patient and devices deviate from their specification"
        form.choice("world_profile", "World", WORLDS, "realistic", hint)
        form.number("radius_mm", "Region radius (mm)", 25.0, 5.0, 45.0, 1.0)
        self._region = RegionControls(gui, self.context)
        with gui.add_folder("Devices", expand_by_default=False):
            self._tracker.build()
            form.choice("pointer", "Pointer", {"6D": "pointer6d", "5D": "pointer5d"}, "pointer6d")
        with gui.add_folder("Probe", expand_by_default=False):
            self._probe.build()
            with gui.add_folder("Probe parameters", expand_by_default=False):
                self._probe.build_details()
            with gui.add_folder("Delay line", expand_by_default=False):
                self._probe.build_block()
        with gui.add_folder("Tracker details", expand_by_default=False):
            self._tracker.build_details()
        with gui.add_folder("Tracker displacement", expand_by_default=False):
            self._tracker.build_place()
        with gui.add_folder("Robot", expand_by_default=False):
            form.choice("model", "Arm", {one.title: name for name, one in ROBOTS.items()}, "rx90")
            form.tick("errors", "Simulate robot error", True, "0.35 mm RMS over its workspace")
            form.number("scan_speed_mm_per_s", "Scan speed (mm/s)", 20.0, 0.5, 100.0, 1.0)
            form.vector("base_shift_mm", "Base shift (mm)", (0.0, 0.0, 0.0))
            form.number("base_turn_deg", "Base rotation (deg)", 0.0, -180.0, 180.0, 1.0)
            with gui.add_folder("Sources of the parameters", expand_by_default=False):
                self._figures = gui.add_html("")
        with gui.add_folder("Obstacles", expand_by_default=False):
            self._room = WorkcellFields(gui, self.context)
        with gui.add_folder("Load a skull", expand_by_default=False):
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
        form.on_change(self._changed)

        @self._upload.on_upload
        async def _(event: Any) -> None:
            self._read(event)

    def _read(self, event: Any) -> None:
        uploaded = self._upload.value
        name = PurePath(uploaded.name.replace("\\", "/")).name
        wanted = self._threshold.value.strip()
        label = self._label.value.strip()
        self.context.service(f"upload:{name}", event, uploaded.content)
        radius_mm = self.form.value("radius_mm")
        self.context.send(
            lambda: StartSkullImport(
                name,
                threshold=read_number(wanted) if wanted else None,
                radius_mm=radius_mm,
                label=_whole(read_number(label)) if label else None,
            ),
            event,
        )

    def _changed(self, name: str, event: Event) -> None:
        """Send the command that a field belongs to."""
        form = self.form
        make = {
            "seed": lambda: SetSeed(form.value("seed")),
            "radius_mm": lambda: SetRegion(self._region.center_mesh_mm, form.value("radius_mm")),
            "pointer": lambda: SetPointer(form.value("pointer")),
            "skull": lambda: UseSimulatedSkull(form.value("skull")),
            "use_base_marker": lambda: SetUseBaseMarker(form.value("use_base_marker")),
            "world_profile": lambda: SetWorld(
                **{**asdict(self._world), "profile": form.value("world_profile")}
            ),
        }
        if name == "skull" and form.value("skull") == "file":
            return  # nothing happens until a file has been read
        if name in make:
            key, build = name, make[name]
        elif name in BONE:
            key, build = "bone", lambda: SetBoneModel(**form.values(*BONE))
        elif name in PLACE:
            key, build = "place", self._tracker.place
        elif name in NAMES:
            self._tracker.changed(name)
            key, build = "tracker", self._tracker.message
        elif name in ROBOT:
            key, build = "robot", lambda: SetRobot(**form.values(*ROBOT))
        else:
            key, build = "probe", self._probe.message
        self.context.send_debounced(("setup", key), build, event)

    def update(self, old: Snapshot | None, new: Snapshot) -> None:
        """Write what the session holds into the fields where it has changed or was refused."""
        self._region.render(new)
        if changed(old, new, "session.setup", "refused"):
            self._world = new.session.setup.world
            tracker = new.session.setup.devices.tracker
            probe = self._probe.field_values(new.session.setup.devices.probe)
            self.form.show({**_held(new.session), **self._tracker.field_values(tracker), **probe})
            self._figures.content = figures_table(new.session.setup.devices.robot.model)
        self._room.render(old, new)
        if changed(old, new, "session.setup", "session.results", "busy"):
            self._probe.show(new.session, new.busy)

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


def _held(session: Session) -> dict[str, Any]:
    setup, devices = session.setup, session.setup.devices
    return {
        "seed": setup.seed,
        "skull": getattr(setup.specimen, "side", "file"),
        "radius_mm": setup.region.radius_mm,
        "world_profile": setup.world.profile,
        "pointer": devices.pointer,
        "use_base_marker": setup.use_base_marker,
        **{name: getattr(setup.bone, name) for name in BONE},
        **{name: getattr(devices.robot, name) for name in ROBOT},
    }


def figures_table(model: str) -> str:
    """Return the table as HTML; what nobody states comes first and says so."""
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
